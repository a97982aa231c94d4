"""Configuration of predictions and its presets; kept with a run, changed by options."""

import math
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from typing import Any

from lightprobe.core.config.stored import LIGHT_RESOLUTIONS, config_from_json
from lightprobe.core.errors import ConfigError


class Method(StrEnum):
    """How the light is found."""

    CONSTANT = "constant"
    """A grey map at the photo's light level: the floor."""
    PROBE_MLP = "probe-mlp"
    """The paper's method: the illumination MLP's probes, stacked."""
    PROBE_NET = "probe-net"
    """The sphere network on stacked probes and coarse least-squares lights."""
    OPTIMIZE = "optimize"
    """Gradient descent on every texel for this one photo, as inverse renderers do: 15 s to minutes."""
    PROBE_NET_OPTIMIZE = "probe-net+optimize"
    """A few steps of the same descent from the sphere network's map."""
    SOLVE = "solve"
    """Least squares against the photo, towards the grey map."""
    PROBE_MLP_SOLVE = "probe-mlp+solve"
    """Least squares against the photo, towards the paper's map."""
    PROBE_NET_SOLVE = "probe-net+solve"
    """Least squares against the photo, towards the sphere network's map."""

    @classmethod
    def offered(cls) -> list["Method"]:
        """Return the methods that --help names; the others are for comparisons, and work when typed."""
        return [method for method in cls if method not in (cls.PROBE_MLP_SOLVE, cls.PROBE_NET_SOLVE)]


class Sun(StrEnum):
    """Where a light's suns and lamps go when it is written."""

    INSIDE = "inside"
    """The map has them."""
    SEPARATE = "separate"
    """The map is without them; they stand beside it, as lamps."""

    def check(self, sought: bool) -> None:
        """Raise `ConfigError` where they are to be kept out of a map without having been `sought`."""
        if self is Sun.SEPARATE and not sought:
            raise ConfigError("'sun' cannot be separate where sources, suns and lamps, are not looked for.")


@dataclass(frozen=True)
class PredictConfig:
    """How the light of a new photo is predicted."""

    method: Method | None = None
    """The method used where none is asked for; none is the best that the run is trained for."""
    light_resolution: int = 32
    """Texels along each cubemap edge of the predicted maps."""
    max_pixels: int = 65_536
    """Photos with more object pixels are reduced by area averaging."""
    sampled_share: float = 0.25
    """Share of the object's pixels that become light probes."""
    unseen_share: float = 0.02
    """Weight of the mean light of the training examples in the stacked map, relative to the mean weight of the
    probes; it fills in directions at which hardly a pixel looks, and 0 leaves them as they are, black where
    no probe reaches."""

    def __post_init__(self) -> None:
        """Refuse values no prediction could use."""
        if self.light_resolution not in LIGHT_RESOLUTIONS:
            raise ConfigError(
                f"light_resolution must be a power of two from 8 to 256, not {self.light_resolution}."
            )
        if self.max_pixels < 1:
            raise ConfigError(f"max_pixels must be at least 1, not {self.max_pixels}.")
        if not 0 < self.sampled_share <= 1:
            raise ConfigError(f"sampled_share must be above 0 and at most 1, not {self.sampled_share}.")
        if not 0 <= self.unseen_share < math.inf:
            raise ConfigError(f"unseen_share must be 0 or more and finite, not {self.unseen_share}.")

    @staticmethod
    def from_json(value: dict[str, Any]) -> "PredictConfig":
        """Return the configuration written as JSON."""
        return config_from_json(PredictConfig, value, "configuration of predictions")


@dataclass(frozen=True)
class SolveConfig:
    """Cost of a solve."""

    pixels: int = 3072
    """Pixels the factor is solved from."""
    fitted_pixels: int = 1536
    """The same while its strength is chosen."""
    judging_pixels: int = 768
    """Held-out pixels that choose it."""


@dataclass(frozen=True)
class OptimizeConfig:
    """Cost and steps of the optimisation."""

    iterations: int = 1500
    """Adam steps."""
    learning_rate: float = 0.05
    """Adam step in log radiance at the start; it falls to nothing along a cosine."""
    smooth_learning_rate: float = 0.0
    """The same of the smooth and the broad part of the change, on 6 x 8 x 8 and 6 x 2 x 2 texels."""
    damping: float = 0.0
    """How large a gradient, relative to the usual one, makes half a step."""
    broad_damping: float = 0.0
    """The same of the broad part."""
    pixels: int = 12_288
    """Pixels the light is fitted to."""
    batch: int = 0
    """About how many of them each step looks at, others at the next; 0: all."""
    grey: float = 0.005
    """Weight of the mean deviation of the light from grey."""

    def __post_init__(self) -> None:
        """Refuse values no optimisation could use."""
        if self.iterations < 1 or self.pixels < 1 or not self.learning_rate > 0:
            raise ConfigError(
                "An optimisation needs iterations and pixels of at least 1 and a positive step."
            )
        if min(self.smooth_learning_rate, self.damping, self.broad_damping, self.grey, self.batch) < 0:
            raise ConfigError("An optimisation needs weights and a batch of at least 0.")


def refinement() -> OptimizeConfig:
    """Return a tenth of a second of it, for where a network has gone most of the way."""
    return OptimizeConfig(
        iterations=60,
        learning_rate=0.1,
        smooth_learning_rate=0.2,
        damping=0.3,
        broad_damping=0.1,
        pixels=3072,
        batch=256,
    )


@dataclass(frozen=True)
class PredictionOptions:
    """What a command changes of a run's `PredictConfig`; None stays as the run has it."""

    light_resolution: int | None = None
    """Texels along each cubemap edge of the maps, a power of two; by default what the run was trained with."""
    max_pixels: int | None = None
    """Photos with more object pixels are reduced; by default what the run was trained with."""
    sampled_share: float | None = None
    """Share of the object's pixels that become light probes; by default what the run was trained with."""
    unseen_share: float | None = None
    """Weight of the usual light where hardly a pixel looks; by default what the run was trained with."""

    def over(self, config: PredictConfig) -> PredictConfig:
        """Return a configuration with what was given in its place; raise `ConfigError` if unusable."""
        return replace(config, **self.given())

    def given(self) -> dict[str, Any]:
        """Return what was given, by name."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: value for name, value in values.items() if value is not None}


UNCHANGED = PredictionOptions()


def quick() -> PredictConfig:
    """Well under a second on two CPU cores."""
    return PredictConfig()


def standard() -> PredictConfig:
    """The same: its lights hold no more detail."""
    return quick()


def paper() -> PredictConfig:
    """The paper's single step (sections 3.2.3 and 4.2): probes alone, on 6x128x128 texels, nothing filled in."""
    return replace(
        quick(), method=Method.PROBE_MLP, light_resolution=128, max_pixels=1_048_576, unseen_share=0.0
    )


def paper_small() -> PredictConfig:
    """The paper's single step onto the smaller maps of its smaller settings."""
    return replace(paper(), light_resolution=32)
