"""Poses from matches: features of a photo, the landmarks that look like them, and the cameras that many agree
on.

Features are SIFT (Lowe 2004) of the photo's log luma, in which a shadow's edge is as strong on dark parts as
on bright ones; descriptors are square roots of their shares (Arandjelovic & Zisserman 2012). They outlast
smooth changes of light; reflections they do not. Landmarks are features of the training photos with the
points of the mesh that they show.

A feature matches a landmark of a training photo when each is the other's most alike and the next most alike
is clearly less so; the training photos, each under another light, are matched one by one. Those with the most
matches vote with their neighbours: RANSAC over three to four matches each (Fischler & Bolles 1981), for every
focal length tried.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.extras import extra_library
from lightprobe.imaging import shrink_area
from lightprobe.localization.appearance import appearance
from lightprobe.render.asset import Asset
from lightprobe.render.surface import View, visible_surface
from lightprobe.scene import load_pixels
from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.photo import Photo

FEATURE_SIDE = 640  # pixels of the longer side in which points are found; smaller photos are magnified
_MAGNIFY = 2.0  # at most: beyond, there is nothing new
_CONTRAST = 0.04  # of SIFT's points, its usual value: fainter ones drown in the noise of dark photos
_LOW, _HIGH = -4.0, 0.1  # range of log luma that is shown
_ERODED = 5  # pixels: features of a masked photo keep this far from the outline, where the background begins
PER_PHOTO = 250  # landmarks: with 120 photos a file of 5 MB
_INSIDE = 0.9  # coverage of the object
_FINE = 2  # the mesh is rasterised so many times finer than the photo: a landmark's place is half a pixel's
_RATIO = 0.85  # distance to the most alike over that to the next
_VOTERS, _NEIGHBOURS = 6, 6  # training photos that poses are sought from, and photos that each is joined with
_ERROR = 4.0 / 320  # of an inlier, in the photo's longer side
_TRIALS = 2000  # of RANSAC
_FEWEST = 6  # inliers of a pose that is worth looking at
_FEWEST_LANDMARKS = 5  # of a training photo


@dataclass(frozen=True)
class Features:
    """N points of a photo."""

    place: np.ndarray  # (N, 2) float32 x and y in pixels of the photo
    descriptor: np.ndarray  # (N, 128) uint8, 255 times the square root of the shares


def load_opencv() -> ModuleType:
    """Return the module `cv2`, or raise `ConfigError` saying how to install it."""
    return extra_library("cv2", "Finding the camera of a photo")


def find_features(color: np.ndarray, count: int, mask: np.ndarray | None = None) -> Features:
    """Return the `count` strongest features of a linear photo (H, W, 3), inside `mask` (H, W) bool if given.

    Raises `ConfigError` without OpenCV.
    """
    cv2 = load_opencv()
    small = shrink_area(color, FEATURE_SIDE)
    height, width = small.shape[:2]
    scale = min(_MAGNIFY, FEATURE_SIDE / max(height, width))
    logs = appearance(torch.from_numpy(np.ascontiguousarray(small)))[..., 0].numpy()
    picture = (np.clip((logs - _LOW) / (_HIGH - _LOW), 0, 1) * 255).astype(np.uint8)
    if scale > 1:
        picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    inside = None
    if mask is not None:
        inside = cv2.resize(mask.astype(np.uint8) * 255, picture.shape[::-1], interpolation=cv2.INTER_AREA)
        inside = cv2.erode((inside > 250).astype(np.uint8) * 255, np.ones((_ERODED, _ERODED), np.uint8))
    points, descriptors = cv2.SIFT_create(contrastThreshold=_CONTRAST).detectAndCompute(picture, inside)
    if descriptors is None:
        return Features(np.zeros((0, 2), np.float32), np.zeros((0, 128), np.uint8))
    strongest = np.argsort([-point.response for point in points], kind="stable")[:count]
    to_photo = np.array([color.shape[1] / picture.shape[1], color.shape[0] / picture.shape[0]])
    place = (np.array([points[i].pt for i in strongest]) + 0.5) * to_photo
    share = descriptors[strongest] / np.maximum(descriptors[strongest].sum(1, keepdims=True), 1e-6)
    return Features(place.astype(np.float32), np.rint(255 * np.sqrt(share)).astype(np.uint8))


@dataclass(frozen=True)
class Landmarks:
    """N points of the object; several photos may show the same."""

    descriptor: Tensor  # (N, 128) uint8 as in `Features`
    point: Tensor  # (N, 3) float32, normalised frame
    photo: Tensor  # (N,) int32 which of the V training photos showed it, ascending
    side: Tensor  # (V, 3) float32 unit direction from the object's origin to each training photo's camera


def find_landmarks(
    asset: Asset, photos: Sequence[Photo], similarity: Similarity, on_photo: Callable[[int, int], None]
) -> Landmarks:
    """Return the landmarks of training photos on the asset; `on_photo` hears (photos done, photos)."""
    parts = []
    for index, photo in enumerate(photos):
        descriptor, point = _of_photo(asset, photo, similarity)
        parts.append((descriptor, point, torch.full((len(point),), index, dtype=torch.int32)))
        on_photo(index + 1, len(photos))
    position = np.stack([photo.camera.normalised(similarity).position for photo in photos])
    side = torch.as_tensor(position / np.linalg.norm(position, axis=1, keepdims=True), dtype=torch.float32)
    descriptor, point, number = (torch.cat(part) for part in zip(*parts, strict=True))
    return Landmarks(descriptor, point, number, side)


def _of_photo(asset: Asset, photo: Photo, similarity: Similarity) -> tuple[Tensor, Tensor]:
    """Return descriptors (N, 128) and points (N, 3) of one photo."""
    pixels, camera = load_pixels(photo, FEATURE_SIDE)
    features = find_features(pixels.color, PER_PHOTO, pixels.alpha >= _INSIDE)
    fine = camera.normalised(similarity).resized(camera.width * _FINE, camera.height * _FINE)
    view = View.of(fine, asset.mesh.vertices.device)
    surface = visible_surface(asset.mesh.vertices, asset.mesh.faces, view)
    if not len(surface.pixel):
        return torch.zeros(0, 128, dtype=torch.uint8), torch.zeros(0, 3)
    row = np.full(fine.width * fine.height, -1)
    row[surface.pixel.cpu().numpy()] = np.arange(len(surface.pixel))
    column, line = (features.place * _FINE).astype(int).T.clip(0, [[fine.width - 1], [fine.height - 1]])
    hit = row[line * fine.width + column]
    seen = hit >= 0
    return torch.from_numpy(features.descriptor[seen]), surface.position.cpu()[torch.from_numpy(hit[seen])]


def matched_poses(
    features: Features, landmarks: Landmarks, focals: Sequence[float], width: int, height: int
) -> list[tuple[Camera, int]]:
    """Return the cameras that enough matches agree about with how many do, most inliers first.

    focals: focal lengths in pixels. At most one camera for each voting photo and focal length. Raises
    `ConfigError` without OpenCV.
    """
    pairs = _pairs(features, landmarks)
    counts = np.array([len(feature) for feature, _ in pairs])
    cosine = (landmarks.side @ landmarks.side.T).numpy()
    found = []
    for voter in np.argsort(-counts, kind="stable")[:_VOTERS]:
        near = np.argsort(-cosine[voter], kind="stable")[:_NEIGHBOURS]
        feature, landmark = (torch.cat([pairs[photo][side] for photo in near]) for side in (0, 1))
        if len(feature) < _FEWEST:
            continue
        place = features.place[feature.numpy()].astype(np.float64)
        point = landmarks.point[landmark].double().numpy()
        found += [pose for focal in focals if (pose := _pose(place, point, focal, width, height)) is not None]
    return sorted(found, key=lambda pose: -pose[1])


def _pairs(features: Features, landmarks: Landmarks) -> list[tuple[Tensor, Tensor]]:
    """Return for every training photo the rows (M,) of matching features and landmarks."""
    mine, theirs = (d.float() / 255 for d in (torch.from_numpy(features.descriptor), landmarks.descriptor))
    distance = (2 - 2 * (mine @ theirs.T).clamp(max=1)).sqrt()
    photos = torch.arange(len(landmarks.side) + 1, dtype=torch.int32)
    bounds = torch.searchsorted(landmarks.photo, photos).tolist()
    own = torch.arange(len(mine))
    pairs = []
    for first, last in itertools.pairwise(bounds):
        if last - first < _FEWEST_LANDMARKS or len(mine) == 0:
            pairs.append((own[:0], own[:0]))
            continue
        part = distance[:, first:last]
        nearest = part.topk(2, 1, largest=False)
        best = nearest.indices[:, 0]
        good = (nearest.values[:, 0] < _RATIO * nearest.values[:, 1]) & (part.argmin(0)[best] == own)
        rows = good.nonzero()[:, 0]
        pairs.append((rows, best[rows] + first))
    return pairs


def _pose(
    place: np.ndarray, point: np.ndarray, focal: float, width: int, height: int
) -> tuple[Camera, int] | None:
    cv2 = load_opencv()
    cv2.setRNGSeed(0)
    matrix = np.array([[focal, 0, 0.5 * width], [0, focal, 0.5 * height], [0, 0, 1]])
    try:
        sound, turn, shift, inliers = cv2.solvePnPRansac(
            point,
            place,
            matrix,
            None,
            iterationsCount=_TRIALS,
            confidence=0.9999,
            reprojectionError=_ERROR * max(width, height),
            flags=cv2.SOLVEPNP_SQPNP,
        )
    except cv2.error:  # matches in a line, or at one point
        return None
    if not sound or inliers is None or len(inliers) < _FEWEST:
        return None
    rows = inliers[:, 0]
    turn, shift = cv2.solvePnPRefineLM(point[rows], place[rows], matrix, None, turn, shift)
    rotation = cv2.Rodrigues(turn)[0] * np.array([[1], [-1], [-1]])  # OpenCV's axes: y down, looking along +z
    shift = shift[:, 0] * np.array([1, -1, -1])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation.T, -rotation.T @ shift
    if not np.isfinite(pose).all():
        return None
    return Camera(pose, focal, focal, 0.5 * width, 0.5 * height, width, height), len(rows)
