"""Places to carry the object to: a table in a furnished room, in a hall or in the open, with a light of its own.

A place is built in the object's frame: what is turned and shifted from place to place is all that stands around the
object. Lengths are radii of the object, about 22 cm; the table's top is the plane z = `height` under the object.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from demo_scene.lights import PHOTOGRAPHED, make_light, photographed_light
from demo_scene.lights import Kind as LightKind
from demo_scene.noise import mix

from . import materials
from .models import Painter, Part, pose_of
from .shapes import bar, disc, rounded_box, sheet, superquadric, turned

_FLOOR = -3.4  # below the table's top
_SUN = 400.0  # peak over mean of a sky with an unclouded sun
_TABLES: tuple[Callable[[np.random.Generator], Painter], ...] = (
    materials.planks,
    materials.newspaper,
    materials.slabs,
    lambda rng: materials.patterned(materials.Kind.CLOTH, rng, 0.9),
)


_WALLS: tuple[Callable[[np.random.Generator, np.ndarray], Painter], ...] = (
    lambda rng, color: materials.slabs(rng, 1.4),
    lambda rng, color: materials.plain(materials.Kind.STONE, rng, color),
    lambda rng, color: materials.plain(materials.Kind.PAINT, rng, color),
)


class Kind(StrEnum):
    """Kinds of places."""

    ROOM = "room"
    HALL = "hall"  # a photographed light beyond a floor and a few panels
    YARD = "yard"  # under a computed sky
    SUN = "sun"  # a yard whose sun is out


@dataclass(frozen=True)
class Lamp:
    """A window, a quad placed by `pose` with a picture (H, W, 3) of what it shows, or a ball of radiance (3,)."""

    pose: np.ndarray
    radiance: np.ndarray
    radius: float = 0.0  # 0: a window


@dataclass(frozen=True)
class Place:
    """What stands around the object, and what lights it."""

    name: str
    support: list[Part]
    surroundings: list[Part]
    lamps: list[Lamp]
    sky: np.ndarray | None  # environment (H, 2H, 3)
    pose: np.ndarray  # (4, 4) of the table's centre, on its top


def make_place(kind: Kind, number: int, height: float, footprint: float, seed: int) -> Place:
    """Return a place; footprint: radius in which the object touches the plane z = `height`; it is on the table."""
    rng = np.random.default_rng([seed, 2, number])
    half = max(rng.uniform(2.2, 3.4), footprint + 1.0)
    away, direction = rng.uniform(0, half - footprint - 0.6), rng.uniform(0, 2 * np.pi)
    shift = away * np.cos(direction), away * np.sin(direction), height
    pose, round_ = pose_of(shift, rng.uniform(0, 2 * np.pi)), rng.random() < 0.6
    paint = _TABLES[(number + seed) % len(_TABLES)](rng)
    if round_:
        top = turned((0, -0.2), (half, -0.2), (half, 0), segments=64) + disc(half)
    else:
        top = rounded_box((half, half - rng.uniform(0, 0.5), 0.1), 0.04)
    table = [Part(top, paint, pose_of((0, 0, 0.0 if round_ else -0.1)))]
    leg = materials.plain(materials.Kind.WOOD, rng)
    around = [Part(bar((0, 0, _FLOOR), (0, 0, -0.15), 0.3), leg, np.eye(4))]
    lamps: list[Lamp] = []
    sky = None
    if kind is Kind.ROOM:
        parts, lamps = _room(rng)
        around += parts
    elif kind is Kind.HALL:
        around += _hall(rng)
        sky = photographed_light(PHOTOGRAPHED[number % len(PHOTOGRAPHED)], seed, number).radiance
    else:
        around += _yard(rng)
        sky = _sky(kind, seed, number)
    lamps = [Lamp(pose @ lamp.pose, lamp.radiance, lamp.radius) for lamp in lamps]
    table, around = ([part.moved(pose) for part in parts] for parts in (table, around))
    return Place(f"{kind.value}_{number:02d}", table, around, lamps, sky, pose)


def _sky(kind: Kind, seed: int, number: int) -> np.ndarray:
    """Return the first of the computed skies in which the sun is out, or is not."""
    for index in range(64):
        sky = make_light(LightKind.OUTDOORS, seed, 64 * number + index).radiance
        peak = sky.max() / sky.mean()
        if (peak > _SUN) if kind is Kind.SUN else (peak < _SUN / 4):
            break
    return sky


def _panel(
    half_width: float, half_height: float, paint: Painter, at: tuple[float, ...], azimuth: float
) -> Part:
    """An upright sheet whose painter sees it over [-1, 1] in x and z; it faces the azimuth."""

    def stretched(points: np.ndarray) -> materials.Material:
        return paint(points / np.array([half_width, 1.0, half_height]))

    shape = sheet((half_width, 0, 0), (0, 0, half_height))
    return Part(shape, stretched, pose_of(at, azimuth + np.pi / 2))


def _walls(rng: np.random.Generator, half: np.ndarray, ceiling: float) -> list[Part]:
    """Floor, ceiling and four walls of paint, paper or bricks."""
    paint = _WALLS[rng.integers(len(_WALLS))](rng, mix(np.full(3, 0.6), materials.vivid(rng), 0.3))
    parts, tall = [], (ceiling - _FLOOR) / 2
    for k in range(4):
        azimuth, reach, width = np.pi / 2 * k, half[k % 2], half[1 - k % 2]
        at = reach * np.cos(azimuth), reach * np.sin(azimuth), (_FLOOR + ceiling) / 2
        parts.append(Part(sheet((width, 0, 0), (0, 0, tall)), paint, pose_of(at, azimuth - np.pi / 2)))
    white = materials.plain(materials.Kind.PAINT, rng, np.full(3, 0.7))
    parts.append(Part(sheet((half[0], 0, 0), (0, -half[1], 0)), white, pose_of((0, 0, ceiling))))
    floor = materials.planks(rng, 0.8) if rng.random() < 0.5 else materials.slabs(rng, 2.0)
    return [*parts, Part(sheet((half[0], 0, 0), (0, half[1], 0), 4), floor, pose_of((0, 0, _FLOOR)))]


def _window(
    at: tuple[float, ...], azimuth: float, size: tuple[float, float], rng: np.random.Generator
) -> Lamp:
    """A window that shines towards the opposite of the azimuth it stands at: sky over trees, between dark bars."""
    s, t = np.meshgrid(np.linspace(0, 1, 32), np.linspace(1, 0, 32))
    sky = mix(np.array([0.75, 0.92, 1.25]), [1.1, 1.0, 0.85], rng.random()) * rng.uniform(4, 14)
    outside = np.where(
        (t > 0.3 + 0.15 * np.sin(9 * s))[..., None], sky, 0.25 * sky * np.array([0.8, 1.0, 0.6])
    )
    bars = (
        (np.abs(s - 0.5) < 0.04)
        | (np.abs(t - 0.6) < 0.03)
        | (np.minimum(s, t) < 0.03)
        | (np.maximum(s, t) > 0.97)
    )
    upright = pose_of(at, azimuth - np.pi / 2) @ pose_of(turn=np.pi / 2, axis=(1, 0, 0))
    return Lamp(upright @ np.diag([*size, 1.0, 1.0]), np.where(bars[..., None], 0.02 * sky, outside))


def _room(rng: np.random.Generator) -> tuple[list[Part], list[Lamp]]:
    """A closed room with windows in one or two walls, lamps, posters and bookshelves."""
    half, ceiling = rng.uniform(11, 16, 2), rng.uniform(7.0, 8.5)
    parts, lamps, day = _walls(rng, half, ceiling), [], rng.random() < 0.75
    glazed = rng.permutation(4)[: int(rng.integers(1, 3)) * day]
    for k in range(4):
        azimuth, reach, width = np.pi / 2 * k, half[k % 2], half[1 - k % 2]
        out, along = (
            np.array([np.cos(azimuth), np.sin(azimuth)]),
            np.array([-np.sin(azimuth), np.cos(azimuth)]),
        )
        for slot in np.linspace(-0.62, 0.62, 3) * width:
            x, y = (reach - 0.1) * out + slot * along
            if k in glazed:
                lamps.append(_window((x, y, 2.6), azimuth, (0.22 * width, rng.uniform(2.0, 3.2)), rng))
            else:
                w, h = rng.uniform(1.2, 0.28 * width), rng.uniform(1.0, 2.2)
                parts.append(
                    _panel(w, h, materials.poster(rng), (x, y, rng.uniform(1.5, 4.0)), azimuth + np.pi)
                )
            if rng.random() < 0.6:
                x, y = (reach - 1.0) * out + slot * along
                parts.append(_shelf(rng, (x, y), azimuth, 0.0 if k in glazed else rng.uniform(0.5, 3.0)))
    for _ in range(int(rng.integers(0, 2)) if day else int(rng.integers(2, 5))):
        at = np.array([*rng.uniform(-0.7, 0.7, 2) * half, rng.uniform(4.5, ceiling - 1)])
        warm = mix(np.array([1.0, 0.60, 0.27]), [1.0, 0.86, 0.66], rng.random()) * rng.uniform(40, 120)
        lamps.append(Lamp(pose_of(tuple(at)), warm, rng.uniform(0.35, 0.8)))
    return parts, lamps


def _shelf(rng: np.random.Generator, at: tuple[float, float], azimuth: float, top: float) -> Part:
    """A cupboard of books, its top at a height above the table's."""
    half = rng.uniform(1.2, 2.2), 0.8, (top - _FLOOR) / 2
    books = materials.tiles(rng, rng.uniform(0.25, 0.4), rng.uniform(1.0, 1.5), 0.08)
    return Part(rounded_box(half, 0.05), books, pose_of((*at, (top + _FLOOR) / 2), azimuth - np.pi / 2))


def _hall(rng: np.random.Generator) -> list[Part]:
    """A floor with a rail of panels and cupboards around it, beyond which the light's own picture is seen."""
    floor = materials.planks(rng, 0.8) if rng.random() < 0.5 else materials.slabs(rng, 2.0)
    parts = [Part(sheet((18, 0, 0), (0, 18, 0), 5), floor, pose_of((0, 0, _FLOOR)))]
    for azimuth in np.linspace(0, 2 * np.pi, 9)[:-1] + rng.uniform(-0.2, 0.2, 8):
        reach = rng.uniform(11, 15)
        at = reach * np.cos(azimuth), reach * np.sin(azimuth)
        if rng.random() < 0.5:
            half = rng.uniform(1.5, 2.6), rng.uniform(1.2, 2.2)
            parts.append(_panel(*half, materials.poster(rng), (*at, _FLOOR + 0.8 + half[1]), azimuth + np.pi))
        elif rng.random() < 0.7:
            parts.append(_shelf(rng, at, azimuth, rng.uniform(-1.0, 1.5)))
    return parts


def _yard(rng: np.random.Generator) -> list[Part]:
    """Grass or pavement with trees, fences and houses, 10 to 60 radii away."""
    ground = materials.grass(rng) if rng.random() < 0.5 else materials.slabs(rng, 2.5, 0.9)
    parts = [
        Part(sheet((20, 0, 0), (0, 20, 0), 5), ground, pose_of((0, 0, _FLOOR))),
        Part(sheet((90, 0, 0), (0, 90, 0), 2), materials.grass(rng), pose_of((0, 0, _FLOOR - 0.1))),
    ]
    for azimuth in np.linspace(0, 2 * np.pi, 11)[:-1] + rng.uniform(-0.25, 0.25, 10):
        reach, kind = (
            rng.uniform(12, 20),
            rng.choice(["tree", "house", "fence", "none"], p=[0.4, 0.25, 0.2, 0.15]),
        )
        x, y = reach * np.cos(azimuth), reach * np.sin(azimuth)
        if kind == "tree":
            crown, tall = rng.uniform(1.6, 3.2), rng.uniform(3, 6)
            bark, leaves = materials.plain(materials.Kind.WOOD, rng), materials.grass(rng, (0.06, 0.12, 0.03))
            parts.append(Part(bar((0, 0, 0), (0, 0, tall), 0.35), bark, pose_of((x, y, _FLOOR))))
            parts.append(
                Part(superquadric((crown, crown, 1.2 * crown), 0.8), leaves, pose_of((x, y, _FLOOR + tall)))
            )
        elif kind == "house":
            half = rng.uniform(4, 9), rng.uniform(3, 6), rng.uniform(3, 8)
            paint = materials.tiles(rng, rng.uniform(1.5, 2.5), rng.uniform(2.0, 3.0), 0.4, 0.4)
            far = (reach + 18) / reach
            parts.append(
                Part(rounded_box(half, 0.05), paint, pose_of((far * x, far * y, _FLOOR + half[2]), azimuth))
            )
        elif kind == "fence":
            paint = materials.plain(materials.Kind.WOOD, rng)
            parts.append(
                Part(rounded_box((3, 0.1, 1.6), 0.05), paint, pose_of((x, y, _FLOOR + 1.6), azimuth + 1.57))
            )
    return parts


def strangers(place: Place, rng: np.random.Generator) -> list[Part]:
    """Return simple figures somewhere around the table, another crowd for every photo."""
    parts = []
    for _ in range(int(rng.integers(3, 7))):
        azimuth, reach = rng.uniform(0, 2 * np.pi), rng.uniform(9.5, 10.8)
        stand = place.pose @ pose_of(
            (reach * np.cos(azimuth), reach * np.sin(azimuth), _FLOOR), rng.uniform(0, 6.3)
        )
        coat, trousers = (materials.patterned(materials.Kind.CLOTH, rng) for _ in range(2))
        skin = materials.plain(materials.Kind.WOOD, rng)
        figure = (
            Part(superquadric((1.0, 0.5, 1.4), 0.6), coat, pose_of((0, 0, 4.9))),
            Part(superquadric((0.75, 0.45, 1.9), 0.4), trousers, pose_of((0, 0, 1.9))),
            Part(superquadric((0.45, 0.5, 0.6), 1.0), skin, pose_of((0, 0, 6.8))),
        )
        parts += [part.moved(stand) for part in figure]
    return parts
