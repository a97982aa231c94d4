"""Designed objects, each of a kind that people own: what it is made of varies with the seed, what kind it is does not.

Every maker returns parts that stand upright on their lowest point, z up, in any unit.
"""

import numpy as np

from demo_scene.geometry import smooth

from .materials import Kind, patterned, plain
from .models import Part, pose_of
from .shapes import bar, revolved, rounded_box, superquadric, tube, turned, wheel

UP_TO_FRONT = pose_of(turn=np.pi / 2, axis=(1, 0, 0))  # takes z to -y, the side that a person faces
_UPRIGHT = np.eye(4)


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
        Part(rounded_box((1, 0.38, 0.6), 0.08), paint, _UPRIGHT),
        Part(rounded_box((0.42, 0.05, 0.42), 0.03), front, pose_of((-0.42, -0.38, 0))),
        Part(rounded_box((0.34, 0.04, 0.16), 0.02), dial, pose_of((0.48, -0.38, 0.24))),
        Part(rounded_box((0.5, 0.05, 0.3), 0.02), cloth, pose_of((0.1, 0.38, -0.1))),
        Part(tube(handle, 0.07), wood, _UPRIGHT),
    ]
    parts += [Part(knob, rubber, pose_of((x, -0.37, -0.25)) @ UP_TO_FRONT) for x in (0.3, 0.68)]
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
        Part(revolved([belly]) + turned((0, 0.12), (0.38, 0.12)), glaze, _UPRIGHT),
        Part(revolved([dome, knob]) + turned((0.4, 1.57), (0.5, 1.57), (0.5, 1.6)), lid, _UPRIGHT),
        Part(turned((0, 0), (0.5, 0), (0.5, 0.06), (0.38, 0.16)), plain(Kind.WOOD, rng), _UPRIGHT),
        Part(tube(spout, 0.075), metal, _UPRIGHT),
        Part(bar((-0.16, -0.84, 0.52), (0.16, -0.84, 0.52), 0.04), metal, _UPRIGHT),
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
        parts.append(Part(bar((x, -0.62, 0.36), (x, 0.62, 0.36), 0.035), metal, _UPRIGHT))
        for y in (-0.64, 0.64):
            place = pose_of((x, y, 0.36)) @ UP_TO_FRONT
            parts += [Part(tyre, rubber, place), Part(hub, metal, place)]
    rails = [((x, y, 0.5), (x, y, 1.05), 0.025) for x in np.linspace(-0.95, 0.95, 6) for y in (-0.5, 0.5)]
    rails += [((x, y, 0.5), (x, y, 1.05), 0.025) for x in (-0.95, 0.95) for y in (-0.25, 0.0, 0.25)]
    rails += [((-0.95, y, 1.05), (0.95, y, 1.05), 0.03) for y in (-0.5, 0.5)]
    rails += [((x, -0.5, 1.05), (x, 0.5, 1.05), 0.03) for x in (-0.95, 0.95)]
    rails += [((0.95, y, 0.5), (1.45, y, 1.5), 0.04) for y in (-0.4, 0.4)] + [
        ((1.45, -0.45, 1.5), (1.45, 0.45, 1.5), 0.05)
    ]
    return parts + [Part(bar(*rail), metal, _UPRIGHT) for rail in rails]


def statuette(rng: np.random.Generator) -> list[Part]:
    """A matte figure in a robe, one arm raised, that holds a bowl and stands on a stone."""
    robe, skin = patterned(Kind.CLOTH, rng, 0.8), plain(Kind.PAINT, rng, np.array([0.55, 0.33, 0.22]))
    stone, sash = plain(Kind.STONE, rng), plain(Kind.CLOTH, rng)
    skirt = smooth([(0.42, 0.2), (0.36, 0.5), (0.22, 0.9), (0.2, 1.05), (0.27, 1.25), (0.22, 1.42)], 30)
    collar = turned(tuple(skirt[-1]), (0.1, 1.48), (0, 1.5))
    raised = smooth([(0.2, 0, 1.36), (0.38, -0.04, 1.3), (0.5, -0.14, 1.5), (0.48, -0.2, 1.78)], 20)
    held = smooth([(-0.2, 0, 1.34), (-0.36, -0.06, 1.14), (-0.28, -0.3, 1.0), (-0.06, -0.38, 1.0)], 20)
    bowl = smooth([(0.05, 0), (0.16, 0.05), (0.2, 0.14)], 12)
    brim = smooth([(0.24, 1.86), (0.16, 1.9), (0.12, 2.02), (0.0, 2.05)], 14)
    return [
        Part(rounded_box((0.52, 0.46, 0.1), 0.05), stone, pose_of((0, 0, 0.1))),
        Part(revolved([skirt]) + collar, robe, pose_of((0, 0, 0))),
        Part(turned((0.205, 0.93), (0.235, 0.95), (0.235, 1.03), (0.205, 1.05)), sash, _UPRIGHT),
        Part(superquadric((0.16, 0.17, 0.2), 0.9), skin, pose_of((0, -0.02, 1.68))),
        Part(superquadric((0.035, 0.06, 0.05), 0.9), skin, pose_of((0, -0.2, 1.66))),
        Part(revolved([brim]) + turned((0, 1.86), (0.24, 1.86)), sash, _UPRIGHT),
        Part(tube(raised, 0.075), robe, _UPRIGHT),
        Part(tube(held, 0.075), robe, _UPRIGHT),
        Part(superquadric((0.085, 0.085, 0.1), 0.9), skin, pose_of((0.48, -0.21, 1.84))),
        Part(superquadric((0.1, 0.08, 0.07), 0.9), skin, pose_of((0.0, -0.39, 1.0))),
        Part(
            revolved([bowl]) + turned((0.2, 0.14), (0.16, 0.11), (0, 0.11)),
            stone,
            pose_of((0.08, -0.46, 1.0)),
        ),
    ]


def engine(rng: np.random.Generator) -> list[Part]:
    """A toy locomotive in gloss paint, with chrome rods and rubber buffers."""
    body = patterned(Kind.LACQUER, rng, 0.7)
    frame = plain(Kind.LACQUER, rng, np.array([0.04, 0.05, 0.06]))
    red = plain(Kind.LACQUER, rng, np.array([0.6, 0.04, 0.03]))
    chrome, rubber = plain(Kind.CHROME, rng), plain(Kind.RUBBER, rng)
    boiler = turned((0, -0.75), (0.3, -0.75), (0.34, -0.7), (0.34, 0.55), (0, 0.55))
    funnel = turned((0.09, 0), (0.09, 0.22), (0.15, 0.38), (0.15, 0.42), (0.1, 0.42), (0.07, 0.3), (0, 0.3))
    dome = smooth([(0.13, 0), (0.13, 0.08), (0.09, 0.16), (0.0, 0.19)], 14)
    along = pose_of(turn=np.pi / 2, axis=(0, 1, 0))  # takes z to x, the way that it runs
    parts = [
        Part(rounded_box((1.15, 0.4, 0.07), 0.03), frame, pose_of((0, 0, 0.36))),
        Part(boiler, body, pose_of((0.3, 0, 0.78)) @ along),
        Part(rounded_box((0.36, 0.42, 0.42), 0.06), body, pose_of((-0.72, 0, 0.84))),
        Part(rounded_box((0.46, 0.5, 0.05), 0.04), red, pose_of((-0.72, 0, 1.3))),
        Part(rounded_box((0.2, 0.435, 0.14), 0.03), plain(Kind.GLASS, rng), pose_of((-0.7, 0, 0.98))),
        Part(funnel, frame, pose_of((0.72, 0, 1.08))),
        Part(revolved([dome]), chrome, pose_of((0.2, 0, 1.08))),
        Part(superquadric((0.06, 0.11, 0.11), 0.6), chrome, pose_of((1.0, 0, 0.94))),
    ]
    for side in (-1, 1):
        for x, size in ((-0.72, 0.34), (0.05, 0.26), (0.66, 0.26)):
            tyre, hub = wheel(size, 0.1, 8, 0.07)
            place = pose_of((x, 0.46 * side, size)) @ UP_TO_FRONT
            parts += [Part(tyre, frame, place), Part(hub, red, place)]
        parts.append(Part(bar((-0.72, 0.55 * side, 0.26), (0.66, 0.55 * side, 0.2), 0.035), chrome, _UPRIGHT))
        parts.append(
            Part(
                turned((0, 0), (0.09, 0), (0.09, 0.1), (0, 0.1)),
                rubber,
                pose_of((1.13, 0.26 * side, 0.4)) @ along,
            )
        )
    return parts


def tankard(rng: np.random.Generator) -> list[Part]:
    """A lidded mug of brushed metal with bands, a handle, a thumb rest and three feet."""
    metal, band, feet = (plain(Kind.METAL, rng) for _ in range(3))
    side = smooth([(0.52, 0.08), (0.5, 0.4), (0.44, 0.9), (0.42, 1.3)], 24)
    lid = smooth([(0.46, 1.32), (0.44, 1.4), (0.28, 1.5), (0.1, 1.53), (0.08, 1.6), (0.0, 1.66)], 20)
    ear = smooth([(0.4, 0, 1.2), (0.72, 0, 1.26), (0.86, 0, 0.95), (0.78, 0, 0.55), (0.48, 0, 0.36)], 28)
    thumb = smooth([(0.4, 0, 1.38), (0.54, 0, 1.46), (0.6, 0, 1.62), (0.52, 0, 1.72)], 14)
    ring = ((0, -0.05), (0.02, -0.05), (0.035, 0), (0.02, 0.05), (0, 0.05))
    rings = [
        Part(turned(*((radius + r, z + h) for r, h in ring)), band, _UPRIGHT)
        for radius, z in ((0.505, 0.2), (0.485, 0.55), (0.43, 1.1))
    ]
    shield = superquadric((0.2, 0.06, 0.25), 0.5)
    return [
        Part(
            turned((0, 0.08), (0.52, 0.08)) + revolved([side]) + turned((0.42, 1.3), (0, 1.3)),
            metal,
            _UPRIGHT,
        ),
        Part(turned((0, 1.32), (0.46, 1.32)) + revolved([lid]), metal, _UPRIGHT),
        Part(tube(ear, 0.055), metal, _UPRIGHT),
        Part(tube(thumb, 0.04), band, _UPRIGHT),
        Part(shield, feet, pose_of((0, -0.45, 0.82))),
        *rings,
        *(
            Part(
                superquadric((0.1, 0.1, 0.09), 1.0), feet, pose_of((0.42 * np.cos(a), 0.42 * np.sin(a), 0.08))
            )
            for a in np.radians([90, 210, 330])
        ),
    ]


def helmet(rng: np.random.Generator) -> list[Part]:
    """A dark glossy helmet with a visor, a coloured stripe and a rubber rim."""
    shell = plain(Kind.LACQUER, rng, np.array([0.025, 0.03, 0.045]))
    stripe, trim = plain(Kind.LACQUER, rng, np.array([0.55, 0.3, 0.02])), plain(Kind.RUBBER, rng)
    visor, bolt = plain(Kind.GLASS, rng), plain(Kind.CHROME, rng)
    low = smooth(
        [(0.62, 0.0), (0.72, 0.12), (0.8, 0.4), (0.78, 0.75), (0.62, 1.1), (0.34, 1.32), (0.0, 1.38)], 36
    )
    bolts = [
        Part(superquadric((0.05, 0.09, 0.09), 0.7), bolt, pose_of((0.76 * side, -0.2, 0.62)))
        for side in (-1, 1)
    ]
    over = smooth([(0.03, -0.68, 0.98), (0.03, -0.3, 1.32), (0.03, 0.2, 1.37), (0.03, 0.66, 1.02)], 24)
    stretched = np.diag([1.0, 1.12, 1.0, 1.0])
    return [
        Part(turned((0, 0.0), (0.62, 0.0)) + revolved([low]), shell, stretched),
        Part(superquadric((0.6, 0.35, 0.22), 0.55), visor, pose_of((0, -0.63, 0.6))),
        Part(rounded_box((0.4, 0.14, 0.12), 0.08), shell, pose_of((0, -0.8, 0.18))),
        Part(rounded_box((0.66, 0.2, 0.05), 0.04), trim, pose_of((0, -0.72, 0.88), 0.25, (1, 0, 0))),
        Part(tube(over, 0.09), stripe, _UPRIGHT),
        Part(turned((0.58, -0.06), (0.68, -0.06), (0.7, 0.04), (0.6, 0.04)), trim, stretched),
        *bolts,
    ]


def can(rng: np.random.Generator) -> list[Part]:
    """A watering can of saturated plastic, its parts of two colours."""
    hue = rng.permutation(np.array([0.75, 0.12, 0.03]))
    first, second = plain(Kind.PLASTIC, rng, hue), plain(Kind.PLASTIC, rng, np.roll(hue, 1))
    label = patterned(Kind.PLASTIC, rng, 0.5)
    side = smooth([(0.5, 0.0), (0.56, 0.1), (0.54, 0.5), (0.44, 0.85), (0.4, 0.95)], 24)
    spout = smooth([(-0.4, 0, 0.2), (-0.75, 0, 0.45), (-0.95, 0, 0.85), (-1.15, 0, 1.15)], 24)
    top = smooth([(-0.3, 0, 0.92), (-0.2, 0, 1.3), (0.15, 0, 1.36), (0.34, 0, 0.92)], 24)
    back = smooth([(0.42, 0, 0.85), (0.78, 0, 0.82), (0.82, 0, 0.45), (0.52, 0, 0.2)], 24)
    rose = turned((0, 0), (0.09, 0), (0.24, 0.16), (0.24, 0.2), (0, 0.22))
    ridge = turned((0.55, 0.28), (0.6, 0.3), (0.6, 0.36), (0.55, 0.38))
    return [
        Part(turned((0, 0), (0.5, 0)) + revolved([side]) + turned((0.4, 0.95), (0, 0.97)), first, _UPRIGHT),
        Part(ridge, second, _UPRIGHT),
        Part(tube(spout, 0.09), second, _UPRIGHT),
        Part(rose, first, pose_of((-1.13, 0, 1.11), -np.pi / 4, (0, 1, 0))),
        Part(tube(top, 0.06), second, _UPRIGHT),
        Part(tube(back, 0.06), second, _UPRIGHT),
        Part(rounded_box((0.2, 0.05, 0.2), 0.04), label, pose_of((0, -0.5, 0.62))),
    ]


def duck(rng: np.random.Generator) -> list[Part]:
    """A wooden duck on wheels, of three woods, with painted eyes and beak."""
    body, board, dark = patterned(Kind.WOOD, rng), plain(Kind.WOOD, rng), plain(Kind.WOOD, rng)
    beak, cord = plain(Kind.PAINT, rng, np.array([0.6, 0.25, 0.03])), plain(Kind.CLOTH, rng)
    neck = smooth([(0.3, 0.55), (0.24, 0.75), (0.2, 0.95), (0.22, 1.1)], 16)
    pull = smooth([(0.9, 0, 0.24), (1.15, 0, 0.2), (1.3, 0.1, 0.1), (1.42, 0.3, 0.06)], 20)
    parts = [
        Part(rounded_box((0.85, 0.4, 0.06), 0.04), board, pose_of((0, 0, 0.24))),
        Part(superquadric((0.72, 0.4, 0.34), 0.85), body, pose_of((-0.08, 0, 0.62))),
        Part(superquadric((0.34, 0.16, 0.12), 0.8), dark, pose_of((-0.78, 0, 0.84), 0.5, (0, 1, 0))),
        Part(revolved([neck]), body, pose_of((0.42, 0, 0.15))),
        Part(superquadric((0.3, 0.26, 0.26), 0.95), dark, pose_of((0.5, 0, 1.36))),
        Part(superquadric((0.2, 0.14, 0.05), 0.8), beak, pose_of((0.84, 0, 1.32))),
        Part(tube(pull, 0.025), cord, _UPRIGHT),
    ]
    for side in (-1, 1):
        eye = superquadric((0.05, 0.03, 0.05), 1.0)
        parts.append(
            Part(superquadric((0.36, 0.07, 0.2), 0.8), dark, pose_of((-0.16, 0.38 * side, 0.66), 0.2 * side))
        )
        parts.append(
            Part(eye, plain(Kind.LACQUER, rng, np.full(3, 0.02)), pose_of((0.62, 0.235 * side, 1.42)))
        )
        for x in (-0.55, 0.55):
            disc = turned((0, -0.05), (0.2, -0.05), (0.2, 0.05), (0, 0.05))
            parts.append(Part(disc, board, pose_of((x, 0.48 * side, 0.2)) @ UP_TO_FRONT))
    return parts
