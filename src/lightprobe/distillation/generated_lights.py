"""Plausible lights without a single photo: outdoors by time of day, overcast, rooms, studios and night.

They stand in for the places a photo may be taken in when a predictor of light is trained. None is a copy of a
real place; what they share with real ones is what a predictor can use: light comes from above, grounds are
dull, suns are small and thousands of times brighter than their sky, rooms are boxes whose walls answer their
windows.

Notation: d (M, 3) unit directions with z up in the place's own frame; radiance (M, 3) linear. The whole map
is scaled to a mean of 1 before its exposure, so that families do not differ in brightness.
"""

import math
from collections.abc import Callable
from enum import StrEnum

import torch
from torch import Tensor

from lightprobe.core.device import generator
from lightprobe.distillation.draw import Draw, beside, upright
from lightprobe.light import cubemap
from lightprobe.light.resize import resize_light

_OVERSAMPLING = 2  # per texel edge: small lamps keep their energy
_LARGEST = 6e4  # radiance; half floats end soon after
_SUN_DEGREES = 1.5  # radius of a sun: larger than true and dimmer by as much, for it has to fill a sample


class Place(StrEnum):
    """Families of lights."""

    SUN = "sun"
    """Clear or broken sky, sun from the horizon to the zenith."""
    OVERCAST = "overcast"
    """Grey sky, brighter overhead."""
    ROOM = "room"
    """A box with windows or lamps."""
    STUDIO = "studio"
    """Soft boxes before a backdrop."""
    NIGHT = "night"
    """Street lamps and lit windows under a dark sky."""


_SHARES = {Place.SUN: 0.3, Place.OVERCAST: 0.12, Place.ROOM: 0.26, Place.STUDIO: 0.22, Place.NIGHT: 0.1}


def generated_light(
    resolution: int,
    *,
    seed: int,
    step: int = 0,
    up: Tensor | None = None,
    turn: float = 0.0,
    tumbled: float = 0.1,
    place: Place | None = None,
    device: torch.device | None = None,
) -> Tensor:
    """Return a light (6, R, R, 3) float32, linear, finite and >= 0, with a mean near 1; equal arguments,
    equal bits.

    up: (3,) the direction that is up for the object, by default +z; every light is turned about it at random.
    turn: radians by which one that is not tumbled is turned further, anticlockwise as seen from above.
    tumbled: share of the lights that are turned any way instead, for objects photographed lying.
    place: the family, by default a random one.
    device: where it is made, by default the CPU; bits are equal on one device only.
    """
    draw = Draw(generator(seed, "generated-light", step))
    chosen = place or draw.choice(list(_SHARES), list(_SHARES.values()))
    upwards = torch.tensor([0.0, 0.0, 1.0]) if up is None else up.cpu()
    world = draw.direction() if draw.uniform(0, 1) < tumbled else upwards
    rotation = upright(world, draw.uniform(0, 2 * math.pi) + turn)
    fine = cubemap.directions(_OVERSAMPLING * resolution, device or torch.device("cpu")).reshape(-1, 3)
    radiance = _MAKERS[chosen](fine @ beside(rotation, fine).T, draw).clamp(min=0)
    side = _OVERSAMPLING * resolution
    light = resize_light(radiance.reshape(6, side, side, 3).contiguous(), resolution)
    mean = cubemap.sphere_mean(light).clamp(min=1e-9)
    balance = (mean.mean() / mean) ** draw.uniform(0.3, 0.9)  # what a camera's white balance takes out
    tint = torch.exp(draw.normal(3) * torch.tensor([0.08, 0.04, 0.10]))  # and what it gets wrong
    exposure = math.exp(0.5 * float(draw.normal(1)))
    return (light / mean.mean() * balance * beside(tint, light) * exposure).clamp(0, _LARGEST)


def _step(low: float, high: float, x: Tensor) -> Tensor:
    """Return a smooth ramp from 0 at `low` to 1 at `high`; falling when low > high."""
    t = ((x - low) / (high - low)).clamp(0, 1)
    return t * t * (3 - 2 * t)


def _disc(d: Tensor, towards: Tensor, degrees: float) -> Tensor:
    """Return the mask (M, 1) of a soft-edged disc of an angular radius."""
    angle = torch.rad2deg(torch.arccos((d @ beside(towards, d)).clamp(-1, 1)))
    return _step(1.2 * degrees, 0.8 * degrees, angle)[:, None]


def _panel(d: Tensor, towards: Tensor, turn: float, width: float, height: float) -> Tensor:
    """Return the mask (M, 1) of a flat rectangle facing the object, of half sizes at distance 1."""
    x, y, z = (d @ beside(upright(towards, turn), d).T).unbind(1)
    depth = z.clamp(min=1e-3)
    inside = _step(1.1, 0.95, (x / depth).abs() / width) * _step(1.1, 0.95, (y / depth).abs() / height)
    return (inside * (z > 0))[:, None]


def _ground(d: Tensor, draw: Draw, falling: Tensor) -> Tensor:
    """Return a ground (M, 3) that reflects the irradiance `falling` (3,)."""
    patches = torch.exp(draw.uniform(0.05, 0.4) * draw.noise(d / (0.3 + d[:, 2:].abs()), 12))[:, None]
    return beside(draw.paint(0.06, 0.5, 0.1), d) * beside(falling, d) / math.pi * patches


def _mean_above(d: Tensor, radiance: Tensor) -> Tensor:
    """Return the mean radiance (3,) of the upper half."""
    return radiance[d[:, 2] > 0].mean(0)


def _skyline(d: Tensor, draw: Draw) -> Tensor:
    """Return the mask (M, 1) of hills, trees or houses around."""
    around = torch.nn.functional.normalize(d * d.new_tensor([1.0, 1.0, 0.0]), dim=1)
    ragged = draw.noise(around, draw.scale(2, 25))
    top = draw.uniform(-0.1, 0.35) + draw.uniform(0.02, 0.2) * ragged
    return (_step(0.02, -0.02, d[:, 2] - top.clamp(min=0)) * _step(-0.03, 0.01, d[:, 2]))[:, None]


def _outdoors(d: Tensor, draw: Draw, sky: Tensor, sun: Tensor, sunlight: Tensor) -> Tensor:
    """Return a `sky` (M, 3) over a ground and a skyline that the sky and a `sun` (3,) light."""
    diffuse = math.pi * _mean_above(d, sky)
    sunlight, height = beside(sunlight, d), float(sun[2].clamp(min=0))
    falling = diffuse + sunlight * height
    radiance = torch.lerp(_ground(d, draw, falling), sky, _step(-0.02, 0.02, d[:, 2])[:, None])
    level = d * d.new_tensor([1.0, 1.0, 0.0])
    facing = (-level @ beside(sun, d)).clamp(min=0)[:, None]  # the lit side, seen opposite the sun
    leaf = torch.exp(0.4 * draw.noise(d, 20))[:, None]
    standing = beside(draw.paint(0.05, 0.4, 0.2), d) * leaf * (0.5 * diffuse + facing * sunlight) / math.pi
    return torch.lerp(radiance, standing, _skyline(d, draw))


def _sun(d: Tensor, draw: Draw) -> Tensor:
    sun = draw.towards(-3, 25) if draw.uniform(0, 1) < 0.45 else draw.towards(20, 75)
    height = math.degrees(math.asin(float(sun[2])))
    haze, z = draw.scale(0.5, 2.5), d[:, 2:].clamp(min=0)
    mass = 1 / max(math.sin(math.radians(max(height, 1.0))), 0.03)
    color = torch.exp(-min(mass, 25) * haze * d.new_tensor([0.05, 0.09, 0.17]))
    toward = (d @ beside(sun, d))[:, None].clamp(-1, 1)
    low = max(0.0, 1 - max(height, 0) / 20)
    sky = torch.lerp(
        d.new_tensor([0.16, 0.3, 0.62]), d.new_tensor([0.6, 0.68, 0.78]), torch.exp(-z / (0.12 * haze))
    )
    sky = sky * (1 - 0.75 * low)
    warm = low * torch.exp(-z / 0.25) * (0.5 + 0.5 * toward) ** 3
    sky = sky + warm * d.new_tensor([1.2, 0.55, 0.22]) + color * haze * 0.8 * torch.exp((toward - 1) / 0.02)
    cover = draw.uniform(0, 1) ** 1.5
    cloud = _step(1.2 - 2.2 * cover, 1.8 - 2.2 * cover, draw.noise(d / (0.35 + z), 7))[:, None] * _step(
        0, 0.15, z
    )
    bright = (
        draw.uniform(0.6, 1.6) * (0.3 + 0.7 * (1 - low))
        + color * draw.uniform(0.3, 2) * toward.clamp(min=0) ** 4
    )
    sky = torch.lerp(sky, bright.expand_as(sky), cloud)
    shown = float(1 - 0.97 * draw.uniform(0, 1) * (draw.uniform(0, 1) < cover)) * min(
        max((height + 1) / 2, 0), 1
    )
    sunlight = color * draw.uniform(6, 14) * shown
    size = math.pi * math.radians(_SUN_DEGREES) ** 2
    return _outdoors(d, draw, sky, sun, sunlight) + _disc(d, sun, _SUN_DEGREES) * sunlight / size


def _overcast(d: Tensor, draw: Draw) -> Tensor:
    z = d[:, 2:].clamp(min=0)
    sun = draw.towards(10, 80)
    glow = draw.uniform(0, 3) * torch.exp(((d @ beside(sun, d))[:, None] - 1) / draw.uniform(0.03, 0.3))
    layers = torch.exp(draw.uniform(0.05, 0.35) * draw.noise(d / (0.35 + z), 8))[:, None]
    sky = (draw.uniform(0.3, 1) + z + glow) * layers * beside(draw.white(0.5), d)
    return _outdoors(d, draw, sky, sun, d.new_zeros(3))


def _room(d: Tensor, draw: Draw) -> Tensor:
    size = torch.tensor([[draw.scale(1, 6), draw.scale(1, 6), draw.scale(0.9, 3)] for _ in range(2)])
    ahead, behind = beside(size, d)
    # Along d to the wall, floor or ceiling.
    reach = torch.where(d > 0, ahead, behind) / d.abs().clamp(min=1e-4)
    distance, axis = reach.min(1)
    side = 2 * axis + (d.gather(1, axis[:, None])[:, 0] < 0)
    walls = draw.paint(0.2, 0.8, 0.12) * torch.exp(0.1 * draw.normal(6, 3))
    walls[4] = draw.paint(0.5, 0.9, 0.04)
    walls[5] = draw.paint(0.06, 0.5, 0.3)
    point = d * distance[:, None]
    lit, lamps = torch.full_like(d, draw.scale(0.02, 0.2)), torch.zeros_like(d)
    mostly_day = draw.uniform(0, 1) < 0.65
    day = draw.scale(3, 40) if mostly_day else draw.scale(0.02, 0.5)
    for _ in range(draw.count(1, 4)):
        towards = draw.towards(-5, 25)
        color = beside(day * draw.white(0.5) * torch.tensor([0.85, 0.97, 1.1]), d)
        width, height = draw.scale(0.12, 0.6), draw.scale(0.15, 0.6)
        view = (
            color * torch.exp(0.4 * draw.noise(d, 12))[:, None] * (0.35 + 0.65 * _step(-0.15, 0.1, d[:, 2:]))
        )
        lamps = torch.maximum(lamps, _panel(d, towards, 0.0, width, height) * view)
        source = towards * float(size.mean())
        falling = (point - beside(source, d)).square().sum(1, keepdim=True).clamp(min=0.1)
        lit = lit + color * width * height * 0.7 * float(size.mean()) ** 2 / falling / math.pi
    for _ in range(draw.count(0, 2) if mostly_day else draw.count(1, 5)):
        towards, degrees = draw.towards(5, 85), draw.scale(1.5, 8)
        color = beside(draw.scale(20, 300) * draw.white(1.0), d)
        lamps = torch.maximum(lamps, _disc(d, towards, degrees) * color)
        source = towards * draw.uniform(0.7, 2)
        falling = (point - beside(source, d)).square().sum(1, keepdim=True).clamp(min=0.1)
        lit = lit + color * math.radians(degrees) ** 2 * float(source.square().sum()) / falling
    texture = torch.exp(draw.uniform(0.1, 0.6) * draw.noise(point / float(size.mean()), 14))[:, None]
    return torch.maximum(beside(walls, d)[side] * lit * texture, lamps)


def _studio(d: Tensor, draw: Draw) -> Tensor:
    backdrop = beside(draw.paint(0.01, 0.6, 0.15), d) * (1 + draw.uniform(-0.5, 0.5) * d[:, 2:])
    clutter = torch.exp(draw.uniform(0.05, 0.9) * draw.noise(d, 10))[:, None]
    floor = torch.lerp(
        backdrop, beside(draw.paint(0.02, 0.9, 0.1), d).expand_as(d), _step(0.02, -0.1, d[:, 2:])
    )
    radiance = floor * clutter
    for _ in range(draw.count(1, 6)):
        color = draw.scale(4, 150) * draw.white(0.5)
        if draw.uniform(0, 1) < 0.12:
            color = color * draw.paint(1, 1.01, 0.6)  # a gel
        towards, turn = draw.towards(-5, 80), draw.uniform(0, math.pi)
        if draw.uniform(0, 1) < 0.7:
            shape = _panel(d, towards, turn, draw.scale(0.05, 0.6), draw.scale(0.1, 0.8))
        else:
            shape = _disc(d, towards, draw.scale(2, 18))
        radiance = torch.maximum(radiance, shape * beside(color, d))
    return radiance


def _night(d: Tensor, draw: Draw) -> Tensor:
    z = d[:, 2:].clamp(min=0)
    sky = (
        draw.scale(0.002, 0.3)
        * d.new_tensor([0.5, 0.65, 1.2])
        * (1 + draw.uniform(0, 3) * torch.exp(-z / 0.2))
    )
    lamps, falling = torch.zeros_like(d), torch.full((3,), 0.02)
    for _ in range(draw.count(2, 14)):
        towards, degrees = draw.towards(-3, 50), draw.scale(0.7, 4)
        color = draw.scale(30, 2000) * draw.white(1.2)
        glow = 0.003 * torch.exp(((d @ beside(towards, d))[:, None] - 1) / 0.01)
        lamps = torch.maximum(lamps, (_disc(d, towards, degrees) + glow) * beside(color, d))
        falling = falling + color * math.pi * math.radians(degrees) ** 2 * float(towards[2].clamp(min=0.1))
    street = _outdoors(d, draw, sky, draw.towards(0, 20), 0.5 * falling)
    return street + _ground(d, draw, falling) * (d[:, 2:] < 0) + lamps


_MAKERS: dict[Place, Callable[[Tensor, Draw], Tensor]] = {
    Place.SUN: _sun,
    Place.OVERCAST: _overcast,
    Place.ROOM: _room,
    Place.STUDIO: _studio,
    Place.NIGHT: _night,
}
