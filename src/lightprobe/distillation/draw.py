"""Random numbers, directions and colours of generated lights and objects.

Notation: d (M, 3) unit directions. What is drawn, colours and directions (3,), is on the CPU, whatever device
d is on: decisions that hang on it need not wait for a GPU.
"""

import math
from collections.abc import Sequence
from typing import TypeVar

import torch
from torch import Tensor

from lightprobe.core.device import to_device

Item = TypeVar("Item")


def beside(drawn: Tensor, values: Tensor) -> Tensor:
    """Return a tensor of any shape on the device of `values`; what was drawn is sent without waiting."""
    return drawn if drawn.device == values.device else to_device(drawn, values.device)


def upright(up: Tensor, azimuth: float) -> Tensor:
    """Return the rotation (3, 3) that brings `up` (3,) to +z and turns by `azimuth` radians about it."""
    third = torch.nn.functional.normalize(up.float(), dim=0)
    helper = torch.eye(3)[int(third.abs().argmin())]
    first = torch.nn.functional.normalize(torch.linalg.cross(helper, third), dim=0)
    second = torch.linalg.cross(third, first)
    c, s = math.cos(azimuth), math.sin(azimuth)
    return torch.stack([c * first + s * second, c * second - s * first, third])


class Draw:
    """Random numbers of one light."""

    def __init__(self, random: torch.Generator):
        self.random = random

    def uniform(self, low: float, high: float) -> float:
        """Return a number in [low, high)."""
        return low + (high - low) * float(torch.rand((), generator=self.random))

    def scale(self, low: float, high: float) -> float:
        """Return a number in [low, high) that is uniform in its logarithm."""
        return math.exp(self.uniform(math.log(low), math.log(high)))

    def count(self, low: int, high: int) -> int:
        """Return a whole number from low to high."""
        return int(torch.randint(low, high + 1, (), generator=self.random))

    def normal(self, *shape: int) -> Tensor:
        """Return standard normal numbers of any shape."""
        return torch.randn(shape, generator=self.random)

    def choice(self, items: Sequence[Item], shares: Sequence[float]) -> Item:
        """Return one of the items, as often as its share."""
        return items[int(torch.multinomial(torch.tensor(shares), 1, generator=self.random))]

    def direction(self) -> Tensor:
        """Return a direction (3,), all equally likely."""
        return torch.nn.functional.normalize(self.normal(3), dim=0)

    def towards(self, lowest: float, highest: float) -> Tensor:
        """Return a direction (3,) at a random azimuth, its elevation between two angles in degrees."""
        azimuth, elevation = self.uniform(0, 2 * math.pi), math.radians(self.uniform(lowest, highest))
        flat = math.cos(elevation)
        return torch.tensor([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)])

    def paint(self, darkest: float, brightest: float, saturation: float) -> Tensor:
        """Return a reflectance or light colour (3,)."""
        hue = self.normal(3) * saturation
        return self.scale(darkest, brightest) * torch.exp(hue - hue.mean())

    def white(self, warm: float) -> Tensor:
        """Return the colour (3,) of a lamp or sky, from daylight to warmer by up to `warm`."""
        w = self.uniform(-0.15, 1) * warm
        return torch.exp(torch.tensor([0.45, 0.0, -0.75]) * w)

    def noise(self, d: Tensor, frequency: float, waves: int = 10) -> Tensor:
        """Return smooth noise (M,) over the directions, mean 0, deviation near 1, details down to
        1/frequency.

        A sum of plane waves through the sphere, slow ones stronger.
        """
        length = torch.exp(torch.linspace(math.log(1.5), math.log(frequency), waves))
        wave = torch.nn.functional.normalize(self.normal(waves, 3), dim=1) * length[:, None]
        phase = 2 * math.pi * torch.rand(waves, generator=self.random)
        strength = length**-0.6
        strength = strength / strength.square().sum().sqrt() * math.sqrt(2)
        return torch.sin(d @ beside(wave, d).T + beside(phase, d)) @ beside(strength, d)
