"""Smooth random functions of the plane, periodic in x, and the ramps that textures and lights use."""

import numpy as np
from numpy.typing import ArrayLike

_LATTICE = 64


def smoothstep(low: float | np.ndarray, high: float | np.ndarray, x: float | np.ndarray) -> np.ndarray:
    """Cubic ramp from 0 at `low` to 1 at `high` (which may be smaller than `low`)."""
    t = np.clip((np.asarray(x) - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def mix(a: ArrayLike, b: ArrayLike, weight: ArrayLike) -> np.ndarray:
    """Blend colours, broadcast to (..., 3), by `weight` (...): a where it is 0, b where it is 1."""
    weight = np.asarray(weight, float)[..., None]
    return np.asarray(a, float) * (1.0 - weight) + np.asarray(b, float) * weight


def value_noise(x: np.ndarray, y: np.ndarray, seed: int, period: int = _LATTICE) -> np.ndarray:
    """Return noise in [0, 1] with features of unit size, repeating every `period` in x and every 64 in y."""
    table = np.random.default_rng(seed).random((_LATTICE, period))
    x0, y0 = np.floor(x), np.floor(y)
    tx, ty = smoothstep(0, 1, x - x0), smoothstep(0, 1, y - y0)
    column, row = x0.astype(int) % period, y0.astype(int) % _LATTICE
    right, below = (column + 1) % period, (row + 1) % _LATTICE
    top = table[row, column] * (1 - tx) + table[row, right] * tx
    bottom = table[below, column] * (1 - tx) + table[below, right] * tx
    return top * (1 - ty) + bottom * ty


def fractal_noise(
    x: np.ndarray, y: np.ndarray, seed: int, period: int = _LATTICE, octaves: int = 4
) -> np.ndarray:
    """Return the normalised sum of octaves of `value_noise`, each twice as fine and half as strong."""
    total, weight = np.zeros(np.broadcast(x, y).shape), 0.0
    for octave in range(octaves):
        scale = 2**octave
        total = total + value_noise(x * scale, y * scale, seed + 101 * octave, period * scale) / scale
        weight += 1.0 / scale
    return total / weight
