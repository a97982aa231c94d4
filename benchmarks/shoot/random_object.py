"""Objects drawn at random: bodies on top of each other with what sticks out of them and what they stand on."""

import numpy as np

from demo_scene.geometry import smooth

from .designs import UP_TO_FRONT
from .materials import Kind, patterned, plain
from .models import Painter, Part, corners, pose_of
from .shapes import Shape, bar, revolved, rounded_box, superquadric, tube, turned, wheel


def _body(rng: np.random.Generator) -> tuple[Shape, np.ndarray]:
    """Return a random solid body about the origin and its half size (3,)."""
    half = rng.uniform((0.35, 0.35, 0.25), (0.9, 0.8, 0.7))
    kind = rng.choice(["box", "superquadric", "revolved"])
    if kind == "box":
        return rounded_box(tuple(half), float(rng.uniform(0.08, 0.5) * half.min())), half
    if kind == "superquadric":
        return superquadric(tuple(half), rng.uniform(0.25, 0.8)), half
    height = np.linspace(-half[2], half[2], 5)
    outline = np.stack([half[0] * rng.uniform(0.55, 1.0, 5), height], axis=1)
    outline[2, 0] = half[0]
    low, high = outline[0], outline[-1]
    caps = turned((0, low[1]), tuple(low)) + turned(tuple(high), (0, high[1]))
    return revolved([smooth(list(map(tuple, outline)), 24)]) + caps, np.array([half[0], half[0], half[2]])


def random_object(rng: np.random.Generator) -> list[Part]:
    """One to three bodies on top of each other with knobs, plates, handles, bars, wheels or legs, of up to six materials."""
    palette = []
    for kind in rng.choice(list(Kind), int(rng.integers(1, 7))):
        palette.append((patterned if rng.random() < 0.4 else plain)(Kind(kind), rng))

    def material() -> Painter:
        return palette[rng.integers(len(palette))]

    parts, top = [], 0.0
    for _ in range(int(rng.integers(1, 4))):
        shape, half = _body(rng)
        parts.append(Part(shape, material(), pose_of((0, 0, top + half[2]), rng.uniform(-0.4, 0.4))))
        for _ in range(int(rng.integers(1, 3))):  # on a side of the body, half sunk into it
            turn, kind = rng.uniform(0, 2 * np.pi), rng.choice(["knob", "plate", "handle", "bar"])
            reach = 0.85 / np.hypot(np.cos(turn) / half[0], np.sin(turn) / half[1])
            size = rng.uniform(0.2, 0.4) * half[2]
            attached = {
                "knob": turned((0, -size), (size, -size), (0.8 * size, size), (0, size)),
                "plate": rounded_box((1.8 * size, 1.2 * size, 0.5 * size), 0.2 * size),
                "handle": tube(
                    smooth(
                        [
                            (-2 * size, 0, -size),
                            (-2 * size, 0, 2 * size),
                            (2 * size, 0, 2 * size),
                            (2 * size, 0, -size),
                        ],
                        24,
                    ),
                    0.35 * size,
                ),
                "bar": bar((0, 0, -size), (0, 0, 4 * size), 0.2 * size),
            }[kind]
            at = pose_of((reach, 0, top + half[2]), np.pi / 2, (0, 1, 0))
            parts.append(Part(attached, material(), pose_of(turn=turn) @ at))
        top += 1.85 * half[2]
    low = corners(parts[:1])
    x, y = 0.6 * np.abs(low[:, 0]).max(), 0.6 * np.abs(low[:, 1]).max()
    stand = rng.choice(["none", "legs", "wheels"])
    tyre, hub = wheel(0.25, 0.12, 6, 0.07)
    first, second = material(), material()
    for sx, sy in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        if stand == "legs":
            parts.append(
                Part(bar((1.2 * sx * x, 1.2 * sy * y, -0.3), (sx * x, sy * y, 0.25), 0.06), first, np.eye(4))
            )
        elif stand == "wheels":
            place = pose_of((sx * x, sy * np.abs(low[:, 1]).max(), 0.05)) @ UP_TO_FRONT
            parts += [Part(tyre, first, place), Part(hub, second, place)]
    return parts
