"""What Phase II leaves behind: the trained networks and the average light of their lessons."""

from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from torch import Tensor

from lightprobe.core.checkpoint import load_tensors, save_tensors
from lightprobe.core.config_distill import DistillConfig
from lightprobe.core.errors import InputError
from lightprobe.core.files import read_json, write_json
from lightprobe.distill.illumination_mlp import IlluminationMlp
from lightprobe.distill.sphere_net import SphereNet

PRETRAINED = Path(__file__).parents[1] / "assets" / "sphere_net.safetensors"
PRETRAINED_WIDTH = 24
_WEIGHTS = "illumination_mlp.safetensors"
_SPHERE = "sphere_net.safetensors"
_CONFIG = "config.json"
_PRIOR = "mean_light"
_UP = "up"


@dataclass(frozen=True)
class ProbeModel:
    """A trained light predictor for one object.

    `mean_light` is the mean light (6, R, R, 3) of all lessons relative to each one's light level: what the light
    usually is in directions that a photo says nothing about.
    """

    network: IlluminationMlp
    mean_light: Tensor
    up: Tensor  # (3,) unit: which way is up for most of the training cameras
    config: DistillConfig
    sphere: SphereNet | None = None  # None: trained without it (`sphere_steps` of 0)

    def to(self, device: torch.device) -> "ProbeModel":
        """Return the model on `device`; the network's weights move in place."""
        sphere = None if self.sphere is None else self.sphere.to(device)
        return ProbeModel(self.network.to(device), self.mean_light.to(device), self.up.to(device), self.config, sphere)

    def save(self, folder: Path) -> None:
        """Write `folder`/illumination_mlp.safetensors, sphere_net.safetensors if there is one, and config.json."""
        tensors = {f"network.{name}": value for name, value in self.network.state_dict().items()}
        save_tensors(Path(folder) / _WEIGHTS, tensors | {_PRIOR: self.mean_light, _UP: self.up})
        if self.sphere is not None:
            save_tensors(Path(folder) / _SPHERE, self.sphere.state_dict())
        write_json(Path(folder) / _CONFIG, asdict(self.config))

    @staticmethod
    def exists(folder: Path) -> bool:
        """Return whether `save` has finished in `folder`; config.json is written last."""
        return (Path(folder) / _CONFIG).is_file()

    @staticmethod
    def load(folder: Path) -> "ProbeModel":
        """Return the model saved in `folder`; raise `InputError` when files are missing or do not fit each other."""
        config = DistillConfig.from_json(read_json(Path(folder) / _CONFIG))
        tensors = load_tensors(Path(folder) / _WEIGHTS)
        network = new_network(config)
        weights = {name[len("network.") :]: value for name, value in tensors.items() if name.startswith("network.")}
        try:
            network.load_state_dict(weights)
            mean_light, up = tensors[_PRIOR], tensors[_UP]
            sphere = _load_sphere(Path(folder) / _SPHERE, config)
        except (RuntimeError, KeyError) as error:
            raise InputError(f"The weights in {folder} do not fit {_CONFIG}; distill this run again.") from error
        return ProbeModel(network, mean_light, up, config, sphere)


def _load_sphere(path: Path, config: DistillConfig) -> SphereNet | None:
    if config.sphere_steps == 0:
        return None
    sphere = SphereNet(config.sphere_width)
    sphere.load_state_dict(load_tensors(path))
    return sphere


def new_network(config: DistillConfig, seed: int = 0) -> IlluminationMlp:
    """Return an untrained network of the configured size."""
    return IlluminationMlp(config.width, config.depth, config.frequencies, seed, config.network)


def new_sphere(config: DistillConfig, seed: int = 0) -> SphereNet:
    """Return the sphere network that a training starts from: the bundled one where wanted and as wide, else noise.

    The bundled one was trained on random solids under generated lights (`tools/pretrain_sphere_net.py`).
    """
    sphere = SphereNet(config.sphere_width, seed)
    if starts_pretrained(config):
        sphere.load_state_dict(load_tensors(PRETRAINED))
    return sphere


def starts_pretrained(config: DistillConfig) -> bool:
    """Return whether the bundled sphere network is wanted, and as wide as the configured one."""
    return config.pretrained and config.sphere_width == PRETRAINED_WIDTH
