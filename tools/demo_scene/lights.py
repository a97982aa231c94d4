"""High-dynamic-range environments: kinds computed from scratch, and the few photographed ones of the folder
`hdri`.

Notation: an environment is radiance (H, 2H, 3), linear, any unit; row 0 is straight up (+z), the centre
column looks along +x, azimuth grows to the left: u = 0.5 - atan2(y, x) / 2 pi, v = acos(z) / pi.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from .files import read_exr
from .rooms import room
from .sky import evening, outdoors
from .studio import studio

HEIGHT = 64
_OVERSAMPLING = 4  # every texel is the mean of 4x4 directions, so a lamp smaller than a texel keeps its power
LARGEST = 60000.0  # the largest value stored: half floats end at 65504
PHOTOGRAPHED = tuple(sorted(path.stem for path in Path(__file__).with_name("hdri").glob("*.exr")))


class Kind(StrEnum):
    """Families of places a photo is taken in."""

    OUTDOORS = "outdoors"
    ROOM = "room"
    STUDIO = "studio"
    EVENING = "evening"


_MAKERS: dict[Kind, Callable[[np.ndarray, np.random.Generator], np.ndarray]] = {
    Kind.OUTDOORS: outdoors,
    Kind.ROOM: room,
    Kind.STUDIO: studio,
    Kind.EVENING: evening,
}


@dataclass(frozen=True)
class Light:
    """One environment, before the exposure of a photo."""

    name: str
    shift_degrees: float  # the map's columns were rolled to the right by this angle
    radiance: np.ndarray  # (64, 128, 3) float64 >= 0
    bits: int = 8  # mantissa bits it is rounded to before it lights anything


def directions(height: int) -> np.ndarray:
    """Return the unit direction of every texel centre, (H, 2H, 3)."""
    theta = np.pi * (np.arange(height) + 0.5) / height
    phi = np.pi - 2 * np.pi * (np.arange(2 * height) + 0.5) / (2 * height)
    sin = np.sin(theta)[:, None]
    z = np.broadcast_to(np.cos(theta)[:, None], (height, 2 * height))
    return np.stack([sin * np.cos(phi), sin * np.sin(phi), z], axis=-1)


def solid_angles(height: int) -> np.ndarray:
    """Return the solid angle of the texels of each row, (H, 1); times 2H columns they sum to about 4 pi."""
    theta = np.pi * (np.arange(height) + 0.5) / height
    return (np.sin(theta) * (np.pi / height) ** 2)[:, None]


def reduce_area(radiance: np.ndarray, factor: int) -> np.ndarray:
    """Average `factor` x `factor` texels, weighted by the solid angle of their rows."""
    height, width, channels = radiance.shape
    weight = np.broadcast_to(
        np.sin(np.pi * (np.arange(height) + 0.5) / height)[:, None, None], radiance.shape
    )
    blocks = (height // factor, factor, width // factor, factor, channels)
    total = (radiance * weight).reshape(blocks).sum(axis=(1, 3))
    return total / weight.reshape(blocks).sum(axis=(1, 3))


def luminance(color: np.ndarray) -> np.ndarray:
    """Rec. 709 luminance of linear colours (..., 3)."""
    return color @ np.array([0.2126, 0.7152, 0.0722])


def make_light(kind: Kind, seed: int, index: int) -> Light:
    """Draw environment number `index` of a kind; equal arguments give equal maps."""
    rng = np.random.default_rng([seed, list(Kind).index(kind), index])
    radiance = _MAKERS[kind](directions(HEIGHT * _OVERSAMPLING), rng)
    radiance = reduce_area(radiance, _OVERSAMPLING)
    mean = (radiance * solid_angles(HEIGHT)[..., None]).sum(axis=(0, 1))
    balance = (luminance(mean) / mean) ** 0.6  # what a camera's automatic white balance takes out
    turn = int(rng.integers(2 * HEIGHT))
    tint = np.exp2(rng.normal(0.0, [0.10, 0.04, 0.12]))  # and what it gets wrong
    strength = np.exp2(rng.uniform(-2.0, 2.0))
    turned = np.roll(radiance, turn, axis=1) * balance * tint * strength
    return Light(f"{kind.value}_{index:04d}", turn * 180.0 / HEIGHT, turned)


def photographed_light(name: str, seed: int, index: int) -> Light:
    """Return an environment of `PHOTOGRAPHED` at a turn drawn from `seed` and `index`."""
    radiance = read_exr(Path(__file__).with_name("hdri") / f"{name}.exr", "RGB")
    turn = int(np.random.default_rng([seed, len(Kind), index]).integers(2 * HEIGHT))
    # A photograph's noise does not compress; a light rounded to 1.6 % is as real, and the scene stays small.
    return Light(name, turn * 180.0 / HEIGHT, np.roll(radiance, turn, axis=1), bits=5)
