"""Phase II configuration and its presets: how the light predictor is distilled from the decomposition."""

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from lightprobe.core.config.stored import check_values, config_from_json

# least value -> the fields of `DistillConfig` that need at least as much
_LEAST = {
    0: "sphere_steps simulated_photos",
    1: "steps synthetic_lessons sphere_width samples max_side pixels_per_photo width depth checkpoint_every",
}


class AlphaRule(StrEnum):
    """How roughness r becomes the GGX lobe's alpha^2: r^4 as in the renderer, or r^2 as the paper prints it."""

    R4 = "r4"
    R2 = "r2"


class LossSpace(StrEnum):
    """Where Equation 6 takes its difference: radiance as printed, or log(1 + radiance): suns weigh little."""

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


class ExampleSource(StrEnum):
    """What Phase II learns from: photos with their Phase I lights (the paper), re-rendered photos, or both."""

    TEACHER = "teacher"
    SYNTHETIC = "synthetic"
    BOTH = "both"


@dataclass(frozen=True)
class DistillConfig:
    """Phase II: train the predictors of light, the illumination MLP and then the sphere network."""

    lessons: ExampleSource = ExampleSource.BOTH
    """Training examples: photos with their Phase I lights (teacher), re-rendered photos (synthetic), or both."""
    synthetic_lessons: int = 800
    """Training examples that are re-rendered photos: the asset in the training cameras under known lights."""
    steps: int = 2000
    """Training steps of the illumination MLP, each on one photo."""
    sphere_steps: int = 600
    """Training steps of the sphere network; 0 leaves it out."""
    sphere_width: int = 24
    """Channels of the sphere network at its finest resolution."""
    pretrained: bool = True
    """Start the sphere network from the bundled one, which knows other objects, and end halfway between the
    two; only for a network of its width (24)."""
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
    alpha_rule: AlphaRule = AlphaRule.R4
    """Width of the GGX lobe a pixel is spread by."""
    loss_space: LossSpace = LossSpace.LOG
    """Space of the squared difference."""
    radiance_unit: RadianceUnit = RadianceUnit.LEVEL
    """Unit of the radiance that is compared."""
    solid_angle_weight: bool = True
    """Weigh texels by their solid angles, which differ by a factor of five; else all alike."""
    total_distribution: TotalDistribution = TotalDistribution.MEAN
    """What the weight of a direction, how much of it the sampled pixels saw, is divided by (Equation 6)."""
    checkpoint_every: int = 1000
    """Steps between checkpoints."""
    simulated_photos: int = 24
    """Photos of the object that are simulated at the end, to find how well it tells of its light; 0: none."""

    def __post_init__(self) -> None:
        """Refuse values no run could use."""
        check_values(self, "distill", _LEAST)

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
        light_resolution=32,
        max_side=512,
        pixels_per_photo=16_384,
    )


def paper() -> DistillConfig:
    """The paper's settings (3.2, 4.2), the loss as printed; what it leaves open: docs/paper-preset.md."""
    return replace(
        standard(),
        lessons=ExampleSource.TEACHER,
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


def paper_small() -> DistillConfig:
    """The paper's settings at smaller sizes, with all of its steps."""
    return replace(paper(), light_resolution=32, max_side=200, pixels_per_photo=40_000)
