"""Finishes of the dark test objects, whose base colours, all linear, are known to be next to black.

The toy car wears metallic paint, the camera matte plastic and leather, the lantern gloss beside bright
porcelain. On a rounded box u runs around its length from +y over +z, so 0, 1/4, 1/2 and 3/4 are its left,
top, right and bottom.
"""

import numpy as np

from .noise import fractal_noise, mix, smoothstep, value_noise
from .textures import Canvas, Material, Painters

_WINE = np.array([0.075, 0.021, 0.028])
_PETROL = np.array([0.020, 0.048, 0.070])
_PANEL = np.array([0.026, 0.026, 0.027])  # the neutral near-black beside either paint
_PLASTIC = np.array([0.030, 0.030, 0.031])
_LEATHER = np.array([0.048, 0.034, 0.024])
_MOSS = np.array([0.024, 0.046, 0.028])
_GLASS = np.array([0.022, 0.026, 0.046])
_LACQUER = np.array([0.030, 0.028, 0.027])
_LACQUER_BLUE = np.array([0.021, 0.026, 0.038])
_PORCELAIN = np.array([0.72, 0.68, 0.60])
_SAND = np.array([0.78, 0.60, 0.40])


def band(x: np.ndarray, low: float, high: float, soft: float = 0.004) -> np.ndarray:
    """1 between `low` and `high`, 0 outside."""
    return smoothstep(low - soft, low + soft, x) * smoothstep(high + soft, high - soft, x)


def _around(u: np.ndarray, at: float) -> np.ndarray:
    """Distance of the periodic `u` from `at`, at most 1/2."""
    return np.abs(np.mod(u - at + 0.5, 1.0) - 0.5)


def finish(c: Canvas, color: np.ndarray, roughness: float, metallic: float, seed: int) -> Material:
    """One colour, drifting by a tenth, of a roughness that drifts by 0.04."""
    drift = fractal_noise(c.u * 8, c.v * 5, seed, period=8)
    even = np.ones_like(c.u)
    return Material(
        color * (0.90 + 0.20 * drift)[..., None], roughness + 0.08 * (drift - 0.5), metallic * even
    )


def _car_paint(c: Canvas, color: np.ndarray, seed: int) -> Material:
    return finish(c, color, 0.26, 0.85, seed)


def _car_panel(c: Canvas, seed: int) -> Material:
    return finish(c, _PANEL, 0.36, 0.72, seed)


def _paint_car_body(c: Canvas, seed: int) -> Material:
    """Wine red over petrol along the sides, neutral bonnet stripe, sills and underside."""
    side = np.minimum(_around(c.u, 0.0), _around(c.u, 0.5))
    lower = smoothstep(0.01, 0.0, np.where(np.cos(2 * np.pi * (c.u - 0.25)) > 0, side, -side) - 0.02)
    surface = _car_paint(c, _PETROL, seed).over(_car_paint(c, _WINE, seed + 1), lower)
    stripe = band(_around(c.u, 0.25), -1.0, 0.045)
    sill = smoothstep(0.19, 0.18, _around(c.u, 0.75))
    doors = band(c.v, 0.36, 0.365) + band(c.v, 0.60, 0.605)
    return _car_panel(c, seed + 2).over(surface, np.clip(stripe + sill + doors, 0, 1))


def _paint_cabin(c: Canvas, seed: int) -> Material:
    """Petrol roof and pillars around neutral panes."""
    side = np.minimum(_around(c.u, 0.0), _around(c.u, 0.5))
    panes = band(side, -1.0, 0.085) * (band(c.v, 0.14, 0.48) + band(c.v, 0.53, 0.86))
    screens = (smoothstep(0.085, 0.075, c.v) + smoothstep(0.915, 0.925, c.v)) * smoothstep(
        0.02, 0.03, c.v * (1 - c.v)
    )
    return _car_panel(c, seed).over(_car_paint(c, _PETROL, seed + 1), np.clip(panes + screens, 0, 1))


def _paint_wheels(c: Canvas, seed: int) -> Material:
    """Neutral tyres with grooves across, wine red hubs."""
    groove = band(np.mod(c.u * 24, 1.0), 0.4, 0.6, 0.05) * band(c.v, 0.40, 0.62)
    surface = _car_panel(c, seed)
    surface = Material(surface.base * (1 - 0.2 * groove)[..., None], surface.roughness, surface.metallic)
    return _car_paint(c, _WINE, seed + 1).over(surface, smoothstep(0.78, 0.79, c.v))


CAR_PAINTERS: Painters = {
    "body": _paint_car_body,
    "cabin": _paint_cabin,
    "wheels": _paint_wheels,
    "tail_bar": lambda c, seed: _car_paint(c, _WINE, seed),
    "bumpers": _car_panel,
}


def _plastic(c: Canvas, seed: int) -> Material:
    """Moulded plastic with a fine grain."""
    grain = value_noise(c.u * 200, c.v * 60, seed, period=200)
    surface = finish(c, _PLASTIC, 0.56, 0.0, seed + 1)
    return Material(surface.base, surface.roughness + 0.06 * grain, surface.metallic)


def _leather(c: Canvas, seed: int) -> Material:
    """Worn brown leather with pores."""
    pores = smoothstep(0.60, 0.85, value_noise(c.u * 90, c.v * 50, seed, period=90))
    surface = finish(c, _LEATHER, 0.72, 0.0, seed + 1)
    return Material(
        surface.base * (1 - 0.35 * pores)[..., None], surface.roughness + 0.06 * pores, surface.metallic
    )


def _paint_housing(c: Canvas, seed: int) -> Material:
    """Leather around front, bottom and back, plastic above, a mossy line between."""
    top = _around(c.u, 0.25)
    surface = _leather(c, seed).over(_plastic(c, seed + 3), smoothstep(0.155, 0.16, top))
    return finish(c, _MOSS, 0.60, 0.0, seed + 6).over(surface, band(top, 0.155, 0.185))


def _paint_lens(c: Canvas, seed: int) -> Material:
    """Plastic barrel, a ribbed mossy ring, a bluish, dull glass."""
    rib = band(np.mod(c.u * 40, 1.0), 0.3, 0.7, 0.08)
    ring = finish(c, _MOSS, 0.66, 0.0, seed)
    ring = Material(ring.base * (1 - 0.25 * rib)[..., None], ring.roughness + 0.1 * rib, ring.metallic)
    surface = ring.over(_plastic(c, seed + 2), band(c.v, 0.25, 0.42))
    return finish(c, _GLASS, 0.52, 0.0, seed + 4).over(surface, smoothstep(0.80, 0.805, c.v))


CAMERA_PAINTERS: Painters = {
    "housing": _paint_housing,
    "grip": _leather,
    "hump": _plastic,
    "lens": _paint_lens,
    "dials": lambda c, seed: finish(c, _MOSS, 0.60, 0.0, seed),
    "loops": _plastic,
}


def _lacquer(c: Canvas, seed: int) -> Material:
    """Black gloss."""
    return finish(c, _LACQUER, 0.16, 0.0, seed)


def _porcelain(c: Canvas, seed: int) -> Material:
    """Bright gloss with a slow drift to the colour of sand."""
    drift = smoothstep(0.4, 0.7, fractal_noise(c.u * 5, c.v * 4, seed, period=5))
    surface = finish(c, _PORCELAIN, 0.20, 0.0, seed + 1)
    return Material(mix(surface.base, _SAND, 0.7 * drift), surface.roughness, surface.metallic)


def _paint_foot(c: Canvas, seed: int) -> Material:
    """Black and bluish black with a bright belt."""
    surface = finish(c, _LACQUER_BLUE, 0.14, 0.0, seed).over(
        _lacquer(c, seed + 1), smoothstep(0.55, 0.56, c.v)
    )
    return _porcelain(c, seed + 2).over(surface, band(c.v, 0.37, 0.43))


def _paint_globe(c: Canvas, seed: int) -> Material:
    """Bright, with a zigzag in black around its belly."""
    wave = np.abs(np.mod(c.u * 10, 1.0) - 0.5) * 0.30
    zigzag = band(c.v - wave, 0.36, 0.42, 0.006)
    return _lacquer(c, seed).over(_porcelain(c, seed + 1), np.maximum(zigzag, smoothstep(0.93, 0.935, c.v)))


def _paint_roof(c: Canvas, seed: int) -> Material:
    """Bluish black with eight bright wedges and a black rim."""
    wedge = band(np.mod(c.u * 8, 1.0), 0.14, 0.86, 0.02) * band(c.v, 0.42, 0.70)
    surface = finish(c, _LACQUER_BLUE, 0.14, 0.0, seed).over(
        _lacquer(c, seed + 1), smoothstep(0.40, 0.405, c.v)
    )
    return _porcelain(c, seed + 2).over(surface, wedge)


LANTERN_PAINTERS: Painters = {
    "foot": _paint_foot,
    "globe": _paint_globe,
    "bars": _lacquer,
    "roof": _paint_roof,
    "ring": _lacquer,
}
