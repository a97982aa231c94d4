"""What is wrong with a scene as a whole: what `inspect` prints and `train` refuses or warns of.

Masks and cameras are compared by the visual hull. Where they disagree, the one cause that mends it is named with
its remedy (`causes`, `diagnosis`); what most photos have cannot lead to an object and is refused.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.imaging import read_orientation
from lightprobe.scene.camera import Similarity
from lightprobe.scene.consistency import View, agreements, fitted_hull, overlap, silhouette, trial_hull
from lightprobe.scene.coverage import FEWEST, at_one_place, one_sided, too_few
from lightprobe.scene.diagnosis import Diagnosis, diagnose, diagnose_inverted, diagnose_outliers
from lightprobe.scene.normalise import ROUGH_AGREEMENT, find_similarity, first_guess
from lightprobe.scene.photo import Photo
from lightprobe.scene.remedies import sentence, which

_RESOLUTION = 128  # voxels along an edge of the hull that masks are compared with
_LOW, _POOR, _HOPELESS = 0.9, 0.75, 0.5  # median IoU: sought for a cause; looked at; of no use
_OUTLIER, _FAR_OUT, _CLEARLY_BETTER = 0.1, 0.2, 0.1  # IoU
_UNCOVERED = 0.05  # share of the mask of a wrong photo that the hull of the others does not cover, at least
_EATEN = 0.03  # likewise of the usual mask where masks and cameras disagree
_TOLERATED = 0.1  # share of photos that may be wrong: a hull bears with them


@dataclass(frozen=True)
class Soundness:
    """How masks and cameras of a scene agree, and what follows."""

    similarity: Similarity | None  # None without a hull
    silhouettes: dict[
        str, np.ndarray
    ]  # the hull by photo, (h, w) bool of the mask's size; empty without a hull
    refusals: tuple[str, ...]  # sentences about what no object can come of
    doubts: tuple[str, ...]  # sentences about what may spoil it


@dataclass(frozen=True)
class _Carving:
    similarity: Similarity
    silhouettes: dict[str, np.ndarray]
    ious: dict[str, float]

    @property
    def median(self) -> float:
        return float(np.median(list(self.ious.values())))


def judge(
    train: Sequence[Photo], others: Sequence[Photo], alphas: Mapping[str, np.ndarray], root: Path
) -> Soundness:
    """Return what masks and cameras of the scene in folder `root` tell about each other.

    train: photos to train on; others: all else; alphas: their small masks (h, w) by name, of those that can be read.
    """
    photos = sorted(
        (p for p in (*train, *others) if p.name in alphas), key=lambda photo: photo.image_path.as_posix()
    )
    train = [photo for photo in train if photo.name in alphas]
    if len(train) < 2:
        sentence_ = f"{root} has {len(train)} sound training photos; two or more are needed."
        return Soundness(None, {}, (sentence_,), ())
    carving, failure = _carved(train, photos, alphas)
    refusals, doubts = _Findings(train, photos, alphas, root, carving, failure).all()
    if carving is None:
        return Soundness(None, {}, refusals, doubts)
    return Soundness(carving.similarity, carving.silhouettes, refusals, doubts)


def _carved(
    train: Sequence[Photo], photos: Sequence[Photo], alphas: Mapping[str, np.ndarray]
) -> tuple[_Carving | None, str]:
    """Return the hull's agreement with all photos, or None and why there is no hull.

    When that agrees badly, a hull that lets many photos disagree may show which of them are to blame.
    """
    cameras, masks = [photo.camera for photo in train], [alphas[photo.name] for photo in train]

    def carve(agreement: float | None) -> _Carving:
        similarity = find_similarity(cameras, masks, agreement=agreement)
        hull = fitted_hull(cameras, masks, similarity, _RESOLUTION, agreement=agreement)
        shown = {p.name: silhouette(hull, p.camera, similarity, alphas[p.name].shape) for p in photos}
        ious = {name: overlap(alphas[name] >= 0.5, picture) for name, picture in shown.items()}
        return _Carving(similarity, shown, ious)

    try:
        usual = carve(None)
        if usual.median >= _POOR:
            return usual, ""
        rough = carve(ROUGH_AGREEMENT)
    except InputError as error:
        return None, str(error)
    return (rough if rough.median > usual.median + _CLEARLY_BETTER else usual), ""


@dataclass(frozen=True)
class _Findings:
    """What is asked of a carved scene, in turn: the first cause found explains the rest."""

    train: Sequence[Photo]
    photos: Sequence[Photo]  # all, in the order of their files
    alphas: Mapping[str, np.ndarray]
    root: Path
    carving: _Carving | None
    failure: str

    def all(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the sentences about what cannot be right, and about what is doubtful."""
        orientations = [read_orientation(photo.image_path) or 1 for photo in self.photos]
        pairs = zip(self.photos, orientations, strict=True)
        views = [View.of(photo.name, photo.camera, self.alphas[photo.name], tag) for photo, tag in pairs]
        cameras, center = [photo.camera for photo in self.train], self._center()
        few, is_useless = too_few(len(self.photos), len(self.train))
        place = "" if is_useless else at_one_place(cameras, center)
        if is_useless or place:
            return (place or few,), ()
        side = one_sided(cameras, center)
        is_little = len(self.train) < FEWEST or bool(side)
        causes = self._causes(views, is_little=is_little)
        told = [sentence(found, self.photos, orientations, self.root) for found in causes]
        share = sum(len(found.photos) for found in causes) / len(views)
        refusals = told if share > _TOLERATED else []
        doubts = [] if share > _TOLERATED else told
        little = [words for words in (side, few) if words]
        if not refusals and little and self.failure and _agree(views):
            refusals = little
        elif not refusals and self.failure:
            refusals = [self.failure]
        elif not refusals:
            doubts = [*doubts, *little]
        if not refusals and not is_little and self.carving is not None:
            refusals, unexplained = self._unexplained({i for found in causes for i in found.photos})
            doubts = [*doubts, *unexplained]
        return tuple(refusals), tuple(doubts)

    def _center(self) -> np.ndarray:
        """Return the point (3,) that the masks point to: a hull of few photos may reach far to one side."""
        cameras = [photo.camera for photo in self.train]
        try:
            return first_guess(cameras, [self.alphas[photo.name] for photo in self.train])[0]
        except InputError:
            return np.mean([camera.position for camera in cameras], axis=0)

    def _causes(self, views: Sequence[View], *, is_little: bool) -> list[Diagnosis]:
        """Return what is wrong with photos, as far as a cause mends it."""
        inverted = diagnose_inverted(views)
        if inverted is not None:
            return [inverted]
        outliers = self._outliers(_OUTLIER)
        if self.carving is None:
            is_asked = not (is_little and _agree(views))
        else:
            is_asked = self._disagrees(_LOW) or len(outliers) > _TOLERATED * len(views)
        found = diagnose(views, is_little=is_little) if is_asked else None
        if found is not None:
            return [found]
        return diagnose_outliers(views, outliers) if outliers and not is_little else []

    def _disagrees(self, low: float) -> bool:
        """Tell whether the usual agreement is at most `low`, and not because few photos leave the hull too large."""
        uncovered = float(np.median([self._uncovered(photo.name) for photo in self.photos]))
        return self.carving is not None and self.carving.median <= low and uncovered > _EATEN

    def _outliers(self, below: float) -> list[int]:
        """Return the indices of photos whose agreement lies by more than `below` under the usual one.

        A hull that is larger than a mask blames no photo where few photos leave it so, and no held-out photo, which
        did not carve it.
        """
        if self.carving is None:
            return []
        usual, carvers = self.carving.median - below, {photo.name for photo in self.train}
        is_tight = self.carving.median > _LOW
        names = [photo.name for photo in self.photos]
        low = [(i, name) for i, name in enumerate(names) if self.carving.ious[name] < usual]
        return [i for i, n in low if self._uncovered(n) > _UNCOVERED or (is_tight and n in carvers)]

    def _uncovered(self, name: str) -> float:
        """Return the share of a photo's mask that the hull does not cover."""
        mask, shown = self.alphas[name] >= 0.5, self.carving.silhouettes[name] if self.carving else None
        return 0.0 if shown is None or not mask.any() else float((mask & ~shown).sum() / mask.sum())

    def _unexplained(self, explained: set[int]) -> tuple[list[str], list[str]]:
        """Return sentences about a disagreement without a known cause: of all photos, of single ones."""
        if self.carving is None:
            return [], []
        median = self.carving.median
        if self._disagrees(_POOR) and not explained:
            bad = (
                f"Masks and cameras agree badly (median hull IoU {median:.2f}), and no usual mistake explains it: look "
                "at the overlay sheet of `lightprobe inspect` for wrong poses or masks."
            )
            return ([bad], []) if median < _HOPELESS else ([], [bad])
        left = [self.photos[i].name for i in self._outliers(_FAR_OUT) if i not in explained]
        worst = [f"{self.carving.ious[name]:.2f}" for name in left]
        pairs = [f"{name}: IoU {iou}" for name, iou in zip(left, worst, strict=True)]
        if not left:
            return [], []
        return [], [
            f"Mask or camera of {which(pairs, len(self.photos))} disagrees with the other photos (median {median:.2f})"
            ": estimate these cameras again, correct the masks, or leave the photos out."
        ]


def _agree(views: Sequence[View]) -> bool:
    """Tell whether a hull fits the masks even if it has no end, as that of photos from one side."""
    return float(np.median(agreements(views, trial_hull(views)))) >= _POOR
