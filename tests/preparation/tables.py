"""A box on textured tables in several places, drawn without a renderer: planes of pictures warped by homographies."""

import numpy as np

from lightprobe.preparation.voxel_labelling import View
from lightprobe.scene.camera import Camera
from tests.preparation.ring import true_solution
from tests.shapes import camera_at

SIZE = 160
HALF = np.array([0.35, 0.25, 0.5])  # of the box's sides; it stands on z = -HALF[2]
TEXELS = 256
REACH = 2.5  # of the table
_FACES = [(axis, sign) for axis in range(3) for sign in (-1.0, 1.0)]


def cameras_around(count: int, turn: float) -> list[Camera]:
    """Return cameras above the table that look at the box."""
    angles = turn + 2 * np.pi * np.arange(count) / count
    return [
        camera_at((3 * np.cos(a), 3 * np.sin(a), 0.8 + 0.7 * (i % 2)), size=SIZE, focal=220)
        for i, a in enumerate(angles)
    ]


def texture(rng: np.random.Generator, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return a picture (TEXELS, TEXELS, 3) uint8 of blots between two colours (3,)."""
    import cv2

    blots = cv2.resize(
        rng.random((24, 24)).astype(np.float32), (TEXELS, TEXELS), interpolation=cv2.INTER_NEAREST
    )
    return (low + (high - low) * blots[..., None]).astype(np.uint8)


def homography(camera: Camera, origin: np.ndarray, across: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return (3, 3): cells of a plane, origin + column across + row along, to pixels' indices."""
    right, up, back = camera.camera_to_world[:3, :3].T
    rows = np.stack(
        [camera.fx * right - (camera.cx - 0.5) * back, -camera.fy * up - (camera.cy - 0.5) * back, -back]
    )
    return rows @ np.stack([across, along, origin - camera.position], axis=1)


def drawn(camera: Camera, table: np.ndarray, wall: np.ndarray, faces: list[np.ndarray]) -> tuple:
    """Return a photo (h, w, 3) uint8 of the box on its table before a wall (3,), and its true mask (h, w) bool."""
    import cv2

    picture, mask = np.tile(wall.astype(np.uint8), (SIZE, SIZE, 1)), np.zeros((SIZE, SIZE), bool)

    def paint(image: np.ndarray, origin: np.ndarray, across: np.ndarray, along: np.ndarray) -> np.ndarray:
        matrix = homography(camera, origin, across / TEXELS, along / TEXELS)
        shown = cv2.warpPerspective(np.full((TEXELS, TEXELS), 255, np.uint8), matrix, (SIZE, SIZE)) > 127
        picture[shown] = cv2.warpPerspective(image, matrix, (SIZE, SIZE), borderMode=cv2.BORDER_REPLICATE)[
            shown
        ]
        return shown

    corner = np.array([-REACH, -REACH, -HALF[2]])
    paint(table, corner, np.array([2 * REACH, 0, 0]), np.array([0, 2 * REACH, 0]))
    for (axis, sign), image in zip(_FACES, faces, strict=True):
        if sign * camera.position[axis] <= HALF[axis]:
            continue  # seen from behind
        origin = -HALF.copy()
        origin[axis] = sign * HALF[axis]
        sides = [np.eye(3)[other] * 2 * HALF[other] for other in range(3) if other != axis]
        mask |= paint(image, origin, *sides)
    return picture, mask


def world(places: int = 3, photos: int = 8, points: int = 60) -> tuple:
    """Return views, true masks, places by photo, and the true solution with points of the box and of the tables."""
    rng = np.random.default_rng(0)
    faces = [texture(rng, np.array([150, 30, 20]), np.array([220, 90, 60])) for _ in _FACES]
    views, truth, at, cameras, seen, space = {}, {}, {}, [], [], []
    on_box = rng.uniform(-1, 1, (points, 3)) * HALF
    axis = rng.integers(0, 3, points)
    on_box[np.arange(points), axis] = np.sign(on_box[np.arange(points), axis]) * HALF[axis]
    space.append(on_box)
    for place in range(places):
        dark = rng.uniform(20, 120, 3)
        table, wall = texture(rng, dark, dark + 60), rng.uniform(40, 200, 3)
        on_table = np.column_stack([rng.uniform(-1.5, 1.5, (points, 2)), np.full(points, -HALF[2])])
        around = (np.abs(on_table[:, :2]) > HALF[:2] + 0.05).any(1)
        space.append(on_table[around])
        first = sum(map(len, space[:-1]))
        for camera in cameras_around(photos, 0.3 * place):
            index = len(cameras)
            cameras.append(camera)
            color, truth[index] = drawn(camera, table, wall, faces)
            noisy = np.clip(color + rng.normal(0, 3, color.shape), 0, 255).astype(np.uint8)
            views[index], at[index] = View(camera, noisy, None, False), place
            seen += [(index, point) for point in [*range(points), *range(first, first + len(space[-1]))]]
    everything, (photo, point) = np.concatenate(space), np.array(seen).T
    solution = true_solution(cameras, everything, photo, np.zeros(len(photo), np.int64), point)
    return views, truth, at, solution
