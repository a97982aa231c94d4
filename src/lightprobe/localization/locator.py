"""One photo of a known object in, the camera that took it and the object's mask out.

    photo -> poses from matches -> refined by the light; if none is good:
          -> search over sides, places and sizes -> refined, coarse to fine -> the best -> mask, verdict

Every pose, wherever it comes from, is judged by the same two things: how much of the photo light explains on the object
at that pose, and whether the photo's edges run where the object's outline does (`refinement.Fit`).
"""

import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch

from lightprobe.localization.features import find_features
from lightprobe.localization.level import Levels
from lightprobe.localization.matching import matched_poses
from lightprobe.localization.pose import mean_distance
from lightprobe.localization.refinement import Fit, refine
from lightprobe.localization.search import search, sighted_camera
from lightprobe.localization.views import KnownViews
from lightprobe.render.asset import Asset
from lightprobe.scene.camera import Camera

_FEATURES = 800  # of a photo, the strongest
_MATCHED = 4  # poses from matches that are looked at
_SIGHTED = 48  # sightings of a search, of which so many are refined, at first and if nothing good comes out:
_FIRST, _MORE = 16, 48
_GOOD = 1.75  # score from which a pose is not doubted; see docs/decisions/locating.md
_APART = 0.03  # poses that see the object this far apart, in its size, are two
_FOCALS = (0.7, 0.85, 1.0, 1.2, 1.45, 1.8, 2.4)  # tried, of the training photos', where none is known
_POINTS = 400  # of the mesh, that poses are compared by


@dataclass(frozen=True)
class Candidate:
    """A pose and how it fits."""

    camera: Camera  # normalised frame
    fit: Fit


class PoseFinder:
    """Finds the poses of one object in photos."""

    def __init__(self, asset: Asset, views: KnownViews):
        """Take the object's asset and views, both in the normalised frame."""
        self._asset, self._views = asset, views
        vertices = asset.mesh.vertices.cpu().double().numpy()
        self._points = vertices[:: max(1, len(vertices) // _POINTS)]

    def find(self, color: np.ndarray, focal: float | None) -> list[Candidate]:
        """Return the distinct poses that were followed to the end, best first; none where nothing was found.

        color: linear photo (H, W, 3). focal: in pixels; if None it is found as well.
        """
        levels, free = Levels(color), focal is None
        width, height = levels.size
        usual = self._views.focal * max(width, height)
        focals = [usual * factor for factor in _FOCALS] if focal is None else [focal]
        features = find_features(color, _FEATURES)
        poses = matched_poses(features, self._views.landmarks, focals, width, height)
        starts = self._distinct([pose.camera for pose in poses])[:_MATCHED]
        found = self._follow(levels, [self._refined(levels, camera, 80, 3, free) for camera in starts], free)
        if not found or found[0].fit.score < _GOOD:
            found += self._searched(levels, focal or usual, free)
            found.sort(key=lambda candidate: -candidate.fit.score)
        return found

    def _searched(self, levels: Levels, focal: float, free: bool) -> list[Candidate]:
        """Return poses found by looking everywhere."""
        sightings = search(levels.color, self._views.templates, _SIGHTED)
        cameras = [sighted_camera(sighting, self._views.templates, focal, *levels.size) for sighting in sightings]
        found: list[Candidate] = []
        for some in (cameras[:_FIRST], cameras[_FIRST:_MORE]):
            coarse = self._best([self._refined(levels, camera, 40, 3, False) for camera in some], 5)
            fine = [self._refined(levels, candidate.camera, 80, 5, free) for candidate in coarse]
            found += self._follow(levels, fine, free)
            if found and max(candidate.fit.score for candidate in found) >= _GOOD:
                break
        return found

    def _follow(self, levels: Levels, candidates: list[Candidate], free: bool) -> list[Candidate]:
        """Return the best of the candidates, refined until they stand still, and finer the best of these."""
        found = []
        for candidate in self._best(candidates, 3):
            better = self._refined(levels, candidate.camera, 130, 6, free)
            again = self._refined(levels, better.camera, 130, 6, free)
            found.append(max(better, again, key=lambda one: one.fit.score))
        found.sort(key=lambda candidate: -candidate.fit.score)
        if found:
            found[0] = self._refined(levels, found[0].camera, 250, 6, free)
        return found

    def _refined(self, levels: Levels, camera: Camera, diameter: float, steps: int, free: bool) -> Candidate:
        return Candidate(*refine(self._asset, levels, camera, diameter=diameter, steps=steps, focal=free))

    def _best(self, candidates: Iterable[Candidate], count: int) -> list[Candidate]:
        """Return the `count` best candidates that see the object apart from each other."""
        ordered = sorted(candidates, key=lambda candidate: -candidate.fit.score)
        cameras = self._distinct([candidate.camera for candidate in ordered])
        return [candidate for candidate in ordered if any(candidate.camera is camera for camera in cameras)][:count]

    def _distinct(self, cameras: list[Camera]) -> list[Camera]:
        """Return the cameras that are not nearly the same as an earlier one."""
        chosen: list[Camera] = []
        for camera in cameras:
            size = 2 * camera.fx / max(float(np.linalg.norm(camera.position)), 1.0)
            if all(mean_distance(camera, other, self._points) > _APART * size for other in chosen):
                chosen.append(camera)
        return chosen
