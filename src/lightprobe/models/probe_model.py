"""What Phase II leaves behind: the trained networks and the average light of their training examples."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TypeVar

import torch
from torch import Tensor, nn

from lightprobe.core.checkpoint import load_tensors, save_tensors
from lightprobe.core.config.distillation import DistillConfig
from lightprobe.core.errors import ConfigError
from lightprobe.core.files import write_json
from lightprobe.core.run import RETRAIN
from lightprobe.core.stored import TensorRule, check_tensors, damaged, read_object, remedied, rules_like
from lightprobe.light.environment import Environment
from lightprobe.models.illumination_mlp import IlluminationMlp
from lightprobe.models.probe_maps import CHANNELS
from lightprobe.models.sphere_net import SphereNet

PRETRAINED = Path(__file__).parents[1] / "assets" / "sphere_net.safetensors"
PRETRAINED_WIDTH = 24  # of the bundled network
_WEIGHTS = "illumination_mlp.safetensors"
_SPHERE = "sphere_net.safetensors"
_CONFIG = "config.json"
_MLP = "network."  # prefix of the illumination MLP's weights
_PRIOR = "mean_light"
_UP = "up"

Network = TypeVar("Network", bound=nn.Module)


@dataclass(frozen=True)
class ProbeModel:
    """A trained light predictor for one object.

    `mean_light` is the mean light of all training examples relative to each one's light level: what the light
    usually is in directions that a photo says nothing about.
    """

    network: IlluminationMlp
    mean_light: Environment
    up: Tensor  # (3,) unit: which way is up for most of the training cameras
    config: DistillConfig
    sphere: SphereNet | None = None  # None: trained without it (`sphere_steps` of 0)

    def to(self, device: torch.device) -> "ProbeModel":
        """Return the model on `device`; the network's weights move in place."""
        sphere = None if self.sphere is None else self.sphere.to(device)
        return ProbeModel(
            self.network.to(device), self.mean_light.to(device), self.up.to(device), self.config, sphere
        )

    def save(self, folder: Path) -> None:
        """Write illumination_mlp.safetensors, sphere_net.safetensors if there is one, and config.json."""
        tensors = {f"{_MLP}{name}": value for name, value in self.network.state_dict().items()}
        save_tensors(Path(folder) / _WEIGHTS, tensors | {_PRIOR: self.mean_light.texels, _UP: self.up})
        if self.sphere is not None:
            save_tensors(Path(folder) / _SPHERE, self.sphere.state_dict())
        write_json(Path(folder) / _CONFIG, asdict(self.config))

    @staticmethod
    def exists(folder: Path) -> bool:
        """Return whether `save` has finished in `folder`; config.json is written last."""
        return (Path(folder) / _CONFIG).is_file()

    @staticmethod
    def load(folder: Path) -> "ProbeModel":
        """Return the model saved in `folder`; raise `InputError` for files that are missing or do not fit."""
        folder = Path(folder)
        config = _load_config(folder / _CONFIG)
        with remedied(RETRAIN):
            tensors = load_tensors(folder / _WEIGHTS)
        side = config.light_resolution
        fixed = {_PRIOR: TensorRule((6, side, side, 3), low=0), _UP: TensorRule((3,), low=-1.001, high=1.001)}
        check_tensors(tensors, fixed, folder / _WEIGHTS, RETRAIN)
        network = _load_network(folder / _WEIGHTS, tensors, config)
        sphere = _load_sphere(folder / _SPHERE, config)
        return ProbeModel(network, Environment(tensors[_PRIOR]), tensors[_UP], config, sphere)


def _load_config(path: Path) -> DistillConfig:
    try:
        return DistillConfig.from_json(read_object(path, RETRAIN))
    except ConfigError as error:
        raise damaged(path, str(error), RETRAIN) from error


def _load_network(path: Path, tensors: dict[str, Tensor], config: DistillConfig) -> IlluminationMlp:
    """Return the illumination MLP; sizes are compared first, as a wrong one may be too large to make."""
    weights = {name[len(_MLP) :]: value for name, value in tensors.items() if name.startswith(_MLP)}
    layers = sum(name.endswith("weight") for name in weights)
    check_tensors(weights, {"layers.0.weight": TensorRule((config.width, "inputs"))}, path, RETRAIN)
    if layers != config.depth + 1:
        raise damaged(path, f"it has {layers} layers, and {_CONFIG} {config.depth + 1}", RETRAIN)
    return _filled(new_network(config), weights, path, RETRAIN)


def _load_sphere(path: Path, config: DistillConfig) -> SphereNet | None:
    if config.sphere_steps == 0:
        return None
    with remedied(RETRAIN):
        weights = load_tensors(path)
    first = {"fine.0.conv.weight": TensorRule((config.sphere_width, CHANNELS, 3, 3))}
    check_tensors(weights, first, path, RETRAIN)
    return _filled(SphereNet(config.sphere_width), weights, path, RETRAIN)


def _filled(network: Network, weights: dict[str, Tensor], path: Path, remedy: str) -> Network:
    """Put checked weights into a network and return it."""
    check_tensors(weights, rules_like(network.state_dict()), path, remedy)
    network.load_state_dict({name: weights[name] for name in network.state_dict()})
    return network


def new_network(config: DistillConfig, seed: int = 0) -> IlluminationMlp:
    """Return an untrained network of the configured size."""
    return IlluminationMlp(config.width, config.depth, seed, config.network)


def new_sphere(config: DistillConfig, seed: int = 0) -> SphereNet:
    """Return the sphere network that a training starts from: the bundled one where wanted and as wide, else
    noise.

    The bundled one was trained on random solids under generated lights (`tools/pretrain_sphere_net.py`).
    """
    sphere = SphereNet(config.sphere_width, seed)
    if starts_pretrained(config):
        _filled(sphere, load_tensors(PRETRAINED), PRETRAINED, "install lightprobe again")
    return sphere


def starts_pretrained(config: DistillConfig) -> bool:
    """Return whether the bundled sphere network is wanted, and as wide as the configured one."""
    return config.pretrained and config.sphere_width == PRETRAINED_WIDTH
