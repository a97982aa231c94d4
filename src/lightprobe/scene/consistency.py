"""Do masks and cameras agree? The visual hull's silhouettes against the masks, and what may be wrong if not.

Overlap is intersection over union (IoU) of silhouette and mask in pixels: 1 is agreement.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.imaging import shrink_area
from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.hull import Hull, visual_hull
from lightprobe.scene.normalise import find_similarity

_TRIAL_PHOTOS, _TRIAL_SIDE, _TRIAL_RESOLUTION = 24, 96, 48  # few, small, coarse: each trial carves a hull
_CLEARLY_BETTER, _CONVINCING = 0.1, 0.6  # gain in IoU, and IoU, that make a suspicion worth a word


def fitted_hull(
    cameras: Sequence[Camera],
    alphas: Sequence[np.ndarray],
    similarity: Similarity,
    resolution: int,
    *,
    agreement: float | None = None,
) -> Hull:
    """Return the hull, in the normalised frame, of input-frame `cameras` on a grid that fits it closely.

    alphas: a mask (H, W) for each camera.
    """
    normalised = [camera.normalised(similarity) for camera in cameras]
    rough = visual_hull(normalised, alphas, resolution // 2, agreement=agreement)
    if not rough.occupancy.any():
        return rough
    points = rough.centers(rough.occupancy)
    low, high = points.min(axis=0) - 2 * rough.voxel, points.max(axis=0) + 2 * rough.voxel
    return visual_hull(normalised, alphas, resolution, lo=low, hi=high, agreement=agreement)


def silhouette(hull: Hull, camera: Camera, similarity: Similarity, shape: tuple[int, ...]) -> np.ndarray:
    """Return the hull's (height, width) bool picture of size `shape` for an input-frame `camera`."""
    return hull.silhouette(camera.normalised(similarity).resized(shape[1], shape[0]))


def overlap(mask: np.ndarray, picture: np.ndarray) -> float:
    """Return the IoU of two bool pictures (H, W); 1 when both are empty."""
    union = int((mask | picture).sum())
    return float((mask & picture).sum() / union) if union else 1.0


def look_inverted(alphas: Sequence[np.ndarray]) -> bool:
    """Tell whether most masks (H, W) fill the rim of their photo and leave out something inside it.

    The hull cannot tell: the space around an object is as consistent as the object.
    """
    rims = [np.concatenate([alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]]) >= 0.5 for alpha in alphas]
    pairs = zip(rims, alphas, strict=True)
    return sum(rim.mean() > 0.9 and (alpha < 0.5).mean() > 0.01 for rim, alpha in pairs) > len(alphas) / 2


def better_turn(mask: np.ndarray, picture: np.ndarray) -> tuple[str, float] | None:
    """Return how a mask (h, w) bool must turn to fit the hull's silhouette much better, and its IoU then."""
    turned = [(words, turn(mask)) for words, turn in _TURNS]
    fits = [(words, overlap(shape, picture)) for words, shape in turned if shape.shape == picture.shape]
    words, best = max(fits, key=lambda fit: fit[1])
    return (words, best) if best > overlap(mask, picture) + _CLEARLY_BETTER and best >= _CONVINCING else None


def diagnose(cameras: Sequence[Camera], alphas: Sequence[np.ndarray], found: float) -> str | None:
    """Return a sentence naming the convention under which masks and cameras agree much better, or None.

    alphas: a mask (H, W) for each camera. `found` is the overlap as things are. Each of the usual mistakes is
    undone in turn, on a few small masks, and the hull is carved anew.
    """
    chosen = np.unique(np.linspace(0, len(alphas) - 1, min(len(alphas), _TRIAL_PHOTOS)).astype(int))
    small = [(cameras[i], shrink_area(alphas[i], _TRIAL_SIDE)) for i in chosen]
    trials = [(_trial(small, change), sentence) for sentence, change in _SUSPICIONS]
    best, sentence = max(trials, key=lambda trial: trial[0])
    if best < max(found + _CLEARLY_BETTER, _CONVINCING):
        return None
    better = f"IoU {best:.2f} instead of {found:.2f}"
    return f"{sentence} (the visual hull then agrees with the masks at {better})."


Change = Callable[[Camera, np.ndarray], tuple[Camera, np.ndarray]]


def _trial(views: Sequence[tuple[Camera, np.ndarray]], change: Change) -> float:
    """Return the median overlap after `change`; 0 when no hull exists."""
    changed = [change(*view) for view in views]
    cameras, alphas = zip(*changed, strict=True)
    if any(alpha.max() < 0.5 for alpha in alphas):
        return 0.0
    try:
        similarity = find_similarity(cameras, alphas)
    except InputError:
        return 0.0
    hull = fitted_hull(cameras, alphas, similarity, _TRIAL_RESOLUTION)
    return float(np.median([overlap(a >= 0.5, silhouette(hull, c, similarity, a.shape)) for c, a in changed]))


def _columns(camera: Camera, axes: np.ndarray) -> Camera:
    """Return the camera with its axes [right, up, back] recombined by the (3, 3) matrix `axes`."""
    pose = camera.camera_to_world.copy()
    pose[:3, :3] = pose[:3, :3] @ axes
    return replace(camera, camera_to_world=pose, lens=None)


def _inverse(camera: Camera) -> Camera:
    return replace(camera, camera_to_world=np.linalg.inv(camera.camera_to_world), lens=None)


_OPENCV = np.diag([1.0, -1.0, -1.0])
_QUARTER = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])

# All that an EXIF orientation can ask for; quarter turns keep the shape of square photos only.
_TURNS: tuple[tuple[str, Callable[[np.ndarray], np.ndarray]], ...] = (
    ("turned by 180 degrees", lambda a: a[::-1, ::-1]),
    ("mirrored left to right", lambda a: a[:, ::-1]),
    ("flipped upside down", lambda a: a[::-1]),
    ("turned by 90 degrees clockwise", lambda a: np.rot90(a, -1)),
    ("turned by 90 degrees anticlockwise", lambda a: np.rot90(a)),
    ("turned by 90 degrees clockwise and mirrored", lambda a: np.rot90(a, -1)[:, ::-1]),
    ("turned by 90 degrees anticlockwise and mirrored", lambda a: np.rot90(a)[:, ::-1]),
)

_SUSPICIONS: tuple[tuple[str, Change], ...] = (
    ("The masks look inverted: the object must be white", lambda c, a: (c, 1 - a)),
    (
        "The cameras look like OpenCV's (y down, looking along +z): negate the second and third column of each matrix",
        lambda c, a: (_columns(c, _OPENCV), a),
    ),
    (
        "The camera matrices look like world-to-camera: store their inverses",
        lambda c, a: (_inverse(c), a),
    ),
    (
        "The camera matrices look like world-to-camera with OpenCV axes: store their inverses, then negate the second "
        "and third column",
        lambda c, a: (_columns(_inverse(c), _OPENCV), a),
    ),
    ("The photos look mirrored left to right against the cameras", lambda c, a: (c, a[:, ::-1])),
    ("The photos look flipped upside down against the cameras", lambda c, a: (c, a[::-1])),
    ("The photos look turned by 180 degrees against the cameras", lambda c, a: (c, a[::-1, ::-1])),
    (
        "The cameras look turned by 90 degrees about their view axis: check the order of the axis columns",
        lambda c, a: (_columns(c, _QUARTER), a),
    ),
    (
        "The cameras look turned by -90 degrees about their view axis: check the order of the axis columns",
        lambda c, a: (_columns(c, _QUARTER.T), a),
    ),
)
