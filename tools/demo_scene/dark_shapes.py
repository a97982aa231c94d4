"""Surfaces of the dark test objects: a toy car, a camera and a lantern; all with hollows and parts in front
of others.

Notation as in `geometry`; every object is normalised like the coffee pot.
"""

import numpy as np

from .geometry import Part, joined, normalise, placed, revolve, rounded_box, smooth, sweep, turned

_AXLES = (-0.60, 0.58)  # where along the car its wheels stand
_WHEEL = 0.215  # their radius


def toy_car() -> list[Part]:
    """Return a car with arches over its wheels, a groove along its sides, a cabin and a bar over its tail."""
    return normalise([_car_body(), _cabin(), _wheels(), _tail_bar(), _bumpers()])


def _car_body() -> Part:
    def shape(points: np.ndarray) -> np.ndarray:
        x = points[:, 0]
        arch = np.max([np.sqrt(np.maximum((_WHEEL + 0.05) ** 2 - (x - at) ** 2, 0)) for at in _AXLES], axis=0)
        low = 0.13 + 1.25 * arch
        high = 0.54 - 0.09 * np.clip(x, 0, 1) ** 2 - 0.03 * np.exp(-(((x + 0.62) / 0.12) ** 2))
        z = low + (points[:, 2] + 1) / 2 * (high - low)
        wide = 0.43 * (1 - 0.10 * x**2) * (1 - 0.09 * np.exp(-(((z - 0.42) / 0.035) ** 2)))
        return np.stack([x * 1.02, points[:, 1] * wide, z], 1)

    return rounded_box("body", 4.5, (84, 44), shape)


def _cabin() -> Part:
    def shape(points: np.ndarray) -> np.ndarray:
        up = (points[:, 2] + 1) / 2
        x = -0.12 + points[:, 0] * (0.50 - 0.17 * up)
        return np.stack([x, points[:, 1] * (0.37 - 0.08 * up), 0.44 + 0.36 * up], 1)

    return rounded_box("cabin", 4.0, (34, 40), shape)


def _wheels() -> Part:
    tyre = smooth(
        [(0.135, -0.075), (0.19, -0.075), (_WHEEL, -0.05), (_WHEEL, 0.05), (0.19, 0.075), (0.135, 0.075)], 13
    )
    rim = np.array([[0.135, 0.075], [0.125, 0.03]])
    hub = smooth([(0.125, 0.03), (0.07, 0.025), (0.045, 0.05), (0.0, 0.055)], 9)
    wheel = revolve("wheels", [np.array([[0.0, -0.075], [0.135, -0.075]]), tyre, rim, hub], 32)
    return joined(
        [
            placed(wheel, turned("x", -side * 90), (at, side * 0.36, _WHEEL))
            for at in _AXLES
            for side in (-1, 1)
        ]
    )


def _tail_bar() -> Part:
    knots = [
        (-0.33, 0, 0.40),
        (-0.34, 0, 0.62),
        (-0.27, 0, 0.745),
        (0, 0, 0.76),
        (0.27, 0, 0.745),
        (0.34, 0, 0.62),
    ]
    path = smooth([*knots, (0.33, 0, 0.40)], 33)
    return placed(
        sweep("tail_bar", path, np.full((33, 2), [0.028, 0.055]), 14), turned("z", 90), (-0.78, 0.0, 0.0)
    )


def _bumpers() -> Part:
    path = smooth([(-0.40, 0, 0), (-0.36, 0, 0.10), (0, 0, 0.15), (0.36, 0, 0.10), (0.40, 0, 0)], 29)
    bar = sweep("bumpers", path, np.full((29, 2), 0.042), 14)
    flat = turned("z", -90) @ turned("x", -90)  # the path's bow points forwards
    return joined(
        [placed(bar, flat, (0.95, 0, 0.24)), placed(bar, turned("z", 180) @ flat, (-0.95, 0, 0.24))]
    )


def camera() -> list[Part]:
    """Return a reflex camera: a box with a grip, a finder's hump, a hollow lens, dials and strap loops."""
    return normalise([_housing(), _grip(), _hump(), _lens(), _dials(), _loops()])


def _housing() -> Part:
    return rounded_box("housing", 6.0, (30, 40), lambda p: p * [0.86, 0.27, 0.50])


def _grip() -> Part:
    def shape(points: np.ndarray) -> np.ndarray:
        waist = 1 - 0.18 * np.exp(-(((points[:, 2] - 0.1) / 0.35) ** 2))
        return np.stack(
            [-0.66 + 0.19 * points[:, 0], -0.27 + 0.21 * points[:, 1] * waist, 0.47 * points[:, 2]], 1
        )

    return rounded_box("grip", 3.5, (24, 40), shape)


def _hump() -> Part:
    def shape(points: np.ndarray) -> np.ndarray:
        up = (points[:, 2] + 1) / 2
        return np.stack(
            [
                0.06 + points[:, 0] * (0.36 - 0.14 * up),
                -0.02 + points[:, 1] * (0.30 - 0.08 * up),
                0.42 + 0.32 * up,
            ],
            1,
        )

    return rounded_box("hump", 4.5, (24, 36), shape)


def _lens() -> Part:
    mount = np.array([[0.40, 0.20], [0.40, 0.36]])
    step = np.array([[0.40, 0.36], [0.36, 0.38]])
    barrel = smooth(
        [(0.36, 0.38), (0.35, 0.46), (0.375, 0.50), (0.375, 0.66), (0.35, 0.70), (0.36, 0.86)], 25
    )
    lip = smooth([(0.36, 0.86), (0.352, 0.885), (0.332, 0.88), (0.325, 0.85)], 7)
    funnel = smooth([(0.325, 0.85), (0.27, 0.77), (0.22, 0.68)], 5)
    glass = smooth([(0.22, 0.68), (0.15, 0.725), (0.07, 0.745), (0.0, 0.75)], 9)
    part = revolve("lens", [mount, step, barrel, lip, funnel, glass], 56)
    return placed(part, turned("x", 90), (0.06, 0.0, -0.05))


def _dials() -> Part:
    side = smooth([(0.105, 0.48), (0.105, 0.56), (0.115, 0.575), (0.115, 0.62), (0.10, 0.635)], 13)
    top = smooth([(0.10, 0.635), (0.06, 0.615), (0.0, 0.612)], 5)
    dial = revolve("dials", [side, top], 28)
    return joined(
        [
            placed(dial, np.eye(3), at)
            for at in ((0.64, 0.02, 0.0), (-0.46, 0.06, -0.03), (-0.68, -0.32, -0.1))
        ]
    )


def _loops() -> Part:
    angle = np.linspace(0, 2 * np.pi, 25)
    path = np.stack([0.075 * np.cos(angle), 0 * angle, 0.095 * np.sin(angle)], 1)
    tangent = np.stack([-0.075 * np.sin(angle), 0 * angle, 0.095 * np.cos(angle)], 1)
    loop = sweep("loops", path, np.full((25, 2), 0.022), 10, tangent)
    return joined([placed(loop, np.eye(3), (side * 0.90, 0.0, 0.32)) for side in (-1, 1)])


def lantern() -> list[Part]:
    """Return a lantern: a dished foot, a globe behind bars, a roof with a rim, a ring to carry it by."""
    return normalise([_foot(), _globe(), _bars(), _roof(), _ring()])


def _foot() -> Part:
    under = [np.array([[0.0, 0.05], [0.42, 0.04]]), np.array([[0.42, 0.04], [0.45, 0.0]])]
    side = smooth(
        [(0.45, 0.0), (0.58, 0.005), (0.615, 0.05), (0.58, 0.11), (0.56, 0.17), (0.60, 0.22), (0.595, 0.25)],
        21,
    )
    dish = smooth([(0.595, 0.25), (0.57, 0.255), (0.52, 0.20), (0.40, 0.175), (0.24, 0.20), (0.20, 0.30)], 17)
    return revolve("foot", [*under, side, dish], 56)


def _globe() -> Part:
    wall = smooth(
        [(0.20, 0.27), (0.31, 0.33), (0.41, 0.50), (0.42, 0.70), (0.33, 0.93), (0.25, 1.06), (0.24, 1.18)], 29
    )
    return revolve("globe", [wall], 56)


def _bars() -> Part:
    knots = [(0.54, 0, 0.17), (0.57, 0, 0.40), (0.575, 0, 0.68), (0.53, 0, 0.95), (0.47, 0, 1.16)]
    bar = sweep("bars", smooth(knots, 25), np.full((25, 2), [0.03, 0.045]), 12)
    return joined([placed(bar, turned("z", 90 * k + 20), (0, 0, 0)) for k in range(4)])


def _roof() -> Part:
    under = smooth([(0.22, 1.16), (0.36, 1.13), (0.52, 1.10)], 5)
    rim = smooth([(0.52, 1.10), (0.575, 1.10), (0.585, 1.135), (0.55, 1.165)], 7)
    slope = smooth([(0.55, 1.165), (0.42, 1.22), (0.30, 1.33), (0.25, 1.46), (0.27, 1.53), (0.22, 1.57)], 23)
    top = smooth([(0.22, 1.57), (0.12, 1.60), (0.07, 1.65), (0.0, 1.66)], 9)
    return revolve("roof", [under, rim, slope, top], 56)


def _ring() -> Part:
    angle = np.linspace(0, 2 * np.pi, 41)
    path = np.stack([0.20 * np.cos(angle), 0 * angle, 1.84 + 0.22 * np.sin(angle)], 1)
    tangent = np.stack([-0.20 * np.sin(angle), 0 * angle, 0.22 * np.cos(angle)], 1)
    return sweep("ring", path, np.full((41, 2), 0.036), 14, tangent)
