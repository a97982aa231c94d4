"""Rooms by day and by lamp: a furnished box with windows, seen from the object standing on a table in it.

Lengths are metres, the object is at the origin, z up. Light on a wall is summed over points of the windows
and lamps, without shadows; what makes a room bounce light is a constant.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .noise import fractal_noise, mix
from .sky import unit

_WALLS = np.array(
    [[0.70, 0.66, 0.58], [0.62, 0.64, 0.66], [0.74, 0.72, 0.70], [0.50, 0.58, 0.50], [0.66, 0.50, 0.38]]
)
_FLOORS = np.array(
    [[0.30, 0.17, 0.08], [0.16, 0.085, 0.04], [0.42, 0.40, 0.38], [0.30, 0.07, 0.06], [0.45, 0.33, 0.20]]
)


@dataclass(frozen=True)
class Pane:
    """A window: a rectangle on the wall `axis` = `offset`, glowing inwards."""

    axis: int  # 0 or 1
    offset: float
    low: tuple[float, float]  # along the wall, height
    high: tuple[float, float]
    sky: np.ndarray  # (3,) radiance of its upper part


@dataclass(frozen=True)
class Lamp:
    """A glowing ball."""

    center: np.ndarray
    radius: float
    radiance: np.ndarray  # (3,)


@dataclass(frozen=True)
class Box:
    """A piece of furniture."""

    low: np.ndarray
    high: np.ndarray
    color: np.ndarray  # (3,) reflectance


@dataclass(frozen=True)
class Hit:
    """The first surface along every direction; arrays (H, W) or (H, W, 3)."""

    distance: np.ndarray
    axis: np.ndarray  # 0, 1 or 2: the surface faces along it
    point: np.ndarray
    color: np.ndarray  # reflectance
    on_shell: np.ndarray  # a wall, the floor or the ceiling


def _enter(d: np.ndarray, box: Box) -> tuple[np.ndarray, np.ndarray]:
    """Return where rays from the origin enter a box, inf where they miss it, and along which axis."""
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = box.low / d, box.high / d
    near, far = np.minimum(a, b), np.maximum(a, b)
    enter = near.max(axis=-1)
    return np.where((enter < far.min(axis=-1)) & (enter > 0), enter, np.inf), near.argmax(axis=-1)


def _look(
    d: np.ndarray, half: np.ndarray, floor: float, ceiling: float, boxes: list[Box], rng: np.random.Generator
) -> Hit:
    """Cast rays from the object to the shell of the room and its furniture."""
    with np.errstate(divide="ignore"):
        exits = np.maximum(np.array([*-half, floor]) / d, np.array([*half, ceiling]) / d)
    distance, axis = exits.min(axis=-1), exits.argmin(axis=-1)
    color, on_shell = _surface_color(d * distance[..., None], axis, rng), np.ones(distance.shape, bool)
    for box in boxes:
        enter, face = _enter(d, box)
        near = enter < distance
        distance, axis = np.where(near, enter, distance), np.where(near, face, axis)
        color, on_shell = np.where(near[..., None], box.color, color), on_shell & ~near
    return Hit(distance, axis, d * distance[..., None], color, on_shell)


def _irradiance(
    point: np.ndarray, normal: np.ndarray, panes: list[Pane], lamps: list[Lamp], bounce: np.ndarray
) -> np.ndarray:
    """Light falling on surface points (..., 3): windows as a few point samples each, lamps as points."""
    total = np.broadcast_to(np.pi * bounce, point.shape).copy()
    for pane in panes:
        facing = np.zeros(3)
        facing[pane.axis] = -np.sign(pane.offset)
        (s0, z0), (s1, z1) = pane.low, pane.high
        for s, z in [(s, z) for s in np.linspace(s0, s1, 5)[1::2] for z in np.linspace(z0, z1, 5)[1::2]]:
            at = np.array([s, s, z])
            at[pane.axis] = pane.offset
            total += _from_point(point, normal, at, facing)[..., None] * pane.sky * (s1 - s0) * (z1 - z0) / 4
    for lamp in lamps:
        power = lamp.radiance * np.pi * lamp.radius**2
        total += _from_point(point, normal, lamp.center, None)[..., None] * power
    return total


def _from_point(
    point: np.ndarray, normal: np.ndarray, source: np.ndarray, facing: np.ndarray | None
) -> np.ndarray:
    """Cosines over squared distance from a small source, which is flat when it is `facing` somewhere."""
    way = source - point
    squared = np.maximum((way * way).sum(axis=-1), 0.04)
    way = way / np.sqrt(squared)[..., None]
    cosine = np.clip((way * normal).sum(axis=-1), 0, 1)
    return cosine * (1.0 if facing is None else np.clip(-way @ facing, 0, 1)) / squared


def _furnish(half: np.ndarray, floor: float, ceiling: float, rng: np.random.Generator) -> list[Box]:
    """The table under the object and a few cupboards and shelves along the walls."""
    width, depth = rng.uniform(0.5, 1.2, 2)
    wood = _FLOORS[rng.integers(len(_FLOORS))] * rng.uniform(0.7, 1.5)
    boxes = [Box(np.array([-width, -depth, -0.32]), np.array([width, depth, -0.27]), wood)]
    for _ in range(int(rng.integers(3, 7))):
        axis, side = int(rng.integers(2)), rng.choice([-1.0, 1.0])
        size = np.array([rng.uniform(0.3, 1.0), rng.uniform(0.3, 1.0), 0.0])
        size[axis] = rng.uniform(0.2, 0.6)
        center = np.array([rng.uniform(-1, 1), rng.uniform(-1, 1), 0.0]) * ([*half, 0.0] - size)
        center[axis] = side * (half[axis] - size[axis])
        low, high = center - size, center + size
        low[2], high[2] = floor, floor + rng.uniform(0.5, 0.85 * (ceiling - floor))
        if np.hypot(*center[:2]) > 1.2:
            boxes.append(Box(low, high, rng.uniform(0.04, 0.6) * rng.uniform(0.5, 1.2, 3)))
    return boxes


def _windows(
    half: np.ndarray, floor: float, ceiling: float, day: float, rng: np.random.Generator
) -> list[Pane]:
    panes = []
    axis, side = int(rng.integers(2)), rng.choice([-1.0, 1.0])
    for wall in range(int(rng.integers(1, 3))):
        a = axis if wall == 0 else 1 - axis
        count = int(rng.integers(1, 4))
        sill, top = floor + rng.uniform(0.4, 1.0), ceiling - rng.uniform(0.15, 0.5)
        slots = np.linspace(-half[1 - a], half[1 - a], count + 1)
        sky = mix(np.array([0.75, 0.92, 1.25]), [1.1, 1.0, 0.85], rng.random()) * rng.uniform(4, 14) * day
        for left, right in pairwise(slots):
            gap = 0.22 * (right - left)
            panes.append(Pane(a, float(side * half[a]), (left + gap, sill), (right - gap, top), sky))
    return panes


def _through_window(pane: Pane, along: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where a pane covers wall points, and the radiance seen through it: sky above, ground below, dark bars."""
    (s0, z0), (s1, z1) = pane.low, pane.high
    s, t = (along - s0) / (s1 - s0), (z - z0) / (z1 - z0)
    inside = (s > 0) & (s < 1) & (t > 0) & (t < 1)
    bars = (np.abs(s - 0.5) < 0.03) | (np.abs(t - 0.6) < 0.02)
    view = mix(pane.sky * np.array([0.22, 0.25, 0.16]), pane.sky, np.clip((t - 0.25) * 4, 0, 1))
    return inside, np.where(bars[..., None], 0.1 * pane.sky, view)


def _surface_color(point: np.ndarray, axis: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Reflectance of the shell: plaster walls with pictures, boards on the floor, white ceiling."""
    wall, board = _WALLS[rng.integers(len(_WALLS))], _FLOORS[rng.integers(len(_FLOORS))]
    across = point[..., 0] + point[..., 1]
    plaster = 0.9 + 0.2 * fractal_noise(across, point[..., 2], int(rng.integers(2**31)))
    color = wall * plaster[..., None]
    along = np.where(axis == 0, point[..., 1], point[..., 0])
    for _ in range(int(rng.integers(2, 6))):
        a, side = int(rng.integers(2)), rng.choice([-1.0, 1.0])
        s, z = rng.uniform(-2, 2), rng.uniform(0.0, 0.8)
        w, h = rng.uniform(0.15, 0.5, 2)
        on = (axis == a) & (np.sign(point[..., a]) == side)
        on = on & (np.abs(along - s) < w) & (np.abs(point[..., 2] - z) < h)
        color = np.where(on[..., None], rng.uniform(0.02, 0.6, 3), color)
    seed = int(rng.integers(2**31))
    planks = 0.75 + 0.5 * fractal_noise(np.floor(point[..., 1] * 8) * 7.3, point[..., 0] * 0.7, seed)
    flat = np.where((point[..., 2] < 0)[..., None], board * planks[..., None], 0.75)
    return np.where((axis == 2)[..., None], flat, color)


def _sunbeam(hit: Hit, normal: np.ndarray, panes: list[Pane], rng: np.random.Generator) -> np.ndarray:
    """Radiance of the bright patches where the sun, coming through a window, falls on a surface."""
    sun = unit(rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(15, 50)))
    facing = np.clip(normal @ sun, 0, 1)
    lit = np.zeros(facing.shape)
    for pane in panes:
        if sun[pane.axis] * pane.offset > 0.05:
            way = (pane.offset - hit.point[..., pane.axis]) / sun[pane.axis]
            leaving = hit.point + way[..., None] * sun
            inside, _ = _through_window(pane, leaving[..., 1 - pane.axis], leaving[..., 2])
            lit = np.maximum(lit, inside * (way > 0.02) * facing)
    return lit[..., None] * hit.color * np.array([1.0, 0.9, 0.72]) * 45.0 / np.pi


def _lamps(half: np.ndarray, ceiling: float, day: float, rng: np.random.Generator) -> list[Lamp]:
    lamps = []
    for _ in range(int(rng.integers(1, 5)) if day < 0.5 else int(rng.integers(0, 3))):
        center = np.array([*(rng.uniform(-0.85, 0.85, 2) * half), rng.uniform(0.2, ceiling - 0.1)])
        if np.linalg.norm(center) < 0.8:
            center[2] = ceiling - 0.1
        warm = mix(np.array([1.0, 0.60, 0.27]), [1.0, 0.86, 0.66], rng.random())
        lamps.append(Lamp(center, rng.uniform(0.05, 0.16), warm * rng.uniform(25, 110)))
    return lamps


def room(d: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the radiance (H, W, 3) around an object on a table in a random room, by day or by night."""
    day = float(rng.choice([0.02, rng.uniform(0.3, 1.0)], p=[0.3, 0.7]))
    half = rng.uniform(1.6, 4.0, 2)
    floor, ceiling = -1.05, rng.uniform(1.2, 2.2)
    panes, lamps = _windows(half, floor, ceiling, day, rng), _lamps(half, ceiling, day, rng)
    hit = _look(d, half, floor, ceiling, _furnish(half, floor, ceiling, rng), rng)
    normal = -np.sign(d) * np.eye(3)[hit.axis]
    bounce = (
        np.full(3, 0.05)
        + 0.02 * sum(pane.sky for pane in panes)
        + 0.0015 * sum(lamp.radiance for lamp in lamps)
    )
    radiance = hit.color * _irradiance(hit.point, normal, panes, lamps, bounce) / np.pi
    if day > 0.4 and rng.random() < 0.6:
        radiance = radiance + _sunbeam(hit, normal, panes, rng)
    for pane in panes:
        inside, view = _through_window(pane, hit.point[..., 1 - pane.axis], hit.point[..., 2])
        same_side = np.sign(hit.point[..., pane.axis]) == np.sign(pane.offset)
        on = inside & hit.on_shell & (hit.axis == pane.axis) & same_side
        radiance = np.where(on[..., None], view, radiance)
    for lamp in lamps:
        along = d @ lamp.center
        miss = np.linalg.norm(lamp.center) ** 2 - along**2
        on = (along > 0) & (along < hit.distance) & (miss < lamp.radius**2)
        radiance = np.where(on[..., None], lamp.radiance, radiance)
    return radiance
