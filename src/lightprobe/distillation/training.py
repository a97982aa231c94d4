"""Phase II: the illumination MLP photo by photo, then the sphere network on what the MLP makes of the photos."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import asdict

import torch
from torch import Tensor

from lightprobe.core.checkpoint import copy_stored
from lightprobe.core.config.distillation import DistillConfig
from lightprobe.core.device import full_precision
from lightprobe.distillation.examples import TrainingExample, collect_examples
from lightprobe.distillation.mlp_training import MlpObjective
from lightprobe.distillation.sphere_training import SphereObjective, schedule, sphere_examples
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.models.illumination_mlp import IlluminationMlp
from lightprobe.models.probe_model import ProbeModel, new_network, new_sphere, starts_pretrained
from lightprobe.models.sphere_net import SphereNet
from lightprobe.scene.photo import Scene
from lightprobe.training import Progress, Stage, Training

_LARGEST_GRADIENT = 1.0  # norm, of the sphere network
_START_KEPT = 0.5  # share of the bundled weights in the trained ones; Wortsman et al. 2022 take the mean


def distill(
    decomposition: Decomposition,
    scene: Scene,
    config: DistillConfig | None = None,
    device: torch.device | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    *,
    environments: Sequence[Environment] = (),
    on_example: Callable[[int, int], None] | None = None,
) -> ProbeModel:
    """Train the predictors on the scene's training photos and on re-rendered ones, and return the model.

    Without `config` the preset `quick`, without `device` the CPU. With `progress.checkpoints`, an interrupted
    call goes on from the newest one and ends with the same bits on a CPU. environments: of any resolution, to
    re-render under as well. on_example: hears of (done, all) photos prepared. Raises `InputError` when no
    photo shows the object, `ConfigError` when the checkpoints are of another configuration,
    `ConvergenceError` when the loss stops being finite.
    """
    config, device = config or DistillConfig(), full_precision(device or torch.device("cpu"))
    examples = collect_examples(
        decomposition.asset, decomposition.lights, scene, config, device, seed, environments, on_example
    )
    return train(examples, config, device, seed, progress, maps=_digest(environments))


def _digest(environments: Sequence[Environment]) -> str:
    """Return a checksum of maps, in their order; nothing for none."""
    found = hashlib.blake2b(digest_size=16)
    for environment in environments:
        found.update(environment.texels.cpu().numpy().tobytes())
    return found.hexdigest() if environments else ""


def stages(config: DistillConfig) -> tuple[Stage, Stage]:
    """Return the training of the illumination MLP and that of the sphere network."""
    rates = schedule(config)
    sphere = Stage("sphere", config.steps, config.sphere_steps, rates, largest_gradient=_LARGEST_GRADIENT)
    return Stage("network", 0, config.steps), sphere


def train(
    examples: list[TrainingExample],
    config: DistillConfig,
    device: torch.device,
    seed: int,
    progress: Progress | None = None,
    *,
    maps: str = "",
) -> ProbeModel:
    """Train on examples already collected; the rest as in `distill`.

    maps: a digest of the user's maps that examples are lit by; checkpoints of others are of another
    configuration.
    """
    first, second = passes = stages(config)
    known = asdict(config) | ({"maps": maps} if maps else {})
    training = Training("Phase II", known, seed, passes, config.checkpoint_every, progress or Progress())
    network = new_network(config, seed).to(device)
    resumed = training.latest()
    if resumed is None or resumed.stage == first.name:
        training.run(MlpObjective(network, examples, config, seed), first, resumed)
        resumed = None
    else:
        with training.restoring(resumed.step):
            copy_stored(resumed.start, _parameters(network))
    sphere = None
    if config.sphere_steps:
        sphere = new_sphere(config, seed).to(device)
        seen = sphere_examples(network, examples, config, seed)
        training.run(SphereObjective(sphere, seen, config, seed), second, resumed, _parameters(network))
        sphere = _learned(sphere, config, seed).requires_grad_(False)
    side = config.light_resolution
    mean = torch.stack([example.target for example in examples]).mean(0).reshape(6, side, side, 3)
    return ProbeModel(network.requires_grad_(False), Environment(mean), examples[0].up, config, sphere)


def _parameters(network: IlluminationMlp) -> dict[str, Tensor]:
    return {f"network.{name}": parameter for name, parameter in network.named_parameters()}


@torch.no_grad()
def _learned(sphere: SphereNet, config: DistillConfig, seed: int) -> SphereNet:
    """Return the trained network, halfway back to the bundled one if it came from there.

    One object's few examples teach its errors and make the network forget what lights are like. The mean of
    the weights before and after keeps both, at no cost (Wortsman et al. 2022, "Robust fine-tuning of
    zero-shot models").
    """
    if starts_pretrained(config):
        start = dict(new_sphere(config, seed).named_parameters())
        for name, parameter in sphere.named_parameters():
            parameter.lerp_(start[name].to(parameter.device), _START_KEPT)
    return sphere
