"""Poses from matches: features of a photo, the landmarks that look like them, and the cameras that many agree
on.

Features are learned ones (`preparation.learned`), found in the photo's log luma, in which a shadow's edge is as strong
on dark parts as on bright ones. Landmarks are features of the training photos with the points of the mesh that they
show.

Each training photo shows the object under another light. Those with most features that are each other's most alike are
matched one by one with the photo. The ones with the most matches vote with their neighbours: RANSAC over three to four
matches each (Fischler & Bolles 1981), for every focal length tried.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.extras import extra_library
from lightprobe.core.threads import in_threads
from lightprobe.imaging import shrink_area
from lightprobe.localization.appearance import appearance
from lightprobe.preparation import learned
from lightprobe.render.asset import Asset
from lightprobe.render.surface import View, visible_surface
from lightprobe.scene import load_pixels
from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.photo import Photo

FEATURE_SIDE = 960  # pixels of the longer side in which points are found; smaller photos are magnified
_MAGNIFY = 2.0  # at most: beyond, there is nothing new
_LOW, _HIGH = -4.0, 0.1  # range of log luma that is shown
_ERODED = 5  # pixels: features of a masked photo keep this far from the outline, where the background begins
_FOUND = 2048  # features of a masked photo, most of which may lie beside the object
_MATCHED = 500  # features of a photo that are matched: those most like a landmark
PER_PHOTO = 250  # landmarks: with 120 photos a file of 5 MB
_INSIDE = 0.9  # coverage of the object
_FINE = 2  # the mesh is rasterised so many times finer than the photo: a landmark's place is half a pixel's
_ALIKE = 0.8  # cosine of descriptors that may be of one place
_PARTNERS = 16  # training photos that a photo is matched with
_VOTERS, _NEIGHBOURS = 6, 6  # of these, that poses are sought from, and photos that each is joined with
_ERROR = 4.0 / 320  # of an inlier, in the photo's longer side
_TOLERANCE = 2.0 / 320  # likewise: distance of a feature at which it counts a quarter
_REACH = 5.0  # times as far it does not count
_FEW = 20  # features that agree fully when all of so many do
_TRIALS = 2000  # of RANSAC
_FEWEST = 6  # inliers of a pose that is worth looking at


@dataclass(frozen=True)
class Features:
    """N points of a photo, likeliest first."""

    place: np.ndarray  # (N, 2) float32 x and y in pixels of the photo
    descriptor: np.ndarray  # (N, 64) float32
    size: tuple[int, int]  # width and height of the photo


def load_opencv() -> ModuleType:
    """Return the module `cv2`, or raise `ConfigError` saying how to install it."""
    return extra_library("cv2", "Finding the camera of a photo")


def find_features(color: np.ndarray, count: int, mask: np.ndarray | None = None) -> Features:
    """Return the `count` likeliest features of a linear photo (H, W, 3), inside `mask` (H, W) bool if given.

    Raises `ConfigError` without OpenCV or the network's weights.
    """
    cv2 = load_opencv()
    small = shrink_area(color, FEATURE_SIDE)
    scale = min(_MAGNIFY, FEATURE_SIDE / max(small.shape[:2]))
    logs = appearance(torch.from_numpy(np.ascontiguousarray(small)))[..., 0].numpy()
    picture = (np.clip((logs - _LOW) / (_HIGH - _LOW), 0, 1) * 255).astype(np.uint8)
    if scale > 1:
        picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    place, descriptor = learned.find(picture, count if mask is None else _FOUND)
    if mask is not None:
        inside = cv2.resize(mask.astype(np.uint8) * 255, picture.shape[::-1], interpolation=cv2.INTER_AREA)
        inside = cv2.erode((inside > 250).astype(np.uint8), np.ones((_ERODED, _ERODED), np.uint8))
        kept = np.flatnonzero(inside[tuple(place.astype(int).T[::-1])])[:count]
        place, descriptor = place[kept], descriptor[kept]
    height, width = color.shape[:2]
    to_photo = np.array([width / picture.shape[1], height / picture.shape[0]], np.float32)
    return Features(place * to_photo, descriptor, (width, height))


@dataclass(frozen=True)
class Landmarks:
    """N points of the object; several photos may show the same."""

    descriptor: Tensor  # (N, 64) float16 as in `Features`
    place: Tensor  # (N, 2) float32 as in `Features`
    point: Tensor  # (N, 3) float32, normalised frame
    photo: Tensor  # (N,) int32 which of the V training photos showed it, ascending
    side: Tensor  # (V, 3) float32 unit direction from the object's origin to each training photo's camera
    size: Tensor  # (V, 2) int32 width and height of each training photo, as landmarks were found in it

    def of_photo(self, photo: int) -> tuple[slice, Features]:
        """Return the rows of one training photo's landmarks, and these as features."""
        first, last = torch.searchsorted(
            self.photo, torch.tensor([photo, photo + 1], dtype=torch.int32)
        ).tolist()
        rows = slice(first, last)
        width, height = self.size[photo].tolist()
        return rows, Features(
            self.place[rows].numpy(), self.descriptor[rows].float().numpy(), (width, height)
        )


def find_landmarks(
    asset: Asset, photos: Sequence[Photo], similarity: Similarity, on_photo: Callable[[int, int], None]
) -> Landmarks:
    """Return the landmarks of training photos on the asset; `on_photo` hears (photos done, photos)."""
    parts, sizes = [], []
    for index, photo in enumerate(photos):
        features, point = _of_photo(asset, photo, similarity)
        number = torch.full((len(point),), index, dtype=torch.int32)
        parts.append(
            (torch.from_numpy(features.descriptor).half(), torch.from_numpy(features.place), point, number)
        )
        sizes.append(features.size)
        on_photo(index + 1, len(photos))
    position = np.stack([photo.camera.normalised(similarity).position for photo in photos])
    side = torch.as_tensor(position / np.linalg.norm(position, axis=1, keepdims=True), dtype=torch.float32)
    descriptor, place, point, number = (torch.cat(part) for part in zip(*parts, strict=True))
    return Landmarks(descriptor, place, point, number, side, torch.tensor(sizes, dtype=torch.int32))


def _of_photo(asset: Asset, photo: Photo, similarity: Similarity) -> tuple[Features, Tensor]:
    """Return the features of one photo that show the mesh, and the points (N, 3) that they show."""
    pixels, camera = load_pixels(photo, FEATURE_SIDE)
    features = find_features(pixels.color, PER_PHOTO, pixels.alpha >= _INSIDE)
    fine = camera.normalised(similarity).resized(camera.width * _FINE, camera.height * _FINE)
    view = View.of(fine, asset.mesh.vertices.device)
    surface = visible_surface(asset.mesh.vertices, asset.mesh.faces, view)
    row = np.full(fine.width * fine.height, -1)
    row[surface.pixel.cpu().numpy()] = np.arange(len(surface.pixel))
    column, line = (features.place * _FINE).astype(int).T.clip(0, [[fine.width - 1], [fine.height - 1]])
    hit = row[line * fine.width + column]
    seen = hit >= 0
    features = Features(features.place[seen], features.descriptor[seen], features.size)
    return features, surface.position.cpu()[torch.from_numpy(hit[seen])]


@dataclass(frozen=True)
class Matches:
    """Features of a photo and the points that they may show; one feature may match landmarks of several photos."""

    feature: np.ndarray  # (M,) int64
    place: np.ndarray  # (M, 2) float64 as in `Features`
    point: np.ndarray  # (M, 3) float64, normalised frame
    photo: np.ndarray  # (M,) int64 training photo of the landmark
    size: tuple[int, int]  # width and height of the photo

    def pull(self, camera: Camera) -> "Pull":
        """Return how the photo's features pull at a camera, in the pixels of its own size."""
        features = len(np.unique(self.feature))
        if not features:
            return Pull(0.0, np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0))
        scale = camera.width / self.size[0]
        tolerance = _TOLERANCE * max(camera.width, camera.height)
        seen = camera.project(self.point)
        off = np.where(seen[:, 2:] > 0, self.place * scale - seen[:, :2], np.inf)
        distance = np.hypot(*off.T) / tolerance
        order = np.lexsort((distance, self.feature))
        nearest = order[np.unique(self.feature[order], return_index=True)[1]]
        nearest = nearest[distance[nearest] < _REACH]
        agreement = 1 / (1 + distance[nearest] ** 2) ** 2
        count = max(features, _FEW)
        weight = agreement / (tolerance**2 * count)
        return Pull(float(agreement.sum()) / count, self.point[nearest], off[nearest], weight)


@dataclass(frozen=True)
class Pull:
    """Features that show a point of the object near where a camera sees it."""

    agreed: float  # share of all matched features, 0 to 1, each less for being farther off
    point: np.ndarray  # (K, 3) float64, normalised frame
    off: np.ndarray  # (K, 2) pixels from where the camera sees it to the feature
    weight: np.ndarray  # (K,) of the squared distance


NO_MATCHES = Matches(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 3)), np.zeros(0, np.int64), (1, 1))


def match_landmarks(features: Features, landmarks: Landmarks) -> Matches:
    """Return the matches of a photo with the training photos that are most alike.

    Raises `ConfigError` without the network's weights.
    """
    pairs = _pairs(features, landmarks)
    feature, landmark = (
        np.concatenate([np.zeros(0, np.int64), *(pair[side] for pair in pairs.values())]) for side in (0, 1)
    )
    photo = np.concatenate(
        [np.zeros(0, np.int64), *(np.full(len(pair[0]), key) for key, pair in pairs.items())]
    )
    place = features.place[feature].astype(np.float64)
    return Matches(
        feature, place, landmarks.point[torch.from_numpy(landmark)].double().numpy(), photo, features.size
    )


def matched_poses(matches: Matches, landmarks: Landmarks, focals: Sequence[float]) -> list[Camera]:
    """Return the cameras that enough matches agree about, first those with the most inliers.

    focals: focal lengths in pixels. At most one camera for each voting photo and focal length. Raises
    `ConfigError` without OpenCV.
    """
    photos, counts = np.unique(matches.photo, return_counts=True)
    cosine = (landmarks.side @ landmarks.side.T).numpy()
    found = []
    for voter in photos[np.argsort(-counts, kind="stable")][:_VOTERS]:
        near = photos[np.argsort(-cosine[voter, photos], kind="stable")][:_NEIGHBOURS]
        mine = np.isin(matches.photo, near)
        if mine.sum() >= _FEWEST:
            poses = (
                _pose(matches.place[mine], matches.point[mine], focal, *matches.size) for focal in focals
            )
            found += [pose for pose in poses if pose is not None]
    return [camera for camera, _ in sorted(found, key=lambda pose: -pose[1])]


def _pairs(features: Features, landmarks: Landmarks) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Return the rows (M,) of matching features and landmarks, by training photo, of those that are most alike."""
    each = {photo: landmarks.of_photo(photo) for photo in landmarks.photo.unique().tolist()}
    if not len(features.place) or not each:
        return {}
    alike = {photo: features.descriptor @ theirs.descriptor.T for photo, (_, theirs) in each.items()}
    counts = {}
    for photo, found in alike.items():
        column = found.argmax(1)
        mutual = found.argmax(0)[column] == np.arange(len(column))
        counts[photo] = int((mutual & (found.max(1) > _ALIKE)).sum())
    likely = np.argsort(-np.max([found.max(1) for found in alike.values()], axis=0), kind="stable")[:_MATCHED]
    mine = features.place[likely], features.descriptor[likely]
    partners = sorted((photo for photo in counts if counts[photo]), key=lambda photo: -counts[photo])[
        :_PARTNERS
    ]

    def matched(photo: int) -> tuple[np.ndarray, np.ndarray]:
        rows, theirs = each[photo]
        found = learned.match(mine, (theirs.place, theirs.descriptor), features.size, theirs.size)[0]
        return likely[found[:, 0]], found[:, 1] + rows.start

    return dict(zip(partners, in_threads(matched, partners), strict=True))


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
