"""One photo of a known object in, the poses of the camera that may have taken it out.

    photo -> poses from matches -> refined by the light; if none is good:
          -> search over sides, places and sizes -> refined, coarse to fine; if none is good:
          -> the best ones moved a little at random, and refined again
    the best -> its copies, turned as the object's shape is symmetric, refined: one of them may fit better, or as well

Every pose, wherever it comes from, is judged by the same two things: how much of the photo light explains on the object
at that pose, and whether the photo's edges run where the object's outline does (`refinement.Fit`).
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from lightprobe.core.device import generator
from lightprobe.localization.features import find_features
from lightprobe.localization.known_object import KnownObject
from lightprobe.localization.level import Levels
from lightprobe.localization.matching import matched_poses
from lightprobe.localization.pose import PARAMETERS, mean_distance, moved
from lightprobe.localization.refinement import Fit, leeway, refine
from lightprobe.localization.search import search, sighted_camera
from lightprobe.localization.symmetry import symmetric_turns
from lightprobe.localization.verdict import GOOD_SCORE, RIVAL
from lightprobe.localization.views import KnownViews
from lightprobe.scene.camera import Camera

_FEATURES = 800  # of a photo, the strongest
_MATCHED = 4  # poses from matches that are looked at
_BATCHES = (0, 16, 48)  # sightings of a search that are refined at first, and if nothing good comes out
_SHAKES, _SHAKEN = 8, 2  # random moves of each of so many of the best poses, if nothing good has come out
_SHAKE = (0.12, 0.12, 0.12, 0.03, 0.03, 0.06, 0.0)  # their size, of `pose.moved`'s steps
_COPIES = 3  # of a symmetric object's turned poses that are followed to the end
_HOPELESS = 0.8  # score below which nothing right was ever found further on
_APART = 0.03  # poses that see the object this far apart, in its size, are two
_FOCALS = (0.7, 0.85, 1.0, 1.2, 1.45, 1.8, 2.4)  # tried, of the training photos', where none is known
_POINTS = 400  # of the mesh, that poses are compared by
_COARSE, _MIDDLE, _FINE, _FINEST = (
    40,
    80,
    130,
    250,
)  # pixels of the object's diameter that a pose is refined at


@dataclass(frozen=True)
class Candidate:
    """A pose and how it fits."""

    camera: Camera  # normalised frame
    fit: Fit
    inliers: int = 0  # matches that led to it


class PoseFinder:
    """Finds the poses of one object in photos."""

    def __init__(self, known: KnownObject, views: KnownViews):
        """Take the object and its views, both in the normalised frame."""
        self._known, self._views = known, views
        vertices = known.mesh.vertices.cpu().double().numpy()
        self._points = vertices[:: max(1, len(vertices) // _POINTS)]
        self._turns = symmetric_turns(known.mesh)

    def find(self, levels: Levels, focal: float | None) -> list[Candidate]:
        """Return the distinct poses that were followed to the end, best first; none where nothing was found.

        levels: of the photo. focal: in its pixels; if None it is found as well.
        """
        free = focal is None
        usual = focal or self._views.focal * max(levels.size)
        found = self._matched(levels, usual, free)
        if not _settled(found):
            found = self._ordered(found + self._searched(levels, usual, free))
        if found and not _settled(found) and found[0].fit.score >= _HOPELESS:
            found = self._ordered(found + self._shaken(levels, found[:_SHAKEN], free))
        if found and self._turns and found[0].fit.score >= _HOPELESS:
            found = self._ordered(found + self._copied(levels, found[0], free))
        return self._compared(levels, found, free)

    def leeway(self, levels: Levels, camera: Camera) -> float:
        """Return `refinement.leeway` of a pose that `find` returned for the same photo."""
        return leeway(self._known, levels, camera, self._points, diameter=_FINEST)

    def _matched(self, levels: Levels, focal: float, free: bool) -> list[Candidate]:
        """Return poses that matched features agree about, refined."""
        focals = [focal * factor for factor in _FOCALS] if free else [focal]
        features = find_features(levels.color, _FEATURES)
        poses = matched_poses(features, self._views.landmarks, focals, *levels.size)
        starts = self._apart([Candidate(pose.camera, _UNSEEN, pose.inliers) for pose in poses])[:_MATCHED]
        return self._followed(
            levels, [self._refined(levels, start, _MIDDLE, 3, free) for start in starts], free
        )

    def _searched(self, levels: Levels, focal: float, free: bool) -> list[Candidate]:
        """Return poses found by looking everywhere."""
        sightings = search(levels.color, self._views.templates, _BATCHES[-1])
        cameras = [
            sighted_camera(sighting, self._views.templates, focal, *levels.size) for sighting in sightings
        ]
        starts = [Candidate(camera, _UNSEEN) for camera in cameras]
        found: list[Candidate] = []
        for first, last in itertools.pairwise(_BATCHES):
            coarse = [self._refined(levels, start, _COARSE, 3, False) for start in starts[first:last]]
            middle = [self._refined(levels, one, _MIDDLE, 5, free) for one in self._ordered(coarse)[:5]]
            found = self._ordered(found + self._followed(levels, middle, free))
            if _settled(found):
                break
        return found

    def _shaken(self, levels: Levels, candidates: Sequence[Candidate], free: bool) -> list[Candidate]:
        """Return what random moves of poses that may have got stuck lead to."""
        tried = []
        for number, candidate in enumerate(candidates):
            random = torch.randn(_SHAKES, PARAMETERS, generator=generator(0, "locate-shakes", number)).numpy()
            for step in random * np.array(_SHAKE):
                start = replace(candidate, camera=moved(candidate.camera, step))
                tried.append(self._refined(levels, start, _MIDDLE, 4, free))
        return self._followed(levels, tried, free)

    def _copied(self, levels: Levels, best: Candidate, free: bool) -> list[Candidate]:
        """Return the best copies of a pose by the symmetries of the object's shape, refined."""
        copies = [replace(best, camera=turn.copy(best.camera)) for turn in self._turns]
        tried = self._ordered([self._refined(levels, copy, _MIDDLE, 2, free) for copy in copies])
        return self._followed(levels, tried[:_COPIES], free)

    def _compared(self, levels: Levels, found: list[Candidate], free: bool) -> list[Candidate]:
        """Return the poses with those that come near the best one refined as finely as it is, best first."""
        near = [one for one in found if one.fit.score >= max(found[0].fit.score - RIVAL, _HOPELESS)]
        if len(near) < 2:
            return found
        finest = [self._refined(levels, one, _FINEST, 4, free) for one in near[: _COPIES + 1]]
        return self._ordered(finest + found[len(finest) :])

    def _followed(self, levels: Levels, candidates: list[Candidate], free: bool) -> list[Candidate]:
        """Return the best of the candidates, refined until they stand still, and finer the best of these."""
        found = []
        for candidate in self._ordered(candidates)[:3]:
            better = self._refined(levels, candidate, _FINE, 6, free)
            if better.fit.score >= _HOPELESS:
                again = self._refined(levels, better, _FINE, 6, free)
                better = max(better, again, key=lambda one: one.fit.score)
            found.append(better)
        found = self._ordered(found)
        if found and found[0].fit.score >= _HOPELESS:
            found[0] = self._refined(levels, found[0], _FINEST, 6, free)
        return found

    def _refined(
        self, levels: Levels, start: Candidate, diameter: float, steps: int, free: bool
    ) -> Candidate:
        camera, fit = refine(self._known, levels, start.camera, diameter=diameter, steps=steps, focal=free)
        return Candidate(camera, fit, start.inliers)

    def _ordered(self, candidates: list[Candidate]) -> list[Candidate]:
        """Return the candidates that see the object apart from each other, best first."""
        return self._apart(sorted(candidates, key=lambda candidate: -candidate.fit.score))

    def _apart(self, candidates: list[Candidate]) -> list[Candidate]:
        """Return the candidates that are not nearly the same as an earlier one."""
        chosen: list[Candidate] = []
        for candidate in candidates:
            camera = candidate.camera
            least = _APART * 2 * camera.fx / max(float(np.linalg.norm(camera.position)), 1.0)
            if all(mean_distance(camera, other.camera, self._points) > least for other in chosen):
                chosen.append(candidate)
        return chosen


_UNSEEN = Fit(0.0, 0.0)  # of a pose that has not been compared with the photo yet


def _settled(found: list[Candidate]) -> bool:
    return bool(found) and found[0].fit.score >= GOOD_SCORE
