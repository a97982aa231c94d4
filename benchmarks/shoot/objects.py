"""Objects to photograph: a boxy matte radio, a shiny urn, a trolley of thin bars, and random ones from a seed.

Every maker returns parts that stand upright on their lowest point, z up; `make_object` brings them to radius 1.
"""

from collections.abc import Callable

import numpy as np

from demo_scene.geometry import smooth

from .materials import Kind, patterned, plain
from .models import Painter, Part, corners, normalised, pose_of
from .shapes import Shape, bar, revolved, rounded_box, superquadric, tube, turned, wheel

_UP_TO_FRONT = pose_of(turn=np.pi / 2, axis=(1, 0, 0))  # takes z to -y, the side that a person faces


def radio(rng: np.random.Generator) -> list[Part]:
    """A matte box with a grille, a dial, knobs, feet and a handle."""
    paint, cloth, wood, rubber = (
        patterned(Kind.PAINT, rng),
        *(plain(k, rng) for k in (Kind.CLOTH, Kind.WOOD, Kind.RUBBER)),
    )
    front, dial = patterned(Kind.CLOTH, rng, 0.5), patterned(Kind.PAINT, rng, 0.4)
    knob = turned((0, 0), (0.14, 0), (0.12, 0.12), (0, 0.12))
    handle = smooth(
        [(-0.7, 0, 0.55), (-0.68, 0, 0.8), (-0.5, 0, 0.92), (0.5, 0, 0.92), (0.68, 0, 0.8), (0.7, 0, 0.55)],
        33,
    )
    parts = [
        Part(rounded_box((1, 0.38, 0.6), 0.08), paint, np.eye(4)),
        Part(rounded_box((0.42, 0.05, 0.42), 0.03), front, pose_of((-0.42, -0.38, 0))),
        Part(rounded_box((0.34, 0.04, 0.16), 0.02), dial, pose_of((0.48, -0.38, 0.24))),
        Part(rounded_box((0.5, 0.05, 0.3), 0.02), cloth, pose_of((0.1, 0.38, -0.1))),
        Part(tube(handle, 0.07), wood, np.eye(4)),
    ]
    parts += [Part(knob, rubber, pose_of((x, -0.37, -0.25)) @ _UP_TO_FRONT) for x in (0.3, 0.68)]
    foot = turned((0, -0.08), (0.1, -0.08), (0.12, 0.02), (0, 0.02))
    return parts + [Part(foot, rubber, pose_of((x, y, -0.6))) for x in (-0.8, 0.8) for y in (-0.25, 0.25)]


def urn(rng: np.random.Generator) -> list[Part]:
    """A glazed body with a polished lid, a knob, two handles, a foot and a tap."""
    glaze, lid, metal = patterned(Kind.GLAZE, rng), plain(Kind.METAL, rng), plain(Kind.METAL, rng)
    belly = smooth([(0.38, 0.12), (0.62, 0.35), (0.76, 0.75), (0.66, 1.2), (0.46, 1.48), (0.44, 1.6)], 28)
    dome = smooth([(0.5, 1.6), (0.42, 1.72), (0.2, 1.84), (0.0, 1.87)], 12)
    knob = smooth([(0.06, 1.85), (0.06, 1.92), (0.13, 2.0), (0.1, 2.1), (0.0, 2.13)], 12)
    ear = smooth([(0.58, 0, 1.3), (0.85, 0, 1.4), (1.02, 0, 1.2), (0.95, 0, 0.9), (0.68, 0, 0.72)], 30)
    spout = smooth([(0, -0.6, 0.4), (0, -0.9, 0.4), (0, -0.98, 0.34), (0, -1.0, 0.22)], 16)
    parts = [
        Part(revolved([belly]) + turned((0, 0.12), (0.38, 0.12)), glaze, np.eye(4)),
        Part(revolved([dome, knob]) + turned((0.4, 1.57), (0.5, 1.57), (0.5, 1.6)), lid, np.eye(4)),
        Part(turned((0, 0), (0.5, 0), (0.5, 0.06), (0.38, 0.16)), plain(Kind.WOOD, rng), np.eye(4)),
        Part(tube(spout, 0.075), metal, np.eye(4)),
        Part(bar((-0.16, -0.84, 0.52), (0.16, -0.84, 0.52), 0.04), metal, np.eye(4)),
    ]
    return parts + [Part(tube(ear, 0.065), metal, pose_of(turn=turn)) for turn in (0.0, np.pi)]


def trolley(rng: np.random.Generator) -> list[Part]:
    """A cart on spoked wheels with a basket of thin bars, a box in it and a long handle."""
    metal, rubber = plain(Kind.METAL, rng), plain(Kind.RUBBER, rng)
    wood, box, cloth = (patterned(kind, rng) for kind in (Kind.WOOD, Kind.PAINT, Kind.CLOTH))
    tyre, hub = wheel(0.36, 0.09, 8, 0.07)
    parts = [
        Part(rounded_box((1.0, 0.55, 0.05), 0.03), wood, pose_of((0, 0, 0.48))),
        Part(rounded_box((0.42, 0.3, 0.26), 0.04), box, pose_of((-0.35, 0.05, 0.79), 0.2)),
        Part(superquadric((0.3, 0.3, 0.24), 0.6), cloth, pose_of((0.5, -0.1, 0.77))),
    ]
    for x in (-0.65, 0.65):
        parts.append(Part(bar((x, -0.62, 0.36), (x, 0.62, 0.36), 0.035), metal, np.eye(4)))
        for y in (-0.64, 0.64):
            place = pose_of((x, y, 0.36)) @ _UP_TO_FRONT
            parts += [Part(tyre, rubber, place), Part(hub, metal, place)]
    rails = [((x, y, 0.5), (x, y, 1.05), 0.025) for x in np.linspace(-0.95, 0.95, 6) for y in (-0.5, 0.5)]
    rails += [((x, y, 0.5), (x, y, 1.05), 0.025) for x in (-0.95, 0.95) for y in (-0.25, 0.0, 0.25)]
    rails += [((-0.95, y, 1.05), (0.95, y, 1.05), 0.03) for y in (-0.5, 0.5)]
    rails += [((x, -0.5, 1.05), (x, 0.5, 1.05), 0.03) for x in (-0.95, 0.95)]
    rails += [((0.95, y, 0.5), (1.45, y, 1.5), 0.04) for y in (-0.4, 0.4)] + [
        ((1.45, -0.45, 1.5), (1.45, 0.45, 1.5), 0.05)
    ]
    return parts + [Part(bar(*rail), metal, np.eye(4)) for rail in rails]


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
            place = pose_of((sx * x, sy * np.abs(low[:, 1]).max(), 0.05)) @ _UP_TO_FRONT
            parts += [Part(tyre, first, place), Part(hub, second, place)]
    return parts


OBJECTS: dict[str, Callable[[np.random.Generator], list[Part]]] = {
    "radio": radio,
    "urn": urn,
    "trolley": trolley,
    "random": random_object,
}


def make_object(name: str, seed: int) -> list[Part]:
    """Return the parts of an object of `OBJECTS`, radius 1 about the origin, its materials drawn from a seed."""
    return normalised(OBJECTS[name](np.random.default_rng([seed, 1, list(OBJECTS).index(name)])))
