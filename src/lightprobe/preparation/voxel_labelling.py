"""The object's voxels and masks: what a network takes for the object in single photos, agreed on in space by all.

A photo speaks for or against a voxel by the pixel that shows it: against it where the pixel is background, a little
for it where the pixel is the object's, as another voxel on the ray may be what shows. With L, the logarithm of the
odds that a pixel shows the object:

    vote = -ln(r + (1 - r) exp(-2 L)),  r: probability that the pixel shows the object although the voxel is empty

r is one half at first; deep inside the silhouette of the labels so far other voxels show, and r is nearly 1. The
labels are the minimum cut between the sums of votes and the area of the boundary (Campbell, Vogiatzis, Hernandez,
Cipolla 2010). Then the network looks closer, at details around the silhouettes, and photos whose object is not where
the others have it lose their weight. `outlines` makes masks of the silhouettes.

What most photos take for background is lost. How near a part was to being kept shows when votes for the object count
three times: silhouettes that grow much then are not to be trusted.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy

from lightprobe.core.threads import in_threads
from lightprobe.kernels import vote_on_voxels
from lightprobe.preparation.features import Box
from lightprobe.preparation.minimum_cut import minimum_cut
from lightprobe.preparation.salient_object import CERTAIN, log_odds
from lightprobe.scene.camera import Camera
from lightprobe.scene.consistency import overlap
from lightprobe.scene.hull import Hull, projection_matrix

_COARSE, _FINE = 64, 128  # voxels along an edge, around all that may be the object and around what is
_GROWTH = 0.6  # of the points' extent: beyond the outermost points there are parts without features
_TIGHT = 0.1  # of the object's size around the labels so far: finer voxels
_MARGIN = 0.35  # of a silhouette's longer side around it: the network wants to see what surrounds the object
_BOX_STEP = 16  # pixels that boxes are widened to: a silhouette that hardly changes has the same detail
_TRUST = 2.0  # times the odds in votes: few photos look through a hole, and for all others it is filled
_AGAINST = 3.0  # most that one photo counts against a voxel
_GENEROUS = 3.0  # times that votes for a voxel count in the widest labelling
_SHOWS, _SHOWS_DEEP = 0.5, 0.999  # r at and outside the silhouette, and deep inside it
_DEEP = 0.04  # of the silhouette's size: half as deep r begins to rise, and is _SHOWS_DEEP
_SOLID = 1.0  # vote for a voxel from each of _CORE voxels between it and the surface: no photo looks at it
_CORE = 3
_ENOUGH = 3.0  # sum of votes from which a voxel is as good as sure
_AREA = 0.35  # cost of a face; a rod of two by two voxels that are sure pays twice that much
_STEPS = 50  # of the cut, after which one voxel in 50 000 changes
_SCALE = 16.0  # votes are kept as whole multiples of a sixteenth
_SEEN = 0.1  # of the photos must see a voxel
OUTSIDE = 0.02  # of the longer side: this far outside of masks that the user gave is no object
_FEW_OUTSIDE = 0.1  # of the given masks may err
_BOX = 0.98  # of the box around a hint, from which it is a box
_SPECK = 0.001  # of the largest piece: smaller ones are noise; a ball on an aerial too thin to see is larger
_NO_WEIGHT = 0.5  # IoU with the silhouette up to which a photo hardly counts,
_FULL_WEIGHT = 0.8  # and from which it counts
_LEAST_WEIGHT = 0.05


@dataclass(frozen=True)
class View:
    """One photo to cut, as through a pinhole."""

    camera: Camera  # of the small picture
    color: np.ndarray  # (h, w, 3) uint8 sRGB
    given: np.ndarray | None  # (h, w) bool: the mask where it is known
    fixed: bool  # the given mask stays as it is; otherwise it is a hint


@dataclass(frozen=True)
class Labelling:
    """The object's voxels, and what single photos say of their pixels."""

    hull: Hull
    widest: Hull  # of the same grid: had votes for the object counted three times
    evidence: dict[int, np.ndarray]  # L (h, w) by photo
    shapes: dict[int, np.ndarray]  # (h, w) bool by photo: the silhouettes of the voxels


OnRound = Callable[[int, int], None]
# L (h, w) of a photo, by its index and colours (h, w, 3) uint8, as a whole or in a box: `salient_object.log_odds`
Look = Callable[[int, np.ndarray, Box | None], np.ndarray]


def look_at(photo: int, color: np.ndarray, box: Box | None) -> np.ndarray:
    """Return L (h, w) by the network of a photo's colours (h, w, 3) uint8: a `Look` that keeps nothing."""
    return log_odds(color, box)


def label_voxels(
    views: Mapping[int, View],
    evidence: Mapping[int, np.ndarray],
    points: np.ndarray,
    on_round: OnRound = lambda done, total: None,
    look: Look = look_at,
) -> Labelling:
    """Return the object's voxels, and what photos and details show of it.

    evidence: L (h, w) of whole photos, as `photo_evidence` gives it. points (P, 3): on the object.
    """
    volume, total = _Volume(views, evidence, points, look), 3
    volume.label()
    on_round(1, total)
    volume.look_closer()
    on_round(2, total)
    volume.tighten()
    for _ in range(2):
        volume.label()
    widest = volume.cut(_GENEROUS)
    on_round(3, total)
    return Labelling(volume.hull, widest, volume.evidence, volume.shapes)


def photo_evidence(views: Mapping[int, View], look: Look = look_at) -> dict[int, np.ndarray]:
    """Return L (h, w) float32 of each photo: its given mask, or what the network says of the whole photo.

    Raises `ConfigError` where the network is needed and not installed.
    """

    def whole(photo: int) -> np.ndarray:
        view = views[photo]
        if view.given is None:
            return look(photo, view.color, None)
        inside = np.full(view.given.shape, CERTAIN)
        if not view.fixed and is_box(view.given):
            # A hint that tells where the object ends, but not what it is.
            inside = look(photo, view.color, _around(view.given))
        return np.where(view.given, inside, -CERTAIN).astype(np.float32)

    return dict(zip(views, in_threads(whole, views), strict=True))


def is_box(mask: np.ndarray) -> bool:
    """Tell whether a hint (h, w) bool is a box around the object rather than its mask."""
    left, right, top, bottom = box_of_mask(mask) if mask.any() else (0, 0, 0, 0)
    return mask.sum() >= _BOX * max((right - left) * (bottom - top), 1)


class _Volume:
    """Voxels, labelled in rounds."""

    def __init__(
        self, views: Mapping[int, View], evidence: Mapping[int, np.ndarray], points: np.ndarray, look: Look
    ):
        self._views, self.evidence, self._look = views, dict(evidence), look
        self.shapes: dict[int, np.ndarray] = {}
        low, high = np.quantile(points, 0.02, axis=0), np.quantile(points, 0.98, axis=0)
        margin = _GROWTH * (high - low).max()
        self._enclose(low - margin, high + margin, _COARSE)

    def _enclose(self, low: np.ndarray, high: np.ndarray, resolution: int) -> None:
        """Begin a grid of empty voxels in the box low..high (3,)."""
        empty = np.zeros((resolution,) * 3, bool)
        self.hull = Hull(empty, empty.astype(np.float32), low, high)
        self._outside = self._beside_given()

    def _beside_given(self) -> np.ndarray:
        """Return the voxels that lie outside of masks that the user gave, (N, N, N) bool."""
        given = {photo: view.given for photo, view in self._views.items() if view.given is not None}
        if not given:
            return np.zeros(self.hull.occupancy.shape, bool)
        far = {i: (away(mask) > OUTSIDE * max(mask.shape)).astype(np.int8) for i, mask in given.items()}
        outside, framed = self._sums(far)
        return outside > _FEW_OUTSIDE * framed

    def tighten(self) -> None:
        """Begin finer voxels around those that are labelled, with their labels."""
        before = self.hull
        if not before.occupancy.any():
            return
        points = before.centers(before.occupancy)
        margin = _TIGHT * np.ptp(points, axis=0).max()
        low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
        self._enclose(np.maximum(low, before.lo), np.minimum(high, before.hi), _FINE)
        centers = self.hull.centers(~self.hull.occupancy).reshape(*self.hull.occupancy.shape, 3)
        cell = np.floor((centers - before.lo) / before.voxel).astype(int).clip(0, len(before.occupancy) - 1)
        self.hull = replace(self.hull, occupancy=before.occupancy[tuple(np.moveaxis(cell, -1, 0))])

    def look_closer(self) -> None:
        """Add to the evidence what details around the silhouettes show."""

        def work(photo: int) -> np.ndarray:
            view, whole, shape = self._views[photo], self.evidence[photo], self.shapes[photo]
            if view.given is not None or not shape.any():
                return whole
            return (whole + self._look(photo, view.color, _around(shape))) / 2

        self.evidence = dict(zip(self._views, in_threads(work, self._views), strict=True))

    def label(self) -> None:
        """Label the voxels anew."""
        self.hull = self.cut()
        self.shapes = {photo: self.hull.silhouette(view.camera) for photo, view in self._views.items()}

    def cut(self, favour: float = 1.0) -> Hull:
        """Return the voxels' labels by what the labels so far show. favour: times that votes for the object count."""
        votes, seen = self._votes(favour)
        solid = _SOLID * np.clip(depth_inside(self.hull.occupancy) - 1, 0, _CORE)
        evidence = np.tanh((votes + solid) / _ENOUGH)
        evidence[self._outside | (seen < max(2, _SEEN * len(self._views)))] = -CERTAIN
        occupied = minimum_cut(evidence, _AREA, _STEPS, self.hull.voxel.tolist())
        occupied = _main_pieces(scipy.ndimage.binary_fill_holes(occupied))
        return replace(self.hull, occupancy=occupied, score=evidence.astype(np.float32))

    def _votes(self, favour: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the sum of votes for each voxel and the number of photos that see it, (N, N, N) both."""
        ballots = in_threads(lambda photo: self._ballots(photo, favour), self._views)
        votes, seen = self._sums(dict(zip(self._views, ballots, strict=True)))
        return votes / _SCALE, seen

    def _sums(self, ballots: Mapping[int, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return the sum of ballots (h, w) int8, by photo, for each voxel, and how many see it: (N, N, N) both."""
        projections = np.stack([projection_matrix(self._views[photo].camera) for photo in ballots])
        sizes = np.array([each.shape for each in ballots.values()], np.int64)
        starts = np.concatenate([[0], np.cumsum(sizes.prod(axis=1))])
        cast = np.concatenate([each.ravel() for each in ballots.values()])
        grid = self.hull.lo, self.hull.voxel, len(self.hull.occupancy)
        return vote_on_voxels(projections, sizes, starts, cast, *grid)

    def _ballots(self, photo: int, favour: float) -> np.ndarray:
        """Return a photo's votes (h, w) int8."""
        evidence, shape = self.evidence[photo], self.shapes.get(photo)
        shows = np.full(evidence.shape, _SHOWS)
        if shape is not None and shape.any():
            width = max(2.0, _DEEP * np.sqrt(shape.sum()))
            shows += (_SHOWS_DEEP - _SHOWS) * np.clip(depth_inside(shape) / width - 1, 0, 1)
        votes = np.maximum(-np.log(shows + (1 - shows) * np.exp(-_TRUST * evidence)), -_AGAINST)
        votes *= np.where(votes > 0, favour, 1.0)
        weight = 1.0 if shape is None else photo_weight(self._views[photo], evidence, shape)
        return np.round(votes * weight * _SCALE).astype(np.int8)


def photo_weight(view: View, evidence: np.ndarray, shape: np.ndarray) -> float:
    """Return how much a photo's evidence counts: little where its object is not where the others have it.

    evidence: L (h, w) of the photo. shape (h, w) bool: the voxels' silhouette.
    """
    if view.given is not None:
        return 1.0
    same = overlap(evidence > 0, shape & (evidence != 0))
    return float(np.clip((same - _NO_WEIGHT) / (_FULL_WEIGHT - _NO_WEIGHT), _LEAST_WEIGHT, 1))


def box_of_mask(mask: np.ndarray) -> Box:
    """Return the box around a mask (h, w) bool that is not empty."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return float(columns[0]), float(columns[-1] + 1), float(rows[0]), float(rows[-1] + 1)


def _around(mask: np.ndarray) -> Box:
    """Return the square around a mask (h, w) bool, not empty, with the surroundings that the network wants to see."""
    edges = box_of_mask(mask)
    left, top = (_BOX_STEP * (edges[side] // _BOX_STEP) for side in (0, 2))
    right, bottom = (-_BOX_STEP * (-edges[side] // _BOX_STEP) for side in (1, 3))
    return square_around((left, right, top, bottom), _MARGIN)


def square_around(box: Box, margin: float) -> Box:
    """Return the square around a box, with a margin in longer sides of it on each side."""
    left, right, top, bottom = box
    half = (0.5 + margin) * max(right - left, bottom - top)
    x, y = (left + right) / 2, (top + bottom) / 2
    return x - half, x + half, y - half, y + half


def _main_pieces(occupied: np.ndarray) -> np.ndarray:
    """Return voxels (N, N, N) bool without specks."""
    pieces, count = scipy.ndimage.label(occupied, structure=np.ones((3, 3, 3)))
    if count < 2:
        return occupied
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    return (sizes >= _SPECK * sizes.max())[pieces] & occupied


def depth_inside(mask: np.ndarray) -> np.ndarray:
    """Return how deep inside `mask` cells lie, of any shape; the border of the grid is no end of it."""
    if mask.all():
        return np.full(mask.shape, float(sum(mask.shape)))
    padded = np.pad(mask, 1, mode="edge")
    return scipy.ndimage.distance_transform_edt(padded)[tuple(slice(1, -1) for _ in mask.shape)]


def away(mask: np.ndarray) -> np.ndarray:
    """Return how far outside of `mask` cells lie, of any shape; infinite where it is empty."""
    return scipy.ndimage.distance_transform_edt(~mask) if mask.any() else np.full(mask.shape, np.inf)
