"""Which voxels are the object's: one labelling of space by all photos at once.

Every photo gives each pixel the logarithm L of how much likelier its colour is on the object than in the background.
A photo speaks for or against a voxel by the pixel that shows it: against it where the pixel is background, a little
for it where the pixel is the object's, as another voxel on the ray may be what shows:

    vote = -ln(r + (1 - r) exp(-L)),  r: probability that the pixel shows the object although the voxel is empty

r is one half at first; deep inside the silhouette of the labels so far other voxels show, and r is nearly 1. The
labels are the minimum cut between the sums of votes and the area of the boundary (Campbell, Vogiatzis, Hernandez,
Cipolla 2010), above the support planes of all places; their silhouettes teach the colours for the next round. Early
rounds let a vote against count little: what they cut off would have its colours taught as background.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy

from lightprobe.core.threads import in_threads
from lightprobe.kernels import vote_on_voxels
from lightprobe.preparation.colour_likelihood import SURE, ColourLikelihood
from lightprobe.preparation.features import opencv_library
from lightprobe.preparation.mapping import Solution
from lightprobe.preparation.masks import View, away_from, dot_radius, seen_by
from lightprobe.preparation.minimum_cut import minimum_cut
from lightprobe.preparation.support_plane import Expected, SupportPlane, expected_pictures
from lightprobe.scene.camera import Camera
from lightprobe.scene.consistency import overlap
from lightprobe.scene.hull import Hull, projection_matrix

_RESOLUTION = 96  # voxels along an edge
_GROWTH = 0.25  # of the object's size: beyond the outermost points there are parts without features
_TIGHT = 0.1  # of the object's size around the labels so far: finer voxels
_TIGHTEN = 2  # rounds after which the labels tell how large the object is
# Of each round: the most that one photo counts against a voxel.
_AGAINST = (1.0, 2.0, 3.0, 4.0)
# Of each round: voxels inside the labels so far, and share of the object's height, from which they hide the plane.
# Early labels have table in them, at the foot; what they hide could not be told to be table.
# They are eroded as deep, as a table that hides itself is never told from the object.
_HIDES = ((0.0, 0.0), (3.0, 0.2), (3.0, 0.15), (3.0, 0.1))
_SHOWS, _SHOWS_DEEP = 0.5, 0.999  # r at and outside the silhouette, and deep inside it
_DEEP = 0.04  # of the silhouette's size: half as deep r begins to rise, and is _SHOWS_DEEP
_SOLID = 1.0  # vote for a voxel from each of _CORE voxels between it and the surface: no photo looks at it
_CORE = 3
_ENOUGH = 3.0  # sum of votes from which a voxel is as good as sure
_AREA = 0.35  # cost of a face; a rod of two by two voxels that are sure pays twice that much
_STEPS = 150  # of the cut, after which labels change no more
_SCALE = 16.0  # votes are kept as whole multiples of a sixteenth
_NOVEL = (0.5, 0.15)  # share of the object that may have any colour: at first, and in later rounds
_REACH = (0.5, 0.25)  # of the object's size around which colours count as nearby: likewise
_RING = 0.25  # of the object's size around it, whose pixels tell how the background's ratios are spread
_BINS, _BLUR = 24, 1.0  # of ratios, for that, and over how many they are averaged
_RARE = 0.05  # share of either side's pixels that may have any ratio: labels err
_SEEN = 0.1  # of the photos that must see a voxel
_SPECK = (
    0.001  # of the largest piece: smaller ones are noise; the ball on an aerial too thin to see is larger
)
_EDGE_STEPS = 80  # of the cut in a photo
_EDGE = 2.0  # cost of a pixel's side along the outline where colours are even
_CONTRAST = 12.0  # 8-bit CIELAB: difference between neighbours where an outline costs half as much
_FREE = 0.1  # of that cost remains at a strong edge
_SLOPE = 1.5  # logarithm by which a pixel is likelier inside for each pixel to the volume's outline
_FAR, _BOUND = (
    6.0,
    3.0,
)  # logarithms that the outline is worth at most: far outside, and inside, where it may bulge
_WIDER = 1.0  # pixels by which silhouettes are too wide, as votes count for the pixels beside them, too


@dataclass(frozen=True)
class Labelling:
    """The object's voxels, and its masks in the photos."""

    hull: Hull
    masks: dict[int, np.ndarray]  # (h, w) bool by photo
    agreement: dict[int, float]  # IoU of each mask with what the photos of the other places say


OnRound = Callable[[int, int], None]


def label_voxels(
    views: Mapping[int, View],
    places: Mapping[int, int],
    solution: Solution,
    on_object: np.ndarray,
    planes: Mapping[int, SupportPlane],
    on_round: OnRound = lambda done, total: None,
) -> Labelling:
    """Return the object's voxels and masks.

    places: by photo. on_object (P,) bool: points of the object above its support. planes: by place, for places
    that have one.
    """
    volume = _Volume(views, places, solution, on_object, planes)
    for number in range(len(_AGAINST)):
        if number == _TIGHTEN:
            volume.tighten()
        volume.label(number)
        on_round(number + 1, len(_AGAINST) + 1)
    volume.refine()
    masks = volume.masks()
    on_round(len(_AGAINST) + 1, len(_AGAINST) + 1)
    return Labelling(volume.hull, masks, volume.agreement(masks))


class _Volume:
    """Voxels, labelled in rounds."""

    def __init__(
        self,
        views: Mapping[int, View],
        places: Mapping[int, int],
        solution: Solution,
        on_object: np.ndarray,
        planes: Mapping[int, SupportPlane],
    ):
        self._views, self._places, self._solution, self._planes = views, places, solution, planes
        self._on_object = on_object
        points = solution.points[on_object]
        low, high = np.quantile(points, 0.02, axis=0), np.quantile(points, 0.98, axis=0)
        margin = _GROWTH * (high - low).max()
        self._kinds = dict(
            zip(views, in_threads(lambda i: ColourLikelihood(views[i].color), views), strict=True)
        )
        self._shapes: dict[int, np.ndarray] = {}
        self._masks: dict[int, np.ndarray] = {}
        self.logs: dict[int, np.ndarray] = {}
        self._place_votes: dict[int, np.ndarray] = {}
        self._enclose(low - margin, high + margin)

    def _enclose(self, low: np.ndarray, high: np.ndarray) -> None:
        """Begin a grid of empty voxels in the box low..high (3,), as far as it lies above the planes."""
        for plane in self._planes.values():
            axis = int(np.abs(plane.normal).argmax())
            if abs(plane.normal[axis]) > 0.98:  # along an axis: no voxel is wasted beneath
                end = (
                    plane.offset / plane.normal[axis]
                    - np.sign(plane.normal[axis]) * 0.02 * (high - low).max()
                )
                side = low if plane.normal[axis] > 0 else high
                side[axis] = max(low[axis], end) if plane.normal[axis] > 0 else min(high[axis], end)
        empty = np.zeros((_RESOLUTION,) * 3, bool)
        self.hull = Hull(empty, empty.astype(np.float32), low, high)
        self._centers = self.hull.centers(~empty).reshape(*empty.shape, 3)
        self._below = empty.copy()
        for plane in self._planes.values():
            self._below |= plane.height(self._centers) < 0
        self._boxes = {i: _box_shown(view.camera, low, high) for i, view in self._views.items()}
        self._size = float(np.median([np.sqrt(box.sum()) for box in self._boxes.values()]))

    def tighten(self) -> None:
        """Begin finer voxels around those that are labelled."""
        occupied = self.hull.occupancy
        if not occupied.any():
            return
        points = self.hull.centers(occupied)
        margin = _TIGHT * np.ptp(points, axis=0).max()
        low = np.maximum(points.min(axis=0) - margin, self.hull.lo)
        high = np.minimum(points.max(axis=0) + margin, self.hull.hi)
        before = self.hull
        self._enclose(low, high)
        cell = np.floor((self._centers - before.lo) / before.voxel).astype(int)
        cell = cell.clip(0, _RESOLUTION - 1)
        self.hull = replace(self.hull, occupancy=before.occupancy[tuple(np.moveaxis(cell, -1, 0))])

    def label(self, number: int) -> None:
        """Label the voxels anew, in round `number`."""
        expected = self._expected(number)

        def colours(photo: int) -> np.ndarray:
            return self._log_ratio(photo, expected.get(photo))

        self.logs = dict(zip(self._views, in_threads(colours, self._views), strict=True))
        total, seen = self._votes(_AGAINST[number])
        evidence = np.tanh((total + self._solid()) / _ENOUGH)
        evidence[self._below | (seen < max(2, _SEEN * len(self._views)))] = -SURE
        occupied = minimum_cut(evidence, _AREA, _STEPS, self.hull.voxel.tolist())
        occupied = _main_pieces(scipy.ndimage.binary_fill_holes(occupied | self._below) & ~self._below)
        self.hull = replace(self.hull, occupancy=occupied, score=evidence.astype(np.float32))
        self._shapes = {i: self.hull.silhouette(view.camera) for i, view in self._views.items()}
        self._masks = self.masks()

    def refine(self) -> None:
        """Find the colours' ratios once more, by the last labels, and what they are worth."""
        expected = self._expected(len(_HIDES) - 1)

        def colours(photo: int) -> np.ndarray:
            return self._log_ratio(photo, expected.get(photo), calibrate=True)

        self.logs = dict(zip(self._views, in_threads(colours, self._views), strict=True))
        self._masks = self.masks()
        self._votes(_AGAINST[-1], beside=False)  # for what each place says by itself

    def _expected(self, number: int) -> dict[int, Expected]:
        """Return what photos would show of the plane alone, by photo."""
        found: dict[int, Expected] = {}
        center = (self.hull.lo + self.hull.hi) / 2
        radius = float(np.linalg.norm(self.hull.hi - self.hull.lo) / 2)
        for place, plane in self._planes.items():
            mine = [photo for photo in self._views if self._places[photo] == place]
            hidden, beside = [np.zeros_like(self._boxes[i]) for i in mine], [~self._boxes[i] for i in mine]
            if self._shapes:
                hiding = self._hiding(plane, *_HIDES[number])
                hidden = [hiding.silhouette(self._views[i].camera) for i in mine]
                beside = [_away(self._shapes[i]) > 0.1 * self._size for i in mine]
            views = [self._views[i] for i in mine]
            cameras, colors = [view.camera for view in views], [view.color for view in views]
            pictures = expected_pictures(plane, cameras, colors, hidden, beside, center, radius)
            found.update(zip(mine, pictures or [], strict=bool(pictures)))
        return found

    def _hiding(self, plane: SupportPlane, depth: float, share: float) -> Hull:
        """Return the voxels that surely hide the plane: some `depth` inside, above a `share` of the height."""
        occupied = self.hull.occupancy
        inner = _depth(occupied | self._below) > depth
        height = plane.height(self._centers)
        top = np.quantile(height[occupied], 0.98) if occupied.any() else 0.0
        return replace(self.hull, occupancy=occupied & inner & (height > share * top))

    def _log_ratio(self, photo: int, expected: Expected | None, calibrate: bool = False) -> np.ndarray:
        """Return L (h, w) of a photo."""
        view = self._views[photo]
        shape = self._masks.get(photo, np.zeros(view.color.shape[:2], bool))
        first = not shape.any()
        if first:
            points = self._solution.points[self._on_object & seen_by(self._solution, [photo])]
            inside = away_from(view.camera, points) < dot_radius(view.color.shape[:2])
            outside = ~self._boxes[photo]
        else:
            inside = _depth(shape) > 1
            outside = _away(shape) > max(1.0, _DEEP / 2 * np.sqrt(shape.sum()))
        likely = self._kinds[photo]
        ratio = likely.log_ratio(
            inside,
            outside,
            (_REACH[0] if first else _REACH[1]) * self._size,
            _NOVEL[0] if first else _NOVEL[1],
            expected,
        )
        if calibrate and not first:
            ratio = calibrated(ratio, inside, outside & (_away(shape) < _RING * self._size))
        if view.given is not None:
            ratio = np.where(view.given, SURE if view.fixed else ratio, -SURE)
        return ratio

    def _votes(self, against: float, beside: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Return the sum of votes for each voxel and the number of photos that see it, (N, N, N) both.

        against: the most that one photo counts against a voxel. beside: the likeliest of neighbouring pixels speaks.
        """
        total, seen = np.zeros(self._below.shape), np.zeros(self._below.shape, int)
        cast = dict(
            zip(
                self._views, in_threads(lambda i: self._ballots(i, against, beside), self._views), strict=True
            )
        )
        for place in sorted({self._places[photo] for photo in self._views}):
            mine = [photo for photo in self._views if self._places[photo] == place]
            projections = np.stack([projection_matrix(self._views[i].camera) for i in mine])
            sizes = np.array([cast[i].shape for i in mine], np.int64)
            starts = np.concatenate([[0], np.cumsum(sizes.prod(axis=1))])
            ballots = np.concatenate([cast[i].ravel() for i in mine])
            votes, count = vote_on_voxels(
                projections, sizes, starts, ballots, self.hull.lo, self.hull.voxel, _RESOLUTION
            )
            self._place_votes[place] = (votes / _SCALE).astype(np.float32)
            total, seen = total + self._place_votes[place], seen + count
        return total, seen

    def _ballots(self, photo: int, against: float, beside: bool) -> np.ndarray:
        """Return a photo's votes (h, w) int8."""
        cross = scipy.ndimage.generate_binary_structure(2, 1)  # cameras err by a pixel, and parts are as thin
        ratio = self.logs[photo]
        if beside:
            ratio = scipy.ndimage.grey_dilation(ratio, footprint=cross)
        shows = np.full(ratio.shape, _SHOWS, np.float32)
        shape = self._masks.get(photo)
        if shape is not None and shape.any():
            width = max(2.0, _DEEP * np.sqrt(shape.sum()))
            shows += (_SHOWS_DEEP - _SHOWS) * np.clip(_depth(shape) / width - 1, 0, 1)
        votes = np.maximum(-np.log(shows + (1 - shows) * np.exp(-ratio)), -against)
        return np.round(votes * _SCALE).astype(np.int8)

    def _solid(self) -> np.ndarray:
        """Return the votes for voxels inside the labels so far, (N, N, N)."""
        return _SOLID * np.clip(_depth(self.hull.occupancy) - 1, 0, _CORE)

    def masks(self) -> dict[int, np.ndarray]:
        """Return the masks (h, w) bool, by photo."""

        def mask(photo: int) -> np.ndarray:
            view = self._views[photo]
            if view.fixed and view.given is not None:
                return view.given
            return edge_cut(self._kinds[photo].lab, self.logs[photo], self._shapes[photo])

        return dict(zip(self._views, in_threads(mask, self._views), strict=True))

    def agreement(self, masks: Mapping[int, np.ndarray]) -> dict[int, float]:
        """Return the IoU of each mask with the silhouette of what the other places say; of all for one place."""
        found = {}
        several = len(self._place_votes) > 1
        total = sum(self._place_votes.values())
        for place, votes in self._place_votes.items():
            mine = [photo for photo in self._views if self._places[photo] == place]
            occupied = self.hull.occupancy
            if several:
                occupied = (total - votes + self._solid() > 0) & ~self._below
                occupied = _main_pieces(occupied)
            others = replace(self.hull, occupancy=occupied)
            for photo in mine:
                found[photo] = overlap(masks[photo], others.silhouette(self._views[photo].camera))
        return {photo: found[photo] for photo in self._views}


def calibrated(ratio: np.ndarray, inside: np.ndarray, outside: np.ndarray) -> np.ndarray:
    """Return `ratio` (h, w) as the logarithm of how much more often it occurs inside than outside, (h, w) float32.

    inside, outside: (h, w) bool. A shiny object has the colours of its surroundings here and there, these are seldom
    unlike themselves; what is only somewhat likelier background is then no evidence at all.
    """
    edges = np.linspace(-SURE, SURE, _BINS + 1)
    logs = []
    for side in (inside, outside):
        counts = np.histogram(ratio[side], edges)[0].astype(float)
        counts = scipy.ndimage.gaussian_filter1d(counts, _BLUR, mode="nearest")
        logs.append(np.log(counts / max(counts.sum(), 1e-9) + _RARE / _BINS))
    rising = np.maximum.accumulate(logs[0] - logs[1])
    middles = (edges[1:] + edges[:-1]) / 2
    return np.clip(np.interp(ratio, middles, rising), -SURE, SURE).astype(np.float32)


def edge_cut(lab: np.ndarray, ratio: np.ndarray, shape: np.ndarray) -> np.ndarray:
    """Return the mask (h, w) bool near the volume's silhouette `shape` (h, w) bool, along edges of the photo.

    lab: (h, w, 3) float32, 8-bit CIELAB. ratio: (h, w) of `ColourLikelihood.log_ratio`.
    """
    if not shape.any():
        return shape
    distance = np.where(shape, _depth(shape) - 0.5, 0.5 - _away(shape)) - _WIDER
    evidence = ratio + np.clip(_SLOPE * distance, -_FAR, _BOUND)
    down, right = np.zeros(shape.shape), np.zeros(shape.shape)
    down[:-1], right[:, :-1] = (np.diff(lab, axis=0) ** 2).sum(-1), (np.diff(lab, axis=1) ** 2).sum(-1)
    cost = _EDGE * (_FREE + (1 - _FREE) * np.exp(-(down + right) / (2 * _CONTRAST**2)))
    rows, columns = (np.flatnonzero((distance > -_FAR / _SLOPE).any(axis=axis)) for axis in (1, 0))
    window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    mask = np.zeros(shape.shape, bool)
    mask[window] = minimum_cut(evidence[window], cost[window], _EDGE_STEPS)
    return mask | (
        scipy.ndimage.binary_fill_holes(mask) & shape
    )  # what the volume fills is a spot, no opening


def _box_shown(camera: Camera, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return where a box low..high (3,) shows, (h, w) bool; everywhere for a camera in it."""
    cv2 = opencv_library()
    shape = camera.height, camera.width
    ends = np.stack([low, high])
    corners = np.stack([ends[[i >> 2 & 1, i >> 1 & 1, i & 1], [0, 1, 2]] for i in range(8)])
    x, y, depth = camera.project(corners).T
    if (depth <= 0).any():
        return np.ones(shape, bool)
    picture = np.zeros(shape, np.uint8)
    outline = cv2.convexHull(np.round(np.stack([x, y], 1) - 0.5).astype(np.int32))
    cv2.fillConvexPoly(picture, outline, 1)
    return picture.astype(bool)


def _main_pieces(occupied: np.ndarray) -> np.ndarray:
    """Return voxels (N, N, N) bool without specks."""
    pieces, count = scipy.ndimage.label(occupied, structure=np.ones((3, 3, 3)))
    if count < 2:
        return occupied
    sizes = np.bincount(pieces.ravel())
    sizes[0] = 0
    return (sizes >= _SPECK * sizes.max())[pieces] & occupied


def _depth(mask: np.ndarray) -> np.ndarray:
    """Return how deep inside `mask` cells lie, of any shape; the border of the grid is no end of it."""
    if mask.all():
        return np.full(mask.shape, float(sum(mask.shape)))
    padded = np.pad(mask, 1, mode="edge")
    return scipy.ndimage.distance_transform_edt(padded)[tuple(slice(1, -1) for _ in mask.shape)]


def _away(mask: np.ndarray) -> np.ndarray:
    """Return how far outside of `mask` cells lie, of any shape; infinite where it is empty."""
    return scipy.ndimage.distance_transform_edt(~mask) if mask.any() else np.full(mask.shape, np.inf)
