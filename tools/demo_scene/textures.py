"""Texture atlases, computed, never loaded; and the pot's painted glaze, fired clay, brass and wood.

Colours are linear. Every painter gets a `Canvas` of texel positions on one part and returns base colour,
roughness and metallic there. Heights and widths are in the modeller's units of `geometry`, before
normalisation.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .geometry import Part, coffee_pot
from .noise import fractal_noise, mix, smoothstep, value_noise

ATLAS = 1024
_MARGIN = 2  # texels around each tile that carry its pattern on, for the bilinear look-up at seams
TILES = {
    "body": (0, 0, 512, 1024),
    "lid": (512, 0, 256, 512),
    "spout": (512, 512, 256, 512),
    "handle": (768, 0, 256, 512),
    "band": (768, 512, 128, 512),
    "knob": (896, 512, 128, 512),
}

_CREAM = np.array([0.77, 0.72, 0.60])
_CELADON = np.array([0.45, 0.58, 0.50])
_COBALT = np.array([0.022, 0.050, 0.27])
_OCHRE = np.array([0.52, 0.20, 0.035])
_CLAY = np.array([0.40, 0.155, 0.075])
_BRASS = np.array([0.88, 0.66, 0.30])
_PATINA = np.array([0.50, 0.29, 0.11])
_WALNUT = np.array([0.20, 0.085, 0.035])
_WALNUT_DARK = np.array([0.060, 0.024, 0.012])
_BODY_LINES = ((0.395, 0.014), (0.435, 0.006), (0.965, 0.006), (1.005, 0.014), (1.345, 0.012), (1.385, 0.005))


@dataclass(frozen=True)
class Canvas:
    """Texel positions of one tile, all (rows, columns) float64."""

    u: np.ndarray  # around, periodic
    v: np.ndarray  # along
    height: np.ndarray  # or the place along the part's own axis


@dataclass(frozen=True)
class Material:
    """Linear base colour (..., 3), roughness (...), metallic (...), all in [0, 1]."""

    base: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray

    def over(self, other: "Material", mask: np.ndarray) -> "Material":
        """Return this material where `mask` (...) is 1 and `other` where it is 0."""
        return Material(
            mix(other.base, self.base, mask),
            other.roughness + (self.roughness - other.roughness) * mask,
            other.metallic + (self.metallic - other.metallic) * mask,
        )


def brass(c: Canvas, seed: int) -> Material:
    """Polished brass with dull patches and fine lines around."""
    patch = smoothstep(0.45, 0.75, fractal_noise(c.u * 12, c.v * 5, seed, period=12))
    lines = value_noise(c.u * 4, c.v * 160, seed + 7, period=4)
    roughness = 0.15 + 0.20 * patch + 0.05 * lines
    return Material(mix(_BRASS, _PATINA, 0.55 * patch), roughness, np.ones_like(c.u))


def clay(c: Canvas, seed: int) -> Material:
    """Unglazed terracotta with turning grooves and grains of sand."""
    groove = value_noise(c.u * 2, c.height * 70, seed, period=2)
    grain = value_noise(c.u * 320, c.height * 160, seed + 1, period=320)
    tone = 0.78 + 0.30 * groove + 0.28 * (grain - 0.5)
    return Material(_CLAY * tone[..., None], 0.80 + 0.12 * grain, np.zeros_like(c.u))


def glaze(c: Canvas, seed: int) -> Material:
    """Cream glaze with a slow drift of tone and scattered iron specks."""
    drift = fractal_noise(c.u * 8, c.height * 4, seed, period=8)
    speck = smoothstep(0.965, 0.99, value_noise(c.u * 150, c.height * 40, seed + 1, period=150))
    base = mix(_CREAM * (0.90 + 0.16 * drift)[..., None], _OCHRE * 0.5, 0.6 * speck)
    return Material(base, 0.13 + 0.08 * drift, np.zeros_like(c.u))


def _paint(under: Material, color: np.ndarray, mask: np.ndarray, c: Canvas, seed: int) -> Material:
    """Brush `color` under the glaze: uneven pigment, a little rougher."""
    density = mask * (0.72 + 0.28 * fractal_noise(c.u * 40, c.height * 24, seed, period=40))
    return Material(mix(under.base, color, density), under.roughness + 0.07 * mask, under.metallic)


def _line(x: np.ndarray, center: float | np.ndarray, half_width: float) -> np.ndarray:
    return 1.0 - smoothstep(half_width - 0.004, half_width + 0.004, np.abs(x - center))


def _leaf(x: np.ndarray, y: np.ndarray, at: tuple[float, float], degrees: float, size: float) -> np.ndarray:
    """A pointed leaf with a bare midrib, as a mask; it starts `at` and grows `size` in direction `degrees`."""
    angle = np.radians(degrees)
    dx, dy = x - at[0], y - at[1]
    along = (dx * np.cos(angle) + dy * np.sin(angle)) / size
    across = (-dx * np.sin(angle) + dy * np.cos(angle)) / size
    inside = 0.9 * np.clip(along, 0, 1) * np.clip(1 - along, 0, 1) - np.abs(across)
    rib = smoothstep(0.010, 0.024, np.abs(across))
    return smoothstep(-0.012, 0.012, inside) * smoothstep(0, 0.02, along) * (0.25 + 0.75 * rib)


def _flower(x: np.ndarray, y: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Masks of an eight-petalled flower: petals and heart."""
    distance, angle = np.hypot(x, y), np.arctan2(y, x)
    edge = radius * (0.62 + 0.38 * np.abs(np.cos(4 * angle)) ** 0.6)
    vein = smoothstep(0.02, 0.09, np.abs(np.sin(4 * angle))) + smoothstep(0.8, 0.9, distance / radius)
    petals = (1 - smoothstep(edge - 0.006, edge + 0.004, distance)) * (0.45 + 0.55 * np.clip(vein, 0, 1))
    heart = 1 - smoothstep(0.26 * radius, 0.32 * radius, distance)
    return petals * (1 - (1 - smoothstep(0.32 * radius, 0.38 * radius, distance))), heart


def _belly(c: Canvas, repeats: int = 6) -> tuple[np.ndarray, np.ndarray]:
    """Masks (cobalt, ochre) of the belly's frieze: flowers joined by a vine with leaves."""
    width = 4.15 / repeats
    x, y = (np.mod(c.u * repeats, 1.0) - 0.5) * width, c.height - 0.70
    petals, heart = _flower(x, y, 0.165)
    phase = 2 * np.pi * x / width
    vine = _line(y, 0.115 * np.sin(2 * phase), 0.011) * smoothstep(0.15, 0.18, np.hypot(x, y))
    leaves = np.zeros_like(x)
    edge = width / 2
    for sx, sy, degrees, size in (
        (-edge, 0.0, 58, 0.21),
        (-edge, 0.0, -58, 0.21),
        (edge, 0.0, 122, 0.21),
        (edge, 0.0, 238, 0.21),
        (-0.19, -0.085, 250, 0.15),
        (0.19, 0.085, 70, 0.15),
        (-0.10, 0.13, 100, 0.13),
        (0.10, -0.13, 280, 0.13),
    ):
        leaves = np.maximum(leaves, _leaf(x, y, (sx, sy), degrees, size))
    berry = 1 - smoothstep(0.018, 0.026, np.hypot(np.abs(x) - edge, y))
    return np.maximum.reduce([petals, vine * (1 - berry), leaves]), np.maximum(heart, berry)


def _lappets(c: Canvas, low: float, tall: float, repeats: int) -> np.ndarray:
    """A row of upright petals from height `low`: outline and filled core."""
    x = (np.mod(c.u * repeats, 1.0) - 0.5) * 2
    t = np.clip((c.height - low) / tall, -1, 2)
    half = np.sqrt(np.clip(1 - np.clip(t, 0, 1) ** 2.2, 0, 1)) * 0.92
    inside = np.where((t >= 0) & (t <= 1), half - np.abs(x), -1.0)
    return np.maximum(
        smoothstep(0, 0.05, inside) - smoothstep(0.16, 0.21, inside), smoothstep(0.36, 0.42, inside)
    )


def paint_body(c: Canvas, seed: int) -> Material:
    """Clay foot, dripping glaze edge, flower frieze, lappets on the shoulder, lines at the neck, brown rim."""
    edge = 0.235 + 0.10 * (fractal_noise(c.u * 9, c.u * 0, seed + 20, period=9, octaves=2) - 0.5)
    glazed = smoothstep(edge - 0.006, edge + 0.006, c.height)
    surface = glaze(c, seed)
    pooled = 1 - smoothstep(0.0, 0.11, c.height - edge)  # glaze runs down and gathers thick above its edge
    surface = Material(mix(surface.base, _CELADON, 0.75 * pooled), surface.roughness, surface.metallic)
    cobalt, ochre = _belly(c)
    for height, half in _BODY_LINES:
        cobalt = np.maximum(cobalt, _line(c.height, height, half))
    cobalt = np.maximum(cobalt, _lappets(c, 1.045, 0.25, 20))
    surface = _paint(surface, _COBALT, cobalt, c, seed + 30)
    surface = _paint(surface, _OCHRE, np.maximum(ochre, smoothstep(1.645, 1.655, c.height)), c, seed + 31)
    return surface.over(clay(c, seed + 10), glazed)


def paint_lid(c: Canvas, seed: int) -> Material:
    """Brass with engraved rings, in which the dirt of years sits."""
    metal = brass(c, seed)
    rings = np.maximum.reduce([_line(c.height, at, 0.006) for at in (1.716, 1.752, 1.762, 1.838)])
    return Material(
        mix(metal.base, _PATINA * 0.5, 0.8 * rings), metal.roughness + 0.3 * rings, metal.metallic
    )


def paint_spout(c: Canvas, seed: int) -> Material:
    """Glaze with cobalt rings and leaves along it, a brass lip, bare clay inside."""
    surface = glaze(c, seed)
    t = c.v / 0.62  # the way out is 62 % of the tube
    cobalt = np.maximum.reduce([_line(t, at, 0.012) for at in (0.34, 0.37, 0.84)])
    x = (np.mod(c.u * 4 + 0.5, 1.0) - 0.5) * 0.28
    cobalt = np.maximum(cobalt, _leaf(t - 0.42, x, (0.0, 0.0), 0, 0.36))
    surface = _paint(surface, _COBALT, cobalt, c, seed + 1)
    surface = brass(c, seed + 2).over(surface, smoothstep(0.895, 0.90, t))
    return clay(c, seed + 3).over(surface, smoothstep(1.06, 1.08, t))


def paint_handle(c: Canvas, seed: int) -> Material:
    """Walnut between brass ferrules; the grain runs along the handle."""
    warp = fractal_noise(c.u * 3, c.v * 6, seed, period=3)
    grain = value_noise(c.u * 22 + 0 * c.v, c.v * 5 + 2.2 * warp, seed + 1, period=22)
    pores = smoothstep(0.72, 0.9, value_noise(c.u * 60, c.v * 34, seed + 2, period=60))
    tone = np.clip(0.75 * grain + 0.35 * warp - 0.10, 0, 1)
    wood = Material(
        mix(mix(_WALNUT, _WALNUT_DARK, tone), _WALNUT_DARK * 0.6, 0.6 * pores),
        0.36 + 0.16 * grain + 0.12 * pores,
        np.zeros_like(c.u),
    )
    metal = np.maximum(1 - smoothstep(0.166, 0.169, c.v), smoothstep(0.871, 0.874, c.v))
    return brass(c, seed + 3).over(wood, metal)


_PAINTERS: dict[str, Callable[[Canvas, int], Material]] = {
    "body": paint_body,
    "lid": paint_lid,
    "spout": paint_spout,
    "handle": paint_handle,
    "band": brass,
    "knob": brass,
}


def atlas_uv(part: Part) -> np.ndarray:
    """Return a part's atlas coordinates (V, 2) in [0, 1] with v down the rows of the array."""
    row, column, rows, columns = TILES[part.name]
    x = column + _MARGIN + part.uv[:, 0] * (columns - 2 * _MARGIN)
    y = row + _MARGIN + part.uv[:, 1] * (rows - 2 * _MARGIN)
    return np.stack([x, y], axis=1) / ATLAS


def canvas(part: Part) -> Canvas:
    """Return the texel positions of a part's tile."""
    _, _, rows, columns = TILES[part.name]
    u = (np.arange(columns) + 0.5 - _MARGIN) / (columns - 2 * _MARGIN)
    v = (np.arange(rows) + 0.5 - _MARGIN) / (rows - 2 * _MARGIN)
    u, v = np.meshgrid(u, v)
    return Canvas(u, v, np.interp(v, part.path[:, 0], part.path[:, 1]))


@dataclass(frozen=True)
class Model:
    """A mesh ready to be photographed, with normals and texture coordinates, v down the rows of its atlas (S, S)."""

    vertices: np.ndarray  # (V, 3)
    normals: np.ndarray  # (V, 3)
    uv: np.ndarray  # (V, 2)
    faces: np.ndarray  # (F, 3)
    material: Material


def make_model(seed: int) -> Model:
    """Return the coffee pot, its textures drawn from `seed`."""
    parts, size = coffee_pot(), (ATLAS, ATLAS)
    base, roughness, metallic = np.full((*size, 3), 0.5), np.ones(size), np.zeros(size)
    for index, part in enumerate(parts):
        row, column, rows, columns = TILES[part.name]
        tile = np.s_[row : row + rows, column : column + columns]
        painted = _PAINTERS[part.name](canvas(part), seed + 1000 * index)
        base[tile], roughness[tile], metallic[tile] = painted.base, painted.roughness, painted.metallic
    material = Material(np.clip(base, 0, 1), np.clip(roughness, 0.06, 1), np.clip(metallic, 0, 1))
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts])
    faces = np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=False)])
    vertices, normals = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("vertices", "normals")
    )
    return Model(vertices, normals, np.concatenate([atlas_uv(part) for part in parts]), faces, material)
