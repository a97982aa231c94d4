"""What Phase II leaves behind: a trained illumination MLP and the average light of its teachers."""

from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from torch import Tensor

from lightprobe.core.checkpoint import load_tensors, save_tensors
from lightprobe.core.config_distill import DistillConfig
from lightprobe.core.errors import InputError
from lightprobe.core.files import read_json, write_json
from lightprobe.distill.illumination_mlp import IlluminationMlp

_WEIGHTS = "illumination_mlp.safetensors"
_CONFIG = "config.json"
_PRIOR = "mean_light"


@dataclass(frozen=True)
class ProbeModel:
    """A trained light predictor for one object.

    `mean_light` is the teachers' mean (6, R, R, 3) relative to each photo's light level: what the light usually is in
    directions that a photo says nothing about.
    """

    network: IlluminationMlp
    mean_light: Tensor
    config: DistillConfig

    def to(self, device: torch.device) -> "ProbeModel":
        """Return the model on `device`; the network's weights move in place."""
        return ProbeModel(self.network.to(device), self.mean_light.to(device), self.config)

    def save(self, folder: Path) -> None:
        """Write `folder`/illumination_mlp.safetensors and config.json."""
        tensors = {f"network.{name}": value for name, value in self.network.state_dict().items()}
        save_tensors(Path(folder) / _WEIGHTS, tensors | {_PRIOR: self.mean_light})
        write_json(Path(folder) / _CONFIG, asdict(self.config))

    @staticmethod
    def load(folder: Path) -> "ProbeModel":
        """Return the model saved in `folder`; raise `InputError` when files are missing or do not fit each other."""
        config = DistillConfig.from_json(read_json(Path(folder) / _CONFIG))
        tensors = load_tensors(Path(folder) / _WEIGHTS)
        network = new_network(config)
        weights = {name[len("network.") :]: value for name, value in tensors.items() if name.startswith("network.")}
        try:
            network.load_state_dict(weights)
            mean_light = tensors[_PRIOR]
        except (RuntimeError, KeyError) as error:
            raise InputError(f"{Path(folder) / _WEIGHTS} does not fit {_CONFIG}; distill this run again.") from error
        return ProbeModel(network, mean_light, config)


def new_network(config: DistillConfig, seed: int = 0) -> IlluminationMlp:
    """Return an untrained network of the configured size."""
    return IlluminationMlp(config.width, config.depth, config.frequencies, seed)
