"""Phase II configuration and its presets: how the light predictor is distilled from the decomposition."""

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from lightprobe.core.config.stored import config_from_json
from lightprobe.core.errors import ConfigError

LIGHT_RESOLUTIONS = (8, 16, 32, 64, 128, 256)  # texels along each edge of a cubemap


class AlphaRule(StrEnum):
    """How roughness r becomes the GGX lobe's alpha^2: r^4 as in the renderer, or r^2 as the paper prints it."""

    R4 = "r4"
    R2 = "r2"


class LossSpace(StrEnum):
    """Where Equation 6 takes its difference: radiance as printed, or log(1 + radiance), where a sun weighs
    little.
    """

    LINEAR = "linear"
    LOG = "log"


class RadianceUnit(StrEnum):
    """What Equation 6 counts radiance in: the photo's light level, average light being half way to white in
    Y, or the photo's own exposure, to the letter."""

    LEVEL = "level"
    PHOTO = "photo"


class TotalDistribution(StrEnum):
    """D_total of Equation 6: the mean of D over all object pixels, its sum, or its mean over those that a
    direction can light at all (those whose normal faces it)."""

    MEAN = "mean"
    SUM = "sum"
    PER_DIRECTION = "per-direction"


class NetworkForm(StrEnum):
    """What the illumination MLP is told and says.

    `relative`: logarithms of colour and of the average light the pixel saw, encoded directions, the mirror
    direction; a log factor on that average light. `plain`: c, k_d, k_s, n, r and w_o; the probe's colour (the
    paper).
    """

    RELATIVE = "relative"
    PLAIN = "plain"


class Lessons(StrEnum):
    """What Phase II learns from: photos with their Phase I environments (the paper), re-rendered pairs, or
    both.
    """

    TEACHER = "teacher"
    SYNTHETIC = "synthetic"
    BOTH = "both"


@dataclass(frozen=True)
class DistillConfig:
    """Phase II: train the predictors of light, the illumination MLP and then the sphere network that builds
    on it.
    """

    lessons: Lessons = Lessons.BOTH
    """What is learned from."""
    synthetic_lessons: int = 800
    """Re-rendered photos: the asset in the training cameras under known lights."""
    steps: int = 2000
    """Training steps of the illumination MLP, each on one photo."""
    sphere_steps: int = 600
    """Training steps of the sphere network; 0 leaves it out."""
    sphere_batch: int = 8
    """Photos in each of them."""
    sphere_width: int = 24
    """Channels of the sphere network at its finest resolution."""
    pretrained: bool = True
    """Start the sphere network from the bundled one, which knows other objects, and end halfway between that
    one and what this object taught; only for a network of its width (24)."""
    sphere_learning_rate: float = 5e-4
    """Largest Adam step of the sphere network; it falls to nothing along a cosine."""
    learning_rate: float = 5e-4
    """Adam step."""
    samples: int = 1024
    """Pixels stacked in a step."""
    light_resolution: int = 16
    """Texels along each cubemap edge of the environments compared while training."""
    max_side: int = 256
    """Longer side in pixels of the photos; larger ones are reduced by area averaging."""
    pixels_per_photo: int = 8192
    """Object pixels kept of each photo."""
    network: NetworkForm = NetworkForm.RELATIVE
    """Inputs and output of the illumination MLP."""
    width: int = 128
    """Units of each hidden layer."""
    depth: int = 3
    """Hidden layers."""
    frequencies: int = 3
    """Octaves of the Fourier encoding of directions; the plain network has none."""
    alpha_rule: AlphaRule = AlphaRule.R4
    """Width of the GGX lobe a pixel is spread by."""
    loss_space: LossSpace = LossSpace.LOG
    """Space of the squared difference."""
    radiance_unit: RadianceUnit = RadianceUnit.LEVEL
    """Unit of the radiance that is compared."""
    solid_angle_weight: bool = True
    """Weigh texels by their solid angles, of which those of a cubemap differ by a factor of five; else all
    alike.
    """
    sample_weight: bool = True
    """Weigh each direction by how much of it the sampled pixels saw (Equation 6, first weight)."""
    total_distribution: TotalDistribution = TotalDistribution.MEAN
    """What that weight divides by."""
    intensity_weight: bool = True
    """Weigh bright and dark directions above middling ones (Equation 6, second weight)."""
    checkpoint_every: int = 1000
    """Steps between checkpoints."""
    simulated_photos: int = 24
    """Photos of the object that are simulated at the end, to find how well it tells of its light; 0: none."""

    def __post_init__(self) -> None:
        """Refuse values no run could use."""
        positive = (
            "steps",
            "synthetic_lessons",
            "sphere_batch",
            "sphere_width",
            "samples",
            "light_resolution",
            "max_side",
            "pixels_per_photo",
            "width",
            "depth",
            "frequencies",
            "checkpoint_every",
        )
        for name in positive:
            if getattr(self, name) < 1:
                raise ConfigError(f"distill.{name} must be at least 1, not {getattr(self, name)}.")
        for name in ("sphere_steps", "simulated_photos"):
            if getattr(self, name) < 0:
                raise ConfigError(f"distill.{name} must not be negative, but is {getattr(self, name)}.")
        for name in ("learning_rate", "sphere_learning_rate"):
            if not 0 < getattr(self, name) < math.inf:
                raise ConfigError(f"distill.{name} must be positive and finite, not {getattr(self, name)}.")
        if self.light_resolution not in LIGHT_RESOLUTIONS:
            raise ConfigError(
                f"distill.light_resolution must be a power of two from 8 to 256, not {self.light_resolution}."
            )

    @property
    def total_steps(self) -> int:
        """Steps of both networks."""
        return self.steps + self.sphere_steps

    @staticmethod
    def from_json(value: dict[str, Any]) -> "DistillConfig":
        """Return the configuration written as JSON."""
        return config_from_json(DistillConfig, value, "Phase II configuration")


def quick() -> DistillConfig:
    """Two to three minutes on two CPU cores."""
    return DistillConfig()


def demo() -> DistillConfig:
    """The bundled scene, within about a minute on two CPU cores."""
    return replace(quick(), steps=1500, sphere_steps=300, synthetic_lessons=300)


def standard() -> DistillConfig:
    """Minutes on one GPU."""
    return replace(
        quick(),
        steps=15_000,
        sphere_steps=10_000,
        synthetic_lessons=10_000,
        sphere_width=48,
        pretrained=False,
        sphere_learning_rate=2e-3,
        light_resolution=32,
        max_side=512,
        pixels_per_photo=16_384,
    )


def paper() -> DistillConfig:
    """The paper's settings (sections 3.2 and 4.2), the loss as printed; what it leaves open:
    docs/paper-preset.md.
    """
    return replace(
        standard(),
        lessons=Lessons.TEACHER,
        steps=30_000,
        sphere_steps=0,
        light_resolution=128,
        max_side=512,
        pixels_per_photo=262_144,
        network=NetworkForm.PLAIN,
        alpha_rule=AlphaRule.R2,
        loss_space=LossSpace.LINEAR,
        radiance_unit=RadianceUnit.PHOTO,
        solid_angle_weight=False,
    )
