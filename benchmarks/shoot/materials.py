"""Materials of real things, as functions of the points of a part: what an object, a table and its room are made of.

Colours are linear. A painter gets points (..., 3) in its part's own frame and returns base colour, roughness and
metallic there; the same random generator makes the same painter.
"""

from enum import StrEnum

import numpy as np
from scipy.ndimage import map_coordinates

from demo_scene.noise import mix, smoothstep
from demo_scene.textures import Material

from .models import Painter


class Kind(StrEnum):
    """Materials of objects."""

    PAINT = "paint"
    PLASTIC = "plastic"
    METAL = "metal"
    WOOD = "wood"
    STONE = "stone"
    CLOTH = "cloth"
    GLAZE = "glaze"
    RUBBER = "rubber"
    LACQUER = "lacquer"
    CHROME = "chrome"
    GLASS = "glass"


_ROUGHNESS = {
    Kind.PAINT: (0.5, 0.8),
    Kind.PLASTIC: (0.25, 0.5),
    Kind.METAL: (0.15, 0.4),
    Kind.WOOD: (0.4, 0.7),
    Kind.STONE: (0.6, 0.9),
    Kind.CLOTH: (0.85, 1.0),
    Kind.GLAZE: (0.08, 0.2),
    Kind.RUBBER: (0.7, 0.9),
    Kind.LACQUER: (0.12, 0.3),
    Kind.CHROME: (0.05, 0.12),
    Kind.GLASS: (0.05, 0.1),
}
_METALS = np.array(
    [[0.56, 0.57, 0.58], [0.89, 0.66, 0.30], [0.93, 0.62, 0.52], [0.91, 0.92, 0.92], [0.42, 0.41, 0.40]]
)
_WOODS = np.array([[0.42, 0.24, 0.11], [0.20, 0.085, 0.035], [0.55, 0.38, 0.20], [0.30, 0.13, 0.05]])
_ANY_COLOR = (Kind.PAINT, Kind.PLASTIC, Kind.CLOTH, Kind.GLAZE, Kind.LACQUER)
_EVEN = (Kind.GLAZE, Kind.LACQUER, Kind.GLASS)  # equally rough everywhere


def noise(points: np.ndarray, scale: float, seed: int, octaves: int = 3) -> np.ndarray:
    """Return smooth noise (...) in [0, 1] of points (..., 3) with features of size 1 / scale."""
    table = np.random.default_rng(seed).random((32, 32, 32))
    total, weight = np.zeros(points.shape[:-1]), 0.0
    for octave in range(octaves):
        at = np.moveaxis(points * scale * 2**octave + 7.3 * octave, -1, 0)
        total += map_coordinates(table, at, order=1, mode="grid-wrap") / 2**octave
        weight += 0.5**octave
    return np.clip(0.5 + 1.6 * (total / weight - 0.5), 0, 1)


def cells(i: np.ndarray, j: np.ndarray, seed: int, count: int = 1) -> np.ndarray:
    """Return a random value (..., count) in [0, 1] of every cell (i, j) of a lattice that repeats after 64 cells."""
    table = np.random.default_rng(seed).random((64, 64, count))
    return table[np.floor(i).astype(int) % 64, np.floor(j).astype(int) % 64]


def vivid(rng: np.random.Generator, low: float = 0.03, high: float = 0.75) -> np.ndarray:
    """Return a random colour (3,) of paint, from dark to light and from grey to saturated."""
    hue = 0.5 + 0.5 * np.cos(2 * np.pi * (rng.random() + np.array([0, 1, 2]) / 3))
    color = mix(np.full(3, 0.6), hue, rng.uniform(0.3, 0.95)) * rng.uniform(0.4, 1.2)
    return np.clip(color, low, high)


def _dielectric(base: np.ndarray, roughness: float | np.ndarray) -> Material:
    return Material(base, np.broadcast_to(roughness, base.shape[:-1]), np.zeros(base.shape[:-1]))


def plain(kind: Kind, rng: np.random.Generator, color: np.ndarray | None = None) -> Painter:
    """Return a material of a kind with its own fine texture, no pattern on it; color: of what can have any."""
    seed, rough = int(rng.integers(2**31)), rng.uniform(*_ROUGHNESS[kind])
    natural = {
        Kind.METAL: _METALS[rng.integers(len(_METALS))],
        Kind.WOOD: _WOODS[rng.integers(len(_WOODS))] * rng.uniform(0.7, 1.4),
        Kind.STONE: mix(rng.uniform(0.15, 0.6) * np.ones(3), vivid(rng), 0.25),
        Kind.RUBBER: np.full(3, rng.uniform(0.02, 0.06)),
        Kind.CHROME: _METALS[0],
        Kind.GLASS: np.full(3, rng.uniform(0.01, 0.04)),  # dark, as of a car's windows: nothing shows through
    }
    shade = natural.get(kind, vivid(rng) if color is None else color)

    def paint(points: np.ndarray) -> Material:
        fine, coarse = noise(points, 40, seed, 2), noise(points, 2.5, seed + 1)
        tone = 0.8 + 0.4 * coarse
        if kind is Kind.WOOD:
            ring = noise(points * np.array([9.0, 9.0, 0.8]), 1.5, seed + 2)
            tone = 0.55 + 0.8 * ring + 0.15 * fine
        elif kind is Kind.STONE:
            tone = 0.7 + 0.4 * coarse + 0.35 * (fine - 0.5)
        elif kind is Kind.CLOTH:
            weave = np.sin(90 * points).prod(axis=-1)
            tone = tone * (0.9 + 0.2 * np.sign(weave) * np.abs(weave) ** 0.3)
        base = shade * tone[..., None]
        if kind is Kind.CHROME:
            return Material(shade * (0.95 + 0.1 * fine[..., None]), rough + 0.03 * fine, np.ones_like(tone))
        if kind is Kind.METAL:
            dull = smoothstep(0.55, 0.8, coarse)
            return Material(base, rough + 0.15 * dull + 0.05 * fine, np.ones_like(tone))
        return _dielectric(base, rough + 0.1 * (coarse - 0.5) * (kind not in _EVEN))

    return paint


def patterned(kind: Kind, rng: np.random.Generator, scale: float = 1.0) -> Painter:
    """Return a material of a kind with a second colour on it: stripes, checks, spots, blotches or an emblem."""
    color = vivid(rng)
    contrast = np.roll(color, 1) * (0.25 if color.max() > 0.3 else 4.0)
    under = plain(kind, rng, color)
    over = plain(kind if kind in _ANY_COLOR and rng.random() < 0.7 else Kind.PAINT, rng, contrast)
    pattern = rng.choice(["stripes", "checks", "spots", "blotches", "emblem"])
    axis, size, seed = rng.normal(size=3), scale * rng.uniform(0.16, 0.4), int(rng.integers(2**31))
    axis /= np.linalg.norm(axis)

    def mask(points: np.ndarray) -> np.ndarray:
        if pattern == "stripes":
            return smoothstep(0.45, 0.5, np.abs(np.mod(points @ axis / size, 1) - 0.5) * 2)
        if pattern == "blotches":
            return smoothstep(0.53, 0.57, noise(points, 0.8 / size, seed, 2))
        cell = points / size + 0.31
        # a fifth are left out: of things that repeat without a fault no photos can be put together
        there = cells(cell[..., 0] + 7 * np.floor(cell[..., 2]), cell[..., 1], seed)[..., 0] > 0.2
        if pattern == "checks":
            return there * (np.floor(cell).sum(axis=-1) % 2)
        if pattern == "spots":
            return there * smoothstep(0.36, 0.31, np.linalg.norm(np.mod(cell, 1) - 0.5, axis=-1))
        across = np.abs(points[..., 0] / size), np.abs(points[..., 2] / size)
        cross = np.minimum(*across) < 0.25
        return ((np.maximum(*across) < 1.1) & (cross | (np.maximum(*across) > 0.85))).astype(float)

    return lambda points: over(points).over(under(points), mask(points))


def planks(rng: np.random.Generator, width: float = 0.35) -> Painter:
    """Boards along x with grain, gaps and tones of their own."""
    color, seed = _WOODS[rng.integers(len(_WOODS))] * rng.uniform(0.9, 1.5), int(rng.integers(2**31))

    def paint(points: np.ndarray) -> Material:
        board = points[..., 1] / width
        grain = noise(points * np.array([0.6, 9.0, 1.0]) / width * 0.35, 1.0, seed, 4)
        tone = (0.6 + 0.5 * cells(board, 0 * board, seed)[..., 0]) * (0.55 + 0.9 * grain)
        gap = smoothstep(0.5, 0.46, np.abs(np.mod(board, 1) - 0.5))
        return _dielectric(color * (tone * (0.15 + 0.85 * gap))[..., None], 0.45 + 0.1 * grain)

    return paint


def newspaper(rng: np.random.Generator) -> Painter:
    """Columns of printed words, headlines and grey pictures."""
    seed = int(rng.integers(2**31))

    def paint(points: np.ndarray) -> Material:
        x, y = points[..., 0], points[..., 1]
        block = cells(x / 0.7, y / 0.45, seed, 2)
        line = np.where(block[..., 0] < 0.2, 0.13, 0.055)
        word = cells(x / line / 0.8, y / line, seed + 1)[..., 0] > 0.3
        ink = word & (np.mod(y / line, 1) < 0.62) & (np.mod(x / 0.7, 1) > 0.06)
        picture = (block[..., 1] < 0.25) & (np.mod(x / 0.7, 1) > 0.06) & (np.mod(y / 0.45, 1) > 0.08)
        grey = np.where(picture, 0.1 + 0.5 * noise(points, 9, seed + 2), np.where(ink, 0.07, 0.68))
        return _dielectric(grey[..., None] * np.array([1.0, 0.98, 0.92]), 0.9)

    return paint


def slabs(rng: np.random.Generator, size: float = 1.0, rough: float = 0.6) -> Painter:
    """Speckled stone in slabs of tones of their own, with joints: a table top, a pavement, a wall of bricks."""
    color, seed = mix(np.full(3, rng.uniform(0.2, 0.5)), vivid(rng), 0.25), int(rng.integers(2**31))

    def paint(points: np.ndarray) -> Material:
        across = points / (size * np.array([1.0, 0.6, 0.6]))
        row = np.floor(across[..., 1]) + np.floor(across[..., 2] - 1e-3)
        x = across[..., 0] + 0.5 * (row % 2)
        joint = 0.5 - np.maximum(np.abs(np.mod(x, 1) - 0.5), np.abs(np.mod(across[..., 1], 1) - 0.5)) < 0.025
        speckle = noise(points, 14 / size, seed, 3)
        tone = (0.6 + 0.6 * cells(x, row, seed)[..., 0]) * (0.5 + speckle) * np.where(joint, 0.4, 1.0)
        return _dielectric(color * tone[..., None], rough)

    return paint


def grass(rng: np.random.Generator, color: tuple[float, float, float] = (0.10, 0.16, 0.05)) -> Painter:
    """Grass or leaves, with patches and blades."""
    seed = int(rng.integers(2**31))

    def paint(points: np.ndarray) -> Material:
        tone = (0.3 + 1.4 * noise(points, 2.5, seed, 4)) * (0.6 + 0.8 * noise(points, 0.25, seed + 1, 2))
        dry = 0.4 * noise(points, 0.4, seed + 2, 2)
        return _dielectric(mix(np.array(color), np.array([0.3, 0.25, 0.12]), dry) * tone[..., None], 0.95)

    return paint


def poster(rng: np.random.Generator) -> Painter:
    """A sheet over [-1, 1]^2 of x + y and z: blocks of colour and discs over a ground, lines of print below."""
    ground, seed, blocks = rng.uniform(0.3, 0.75, 3), int(rng.integers(2**31)), rng.uniform(-1, 1, (9, 4))
    colors = [vivid(rng) for _ in blocks]

    def paint(points: np.ndarray) -> Material:
        x, z = points[..., 0] + points[..., 1], points[..., 2]
        base = np.broadcast_to(ground, points.shape)
        for k, ((cx, cz, w, h), color) in enumerate(zip(blocks, colors, strict=True)):
            dx, dz = (x - cx) / (0.15 + 0.35 * abs(w)), (z - cz) / (0.1 + 0.3 * abs(h))
            inside = np.hypot(dx, dz) < 1 if k % 3 == 0 else np.maximum(np.abs(dx), np.abs(dz)) < 1
            base = np.where(inside[..., None], color, base)
        print_ = (z < -0.6) & (np.mod(z * 12, 1) < 0.5) & (cells(x * 20, z * 12, seed)[..., 0] > 0.3)
        edge = np.maximum(np.abs(x), np.abs(z)) > 0.95
        return _dielectric(np.where((print_ | edge)[..., None], 0.04, base), 0.6)

    return paint


def tiles(rng: np.random.Generator, width: float, height: float, gap: float, spread: float = 1.0) -> Painter:
    """Upright rectangles of random colours over a darker or lighter ground: backs of books, windows of a house."""
    seed, ground, color = int(rng.integers(2**31)), rng.uniform(0.05, 0.6, 3), rng.uniform(0.1, 0.6, 3)

    def paint(points: np.ndarray) -> Material:
        x, z = (points[..., 0] + points[..., 1]) / width, points[..., 2] / height
        x = x + 0.35 * np.sin(2.1 * x + 5 * np.floor(z))  # of uneven widths
        drawn = cells(x, z, seed, 4)
        tile = (np.mod(x, 1) > gap) & (np.mod(z, 1) > gap) & (np.mod(z, 1) < 0.7 + 0.3 * drawn[..., 3])
        colors = mix(color, drawn[..., :1] * (0.3 + 0.7 * drawn[..., 1:]), spread)
        base = np.where(tile[..., None], colors, ground) * (0.8 + 0.4 * noise(points, 3, seed, 4))[..., None]
        return _dielectric(base, 0.7)

    return paint
