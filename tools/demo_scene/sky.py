"""Open air: skies by the height of the sun with clouds and a skyline, and streets at nightfall.

Directions are (H, W, 3) unit vectors, z up; radiance comes back in units in which a clear zenith is roughly
0.5.
"""

import numpy as np

from .noise import fractal_noise, mix, smoothstep, value_noise

_GRASS, _ASPHALT, _SAND = (0.09, 0.13, 0.035), (0.14, 0.135, 0.13), (0.38, 0.30, 0.19)
_GROUNDS = np.array([_GRASS, _ASPHALT, _SAND, (0.62, 0.64, 0.66), (0.27, 0.25, 0.22), (0.10, 0.15, 0.06)])
# larger than the true 0.27 degrees, and dimmer by as much: it must fill a texel
_SUN_RADIUS = np.radians(1.3)


def unit(azimuth: float, elevation: float) -> np.ndarray:
    """Return the direction (3,) at angles in radians."""
    return np.array(
        [np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)]
    )


def sun_color(elevation: float, haze: float) -> np.ndarray:
    """Sunlight after the atmosphere, (3,): redder and weaker the longer its way; 0 below the horizon.

    The air mass is Kasten and Young's (1989), the optical depths are round numbers for 680, 550 and 450 nm.
    """
    degrees = max(np.degrees(elevation), -1.0)
    mass = 1.0 / (np.sin(max(elevation, 0.0)) + 0.50572 * (degrees + 6.07995) ** -1.6364)
    set_below = smoothstep(-0.8, 0.8, np.degrees(elevation))
    return np.exp(-mass * haze * np.array([0.055, 0.105, 0.21])) * set_below


def _clear_sky(d: np.ndarray, sun: np.ndarray, elevation: float, haze: float) -> np.ndarray:
    """Blue above, whiter towards the horizon, glowing around the sun, orange on its side when it is low."""
    day = 0.03 + smoothstep(-7, 25, np.degrees(elevation))
    low = 1 - smoothstep(3, 22, np.degrees(elevation))
    z = np.clip(d[..., 2], 0, 1)
    horizon = np.exp(-z / (0.10 + 0.10 * haze))
    color = mix([0.15, 0.30, 0.66], [0.62, 0.72, 0.85], horizon) * day
    toward = 0.5 + 0.5 * d[..., :2] @ (sun[:2] / max(np.linalg.norm(sun[:2]), 1e-6))
    warm = low * np.exp(-z / 0.22) * np.clip(toward, 0, 1) ** 2
    color = mix(color, np.array([1.25, 0.58, 0.24]) * (0.25 + day), warm)
    away = np.arccos(np.clip(d @ sun, -1, 1))
    glow = 0.35 * haze * np.exp(-away / np.radians(14)) + 1.6 * haze * np.exp(-away / np.radians(4))
    return color + glow[..., None] * sun_color(elevation, haze)


def _clouds(d: np.ndarray, cover: float, rng: np.random.Generator) -> np.ndarray:
    """Opacity of the cloud layer, (H, W): a noisy plane overhead, thinned out at the horizon."""
    z = np.clip(d[..., 2], 0, 1)
    scale = rng.uniform(0.8, 2.0)
    x, y = (d[..., k] / (z + 0.18) * scale + rng.uniform(0, 60) for k in (0, 1))
    density = fractal_noise(x, y, int(rng.integers(2**31)), octaves=4)
    threshold = np.interp(cover, [0, 1], [0.78, 0.22])
    return smoothstep(threshold, threshold + 0.16, density) * smoothstep(0.01, 0.10, d[..., 2])


def _skyline(d: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """What stands around: mask (H, W) and reflectance (H, W, 3) of trees, houses, hills or nothing."""
    around = np.mod(np.arctan2(d[..., 1], d[..., 0]) / (2 * np.pi), 1.0)
    seed = int(rng.integers(2**31))
    what = rng.choice(["trees", "houses", "hills", "open"], p=[0.35, 0.30, 0.2, 0.15])
    if what == "trees":
        top = 0.05 + rng.uniform(0.15, 0.75) * fractal_noise(around * 12, 0 * around, seed, period=12)
        leaf = value_noise(around * 90, d[..., 2] * 40, seed + 1, period=90)[..., None]
        color = np.array([0.055, 0.085, 0.025]) * (0.4 + 1.4 * leaf)
    elif what == "houses":
        count = int(rng.integers(9, 20))
        house = np.floor(around * count).astype(int)
        tall = rng.uniform(0.08, 0.75, count) * (rng.random(count) < 0.8)
        tint = np.array([1.0, 0.9, 0.78])
        paint = rng.uniform(0.10, 0.55, (count, 1)) * tint * rng.uniform(0.85, 1.15, (count, 3))
        top = tall[house]
        window = (np.mod(around * count * 5, 1) < 0.45) & (np.mod(d[..., 2] * 18, 1) < 0.5)
        color = paint[house] * np.where(window, 0.35, 1.0)[..., None]
    else:
        height = 0.30 if what == "hills" else 0.015
        top = height * fractal_noise(around * 5, 0 * around, seed, period=5)
        color = np.broadcast_to(np.array([0.13, 0.15, 0.11]), d.shape)
    return smoothstep(top + 0.012, top - 0.012, d[..., 2]) * (d[..., 2] > -0.02), color


def _ground(d: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Reflectance of the ground, (H, W, 3)."""
    down = np.maximum(-d[..., 2], 0.02)
    x, y = (d[..., k] / down * 1.5 + rng.uniform(0, 60) for k in (0, 1))
    tone = 0.7 + 0.6 * fractal_noise(x, y, int(rng.integers(2**31)), octaves=3)
    return _GROUNDS[rng.integers(len(_GROUNDS))] * np.exp2(rng.uniform(-0.5, 0.3)) * tone[..., None]


def outdoors(d: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A sky at a random hour and weather over some ground, with the sun's disc when it shows."""
    lowest, highest = ((-5, 4), (4, 20), (20, 65))[rng.choice(3, p=[0.2, 0.35, 0.45])]
    elevation = np.radians(rng.uniform(lowest, highest))
    haze = rng.uniform(0.6, 1.8)
    cover = float(rng.uniform(*((0.0, 0.3), (0.3, 0.8), (1.0, 1.0))[rng.choice(3, p=[0.5, 0.3, 0.2])]))
    sun = unit(0.0, elevation)  # the azimuth comes from the random turn of the finished map
    clear = _clear_sky(d, sun, elevation, haze)
    cloud = _clouds(d, cover, rng)
    overcast = smoothstep(0.85, 1.0, cover)
    sunlight = 14.0 * sun_color(elevation, haze) * (1 - overcast)  # irradiance on a plane facing the sun
    upper = d[..., 2] > 0
    mean_sky = clear[upper].mean(axis=0)
    grey = mean_sky.mean() * (0.6 + 0.9 * np.clip(d[..., 2], 0, 1))[..., None] * np.array([0.95, 1.0, 1.06])
    toward = np.clip(d @ sun, 0, 1)[..., None] ** 4
    sky = mix(clear, grey * 1.3 + sunlight * (0.05 + 0.12 * toward), cloud)
    sky = mix(sky, grey * 1.6, overcast)
    disc = 1 - smoothstep(0.85 * _SUN_RADIUS, 1.15 * _SUN_RADIUS, np.arccos(np.clip(d @ sun, -1, 1)))
    sky = sky + disc[..., None] * (1 - 0.97 * cloud[..., None]) * sunlight / (np.pi * _SUN_RADIUS**2)
    diffuse = np.pi * mix(mean_sky, mean_sky.mean() * np.ones(3), overcast)
    falling = diffuse + sunlight * max(np.sin(elevation), 0) * (1 - cover)
    radiance = mix(_ground(d, rng) * falling / np.pi, sky, smoothstep(-0.01, 0.01, d[..., 2]))
    mask, reflectance = _skyline(d, rng)
    # what stands opposite the sun shows its lit side
    facing = np.clip(-d[..., :2] @ sun[:2], 0, 1)[..., None]
    return mix(radiance, reflectance * (0.5 * diffuse + sunlight * (1 - cover) * facing) / np.pi, mask)


def _lamp(d: np.ndarray, toward: np.ndarray, radius: float) -> np.ndarray:
    """Mask of a soft-edged disc of an angular radius."""
    return (1 - smoothstep(0.75 * radius, 1.25 * radius, np.arccos(np.clip(d @ toward, -1, 1))))[..., None]


def evening(d: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A street after sunset: deep blue overhead, an afterglow, warm lamps, lit shop windows."""
    z = np.clip(d[..., 2], 0, 1)
    sky = mix(np.array([0.03, 0.055, 0.14]), [0.20, 0.19, 0.24], np.exp(-z / 0.25))
    glow = np.clip(0.5 + 0.5 * d[..., 0], 0, 1) ** 3 * np.exp(-z / 0.12) * rng.uniform(0, 1)
    sky = sky + glow[..., None] * np.array([0.7, 0.28, 0.12])
    light = np.full(3, 0.05)
    lamps = np.zeros_like(d)
    for _ in range(int(rng.integers(5, 12))):
        toward = unit(rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(4, 50)))
        color = mix(np.array([1.0, 0.55, 0.20]), [0.95, 0.97, 1.0], rng.random() ** 3) * rng.uniform(60, 500)
        radius = np.radians(rng.uniform(0.9, 2.0))
        lamps = lamps + _lamp(d, toward, radius) * color + 0.004 * _lamp(d, toward, 6 * radius) * color
        light = light + color * np.pi * radius**2 * max(toward[2], 0.1)
    radiance = mix(_ground(d, rng) * light / np.pi * 1.5, sky, smoothstep(-0.01, 0.01, d[..., 2]))
    mask, reflectance = _skyline(d, rng)
    radiance = mix(radiance, reflectance * light / np.pi, mask)
    around = np.arctan2(d[..., 1], d[..., 0])
    for _ in range(int(rng.integers(2, 6))):
        center, width = rng.uniform(-np.pi, np.pi), rng.uniform(0.06, 0.25)
        away = np.abs(np.angle(np.exp(1j * (around - center))))
        pane = (away < width) & (d[..., 2] > -0.06) & (d[..., 2] < rng.uniform(0.06, 0.2))
        warmth = mix(np.array([1.0, 0.68, 0.36]), [0.8, 0.9, 1.0], rng.random() ** 2) * rng.uniform(2, 10)
        radiance = np.where(pane[..., None], warmth, radiance)
    return radiance + lamps
