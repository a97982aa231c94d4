"""Photographers' studios: softboxes, strips and dishes around a paper backdrop.

Directions are (H, W, 3) unit vectors, z up.
"""

import numpy as np

from .noise import mix, smoothstep
from .sky import unit

_PAPERS = np.array(
    [[0.03, 0.03, 0.035], [0.18, 0.18, 0.18], [0.55, 0.54, 0.52], [0.34, 0.27, 0.20], [0.10, 0.16, 0.24]]
)
_GELS = np.array([[1.0, 0.45, 0.15], [0.35, 0.55, 1.0], [1.0, 0.45, 0.70]])


def softbox(
    d: np.ndarray, toward: np.ndarray, roll: float, half: tuple[float, float], round_: bool
) -> np.ndarray:
    """Brightness (H, W) of a flat lamp: `half` is its size as tangents, hot in the middle, dark outside."""
    right = np.cross([0.0, 0.0, 1.0], toward)
    right /= max(np.linalg.norm(right), 1e-6)
    up = np.cross(toward, right)
    right, up = np.cos(roll) * right + np.sin(roll) * up, np.cos(roll) * up - np.sin(roll) * right
    front = d @ toward
    depth = np.where(front > 1e-3, front, 1.0)
    x, y = (d @ right) / depth / half[0], (d @ up) / depth / half[1]
    outside = np.hypot(x, y) if round_ else np.maximum(np.abs(x), np.abs(y))
    return np.where(
        front > 1e-3, (1 - smoothstep(0.93, 1.07, outside)) * (0.45 + 0.55 * np.exp(-(x * x + y * y))), 0.0
    )


def studio(d: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A dim hall, a curved paper backdrop on one side, two to five lamps and a reflector card."""
    paper = _PAPERS[rng.integers(len(_PAPERS))]
    around = np.abs(np.arctan2(d[..., 1], -d[..., 0]))
    wide = rng.uniform(0.6, 1.2)
    hall = mix([0.012, 0.012, 0.013], [0.05, 0.048, 0.045], smoothstep(0.1, -0.6, d[..., 2]))
    # The paper hangs behind the object and is rolled out under it.
    backdrop = smoothstep(wide + 0.03, wide, around) * smoothstep(0.72, 0.68, d[..., 2])
    backdrop = np.maximum(backdrop, smoothstep(-0.55, -0.62, d[..., 2]))
    radiance = mix(hall, paper * (0.8 + 0.5 * d[..., 2])[..., None], backdrop)
    for _ in range(int(rng.integers(2, 6))):
        toward = unit(rng.uniform(-1.9, 1.9), np.radians(rng.uniform(-5, 75)))
        shape = rng.choice(["box", "strip", "dish"], p=[0.5, 0.25, 0.25])
        size = rng.uniform(0.12, 0.45)
        aspect = rng.uniform(0.6, 1.4)
        half = {
            "box": (size, size * aspect),
            "strip": (0.25 * size, 1.6 * size),
            "dish": (0.5 * size, 0.5 * size),
        }
        kelvin = mix(np.array([1.0, 0.80, 0.58]), [0.86, 0.94, 1.0], rng.random())
        if rng.random() < 0.08:
            kelvin = _GELS[rng.integers(len(_GELS))]
        lamp = softbox(d, toward, rng.uniform(-0.5, 0.5), half[shape], shape == "dish")
        power = rng.uniform(0.6, 2.0) / (half[shape][0] * half[shape][1] * 4)
        radiance = mix(radiance, kelvin * power, lamp)
    card = softbox(d, unit(rng.choice([-1.0, 1.0]) * rng.uniform(1.5, 2.3), 0.0), 0.0, (0.5, 0.8), False)
    return radiance + 0.35 * card[..., None]
