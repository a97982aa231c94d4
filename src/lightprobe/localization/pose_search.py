"""One photo of a known object in, the poses of the camera that may have taken it out.

    photo -> poses from matches -> refined by the light; if none is good:
          -> search over sides, places and sizes -> refined, coarse to fine; if none is good:
          -> the best ones moved a little at random, and refined again
    the best -> its copies, turned as the object's shape is symmetric; those that fit nearly as well, refined

Every pose is judged by the same things: how much of the photo light explains on the object at that pose, whether the
photo's edges run where the object's outline does, and how many matched features agree (`refinement.Fit`).
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from lightprobe.core.device import generator
from lightprobe.localization.appearance import PhotoPyramid
from lightprobe.localization.known_object import KnownObject
from lightprobe.localization.matching import Matches, find_features, match_landmarks, matched_poses
from lightprobe.localization.pose import PARAMETERS, mean_distance, moved, symmetric_turns
from lightprobe.localization.refinement import Fit, pose_uncertainty, refine
from lightprobe.localization.templates import detected_camera, search
from lightprobe.localization.verdict import GOOD_SCORE, RIVAL
from lightprobe.localization.views import KnownViews
from lightprobe.scene.camera import Camera

_FEATURES = 1024  # of a photo, the likeliest
_MATCHED = 4  # poses from matches that are looked at
_BATCHES = (0, 16, 48)  # detections of a search that are refined at first, and if nothing good comes out
_SHAKES, _SHAKEN = 8, 2  # random moves of each of so many of the best poses, if nothing good has come out
_SHAKE = (0.12, 0.12, 0.12, 0.03, 0.03, 0.06, 0.0)  # their size, of `pose.moved`'s steps
_BEHIND = 0.5  # score by which a pose that may still become the best is behind it, both refined a little
_FAR_BEHIND = 0.75  # likewise of a symmetric object's turned pose before any refinement
_RIVALS = 3  # poses that are compared with the best, refined as finely
_HOPELESS = 0.8  # score below which nothing right was ever found further on
_APART = 0.03  # poses that see the object this far apart, in its size, are two
_FOCALS = (0.7, 0.85, 1.0, 1.2, 1.45, 1.8, 2.4)  # tried, of the training photos', where none is known
_SAME_LENS = 0.06  # difference of focal lengths: 26 mm of film are told of lenses from 25 to 27
_STILL = 0.1  # pixels: a right pose moves by as much because every step draws other pixels of it
_COARSE, _MIDDLE, _FINE, _FINEST = 40, 80, 130, 250  # pixels of the object's diameter to refine a pose at


@dataclass(frozen=True)
class FittedPose:
    """A pose and how it fits."""

    camera: Camera  # normalised frame
    fit: Fit


@dataclass(frozen=True)
class _Photo:
    """What poses are sought by in one photo."""

    pyramid: PhotoPyramid
    matches: Matches
    focal: float  # in pixels, usual for the object's photos where `free`
    free: bool  # the focal length is unknown


class PoseFinder:
    """Finds the poses of one object in photos."""

    def __init__(self, known: KnownObject, views: KnownViews):
        """Take the object and its views, both in the normalised frame."""
        self._known, self._views = known, views
        self._turns = symmetric_turns(known.mesh)

    def calibrated(self, told: float) -> float:
        """Return a photo's focal length by what its file tells, both over the longer side.

        Files tell whole millimetres of film, and of a lens whose picture was straightened or cropped: where the
        training photos' cameras, found with their poses, have nearly the same, it is the same lens, and theirs.
        """
        return self._views.focal if abs(told / self._views.focal - 1) < _SAME_LENS else told

    def matches(self, pyramid: PhotoPyramid) -> Matches:
        """Return the matches of a photo with the training photos, for `find`."""
        return match_landmarks(find_features(pyramid.color, _FEATURES), self._views.landmarks)

    def find(self, pyramid: PhotoPyramid, matches: Matches, focal: float | None) -> list[FittedPose]:
        """Return the distinct poses that were followed to the end, best first; none where nothing was found.

        focal: in pixels of the photo; if None it is found as well.
        """
        usual = focal or self._views.focal * max(pyramid.size)
        photo = _Photo(pyramid, matches, usual, focal is None)
        found = self._matched(photo)
        if not _settled(found):
            found = self._ordered(found + self._searched(photo))
        if found and not _settled(found) and found[0].fit.score >= _HOPELESS:
            found = self._ordered(found + self._shaken(photo, found[:_SHAKEN]))
        if found and self._turns and found[0].fit.score >= _HOPELESS:
            found = self._ordered(found + self._copied(photo, found[0]))
        return self._compared(photo, found)

    def pose_uncertainty(self, pyramid: PhotoPyramid, camera: Camera) -> float:
        """Return `refinement.pose_uncertainty` of a pose that `find` returned for the same photo."""
        return pose_uncertainty(self._known, pyramid, camera, self._known.points, diameter=_FINEST)

    def _matched(self, photo: "_Photo") -> list[FittedPose]:
        """Return poses that matched features agree about, refined."""
        focals = [photo.focal * factor for factor in _FOCALS] if photo.free else [photo.focal]
        poses = matched_poses(photo.matches, self._views.landmarks, focals)
        starts = self._apart([FittedPose(camera, _UNSEEN) for camera in poses])[:_MATCHED]
        return self._followed(photo, [self._refined(photo, start, _MIDDLE, 3) for start in starts])

    def _searched(self, photo: "_Photo") -> list[FittedPose]:
        """Return poses found by looking everywhere."""
        templates = self._views.templates
        starts = [
            FittedPose(detected_camera(detection, templates, photo.focal, *photo.pyramid.size), _UNSEEN)
            for detection in search(photo.pyramid.color, templates, _BATCHES[-1])
        ]
        found: list[FittedPose] = []
        for first, last in itertools.pairwise(_BATCHES):
            coarse = [self._refined(photo, start, _COARSE, 3, free=False) for start in starts[first:last]]
            middle = [self._refined(photo, pose, _MIDDLE, 5) for pose in self._ordered(coarse)[:5]]
            found = self._ordered(found + self._followed(photo, middle))
            if _settled(found):
                break
        return found

    def _shaken(self, photo: "_Photo", stuck: Sequence[FittedPose]) -> list[FittedPose]:
        """Return the poses that random moves of `stuck` ones lead to."""
        tried = []
        for number, pose in enumerate(stuck):
            random = torch.randn(_SHAKES, PARAMETERS, generator=generator(0, "locate-shakes", number)).numpy()
            for step in random * np.array(_SHAKE):
                start = replace(pose, camera=moved(pose.camera, step))
                tried.append(self._refined(photo, start, _MIDDLE, 4))
        return self._followed(photo, tried)

    def _copied(self, photo: "_Photo", best: FittedPose) -> list[FittedPose]:
        """Return the best copies of a pose by the symmetries of the object's shape, refined."""
        copies = [replace(best, camera=turn.copy(best.camera)) for turn in self._turns]
        for steps, behind in ((0, _FAR_BEHIND), (2, _BEHIND)):
            if not copies:
                break
            unturned, *copies = (self._refined(photo, pose, _MIDDLE, steps) for pose in (best, *copies))
            copies = [pose for pose in copies if pose.fit.score >= unturned.fit.score - behind]
        return self._followed(photo, copies)

    def _compared(self, photo: "_Photo", found: list[FittedPose]) -> list[FittedPose]:
        """Return the poses, best first, with those that score nearly as the best refined as finely as it."""
        near = [pose for pose in found if pose.fit.score >= max(found[0].fit.score - RIVAL, _HOPELESS)]
        if len(near) < 2:
            return found
        finest = [self._refined(photo, pose, _FINEST, 10) for pose in near[: _RIVALS + 1]]
        return self._ordered(finest + found[len(finest) :])

    def _followed(self, photo: "_Photo", poses: list[FittedPose]) -> list[FittedPose]:
        """Return the three best poses, of those that may become the best, refined, the best of them more finely."""
        best = self._ordered(poses)[:3]
        near = [pose for pose in best if pose.fit.score >= best[0].fit.score - _BEHIND]
        found = self._ordered([self._refined(photo, pose, _FINE, 12, still=_STILL) for pose in near])
        if found and found[0].fit.score >= _HOPELESS:
            found[0] = self._refined(photo, found[0], _FINEST, 10)
        return found

    def _refined(
        self,
        photo: "_Photo",
        start: FittedPose,
        diameter: float,
        steps: int,
        free: bool = True,
        still: float = 0.0,
    ) -> FittedPose:
        """Return a pose refined as by `refine`; `free`: with its focal length, where that is unknown."""
        camera, fit = refine(
            self._known,
            photo.pyramid,
            start.camera,
            matches=photo.matches,
            diameter=diameter,
            steps=steps,
            focal=free and photo.free,
            still=still,
        )
        return FittedPose(camera, fit)

    def _ordered(self, poses: list[FittedPose]) -> list[FittedPose]:
        """Return the distinct poses, best first."""
        return self._apart(sorted(poses, key=lambda pose: -pose.fit.score))

    def _apart(self, poses: list[FittedPose]) -> list[FittedPose]:
        """Return the poses that see the object apart from where every earlier one sees it."""
        chosen: list[FittedPose] = []
        for pose in poses:
            camera = pose.camera
            least = _APART * 2 * camera.fx / max(float(np.linalg.norm(camera.position)), 1.0)
            if all(mean_distance(camera, other.camera, self._known.points) > least for other in chosen):
                chosen.append(pose)
        return chosen


_UNSEEN = Fit(0.0, 0.0)  # of a pose that has not been compared with the photo yet


def _settled(found: list[FittedPose]) -> bool:
    return bool(found) and found[0].fit.score >= GOOD_SCORE
