"""Poses from matches: a photo's features, the landmarks that look like them, and cameras under which many
agree.

A feature matches a landmark of a training photo when each is the other's most alike and the next most alike
is clearly less so; the training photos, each under another light, are matched one by one. Those with the most
matches vote with their neighbours: RANSAC over three to four matches each (Fischler & Bolles 1981), for every
focal length tried.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from lightprobe.localization.features import Features, load_opencv
from lightprobe.localization.landmarks import Landmarks
from lightprobe.scene.camera import Camera

_RATIO = 0.85  # distance to the most alike over that to the next
_VOTERS, _NEIGHBOURS = 6, 6  # training photos that poses are sought from, and photos that each is joined with
_ERROR = 4.0 / 320  # of an inlier, in the photo's longer side
_TRIALS = 2000  # of RANSAC
_FEWEST = 6  # inliers of a pose that is worth looking at
_FEWEST_LANDMARKS = 5  # of a training photo


@dataclass(frozen=True)
class MatchedPose:
    """A camera, and how many matches agree about it."""

    camera: Camera
    inliers: int


def matched_poses(
    features: Features, landmarks: Landmarks, focals: Sequence[float], width: int, height: int
) -> list[MatchedPose]:
    """Return the poses that enough matches agree about, most inliers first; focal lengths in pixels.

    At most one for each voting photo and focal length. Raises `ConfigError` without OpenCV.
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
    return sorted(found, key=lambda pose: -pose.inliers)


def _pairs(features: Features, landmarks: Landmarks) -> list[tuple[Tensor, Tensor]]:
    """Return for every training photo the rows (M,) of matching features and landmarks."""
    mine, theirs = (d.float() / 255 for d in (torch.from_numpy(features.descriptor), landmarks.descriptor))
    distance = (2 - 2 * (mine @ theirs.T).clamp(max=1)).sqrt()
    bounds = torch.searchsorted(
        landmarks.photo, torch.arange(len(landmarks.side) + 1, dtype=torch.int32)
    ).tolist()
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


def _pose(place: np.ndarray, point: np.ndarray, focal: float, width: int, height: int) -> MatchedPose | None:
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
    return MatchedPose(Camera(pose, focal, focal, 0.5 * width, 0.5 * height, width, height), len(rows))
