"""A pose refined by the light itself: for any pose the photo is linear in its light, so both are sought
together.

At a pose q, with A(q) the coarse transport of some of the object's pixels, I their colours in the photo, W
weights, d_k the distance from point k of the rendered outline to an edge of the photo, m_j the distance from
feature j of the photo to where the point that it matches is seen, and w_j its weight:

    minimise over q and E:  |A E - I(q)|_W^2 + pull |E - level|^2 + weight sum_k d_k^2 + sum_j w_j m_j^2

The light is eliminated (variable projection; Golub & Pereyra 1973, in Kaufman's form): the best E(q) is a
ridge regression, and a step of the pose is judged by what the light cannot make up for, J - A (A^T W A +
R)^-1 A^T W J, with J how the photo's colours change as points of the object move over them.

Edges: k pixels out along the outward normal, the photo's appearance a (`localization.appearance`) steps by
h(k) = | mean a(k + 1, k + 2) - mean a(k - 1, k - 2) |. An edge is the object's if its inside looks as the
object does there, in appearance o, under the light found so far:

    support(k) = h / (h + softness) exp(-|mean a(k - 1, k - 2) - o|^2 / 2 tolerance^2)
"""

from dataclasses import dataclass

import numpy as np
import scipy
import torch
from torch import Tensor

from lightprobe.core.device import draw_rows, generator
from lightprobe.localization.appearance import PhotoPyramid, ScaledPhoto, appearance
from lightprobe.localization.known_object import KnownObject
from lightprobe.localization.matching import NO_MATCHES, Matches, Pull
from lightprobe.localization.pose import PARAMETERS, mean_distance, motion, moved
from lightprobe.render.surface import Surface, View, visible_surface
from lightprobe.scene.camera import Camera
from lightprobe.scene.overlay import outline

_SOFTNESS = 0.15  # of appearance: a step of this size counts half
_TOLERANCE = 0.5  # of appearance, between the object under a coarse light and the photo
_PIXELS, _OUTLINE = 600, 160  # that a step looks at, of an object of 80 pixels; fewer of a smaller one
_PULL = 0.03  # to a grey light, relative to what the pixels weigh
_DARK = 0.05  # of the mean colour: darker pixels weigh no more
_ERROR = 0.15  # relative, of a right pose's pixels; larger ones weigh less
_EDGE_ERROR = 1.0  # pixels, likewise
_EDGES_WEIGH = 1.0  # the outline against the surface
_FEWEST = 40  # pixels of the object from which there is anything to refine
_DAMPING = 1e-3  # of the steps, relative
_LARGEST_STEP = 0.12  # radians, or distances from the object
_LEAST_TOLD = 1e-9  # about a step that nothing tells of


@dataclass(frozen=True)
class Outline:
    """M points on the rendered outline, in pixels of a `ScaledPhoto`."""

    row: np.ndarray  # (M,) int64 rows of the G-buffer, the object's pixels along the outline
    place: np.ndarray  # (M, 2) x and y of the outline
    normal: np.ndarray  # (M, 2) unit, outward


def outline_of(pixel: np.ndarray, width: int, height: int, count: int) -> Outline:
    """Return at most `count` points of the outline of the object's row-major pixels (P,), ascending."""
    mask = np.zeros(width * height, bool)
    mask[pixel] = True
    shape = mask.reshape(height, width)
    soft = scipy.ndimage.gaussian_filter(shape.astype(np.float32), 1.5)
    down, across = np.gradient(soft)
    flat = np.flatnonzero(outline(shape))
    normal = -np.stack([across.ravel()[flat], down.ravel()[flat]], 1)
    length = np.linalg.norm(normal, axis=1)
    sound = np.flatnonzero(length > 0.02)
    sound = sound[np.linspace(0, len(sound) - 1, min(count, len(sound))).astype(int)] if len(sound) else sound
    flat, normal = flat[sound], normal[sound] / length[sound, None]
    center = np.stack([flat % width, flat // width], 1) + 0.5
    return Outline(np.searchsorted(pixel, flat), center + 0.5 * normal, normal)


def edge_support(
    photo: ScaledPhoto, outline: Outline, object_appearance: np.ndarray, reach: int
) -> np.ndarray:
    """Return the support (M, 2 reach + 1) of edges at -reach..reach pixels from the outline.

    object_appearance: (M, 3) of the object at the outline's points.
    """
    steps = np.arange(-reach - 2, reach + 3)
    at = outline.place[:, None] + steps[None, :, None] * outline.normal[:, None] - 0.5
    where = [at[..., 1].ravel(), at[..., 0].ravel()]
    planes = np.moveaxis(photo.appearance, 2, 0)
    each = [scipy.ndimage.map_coordinates(plane, where, order=1, mode="nearest") for plane in planes]
    seen = np.stack(each, -1).reshape(*at.shape[:2], 3)
    inside = 0.5 * (seen[:, :-4] + seen[:, 1:-3])
    outside = 0.5 * (seen[:, 3:-1] + seen[:, 4:])
    jump = np.linalg.norm(outside - inside, axis=2)
    off = ((inside - object_appearance[:, None]) ** 2).sum(2)
    return jump / (jump + _SOFTNESS) * np.exp(-0.5 * off / _TOLERANCE**2)


def nearest_edges(support: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return distance in pixels and weight, each (M,), of the best edge across each point of the outline.

    support: (M, 2 reach + 1) of `edge_support`; far edges have to be stronger than near ones.
    """
    reach = support.shape[1] // 2
    steps = np.arange(-reach, reach + 1)
    pull = support * np.exp(-0.5 * (steps / max(0.7 * reach, 1)) ** 2)
    best = pull.argmax(1)
    rows = np.arange(len(support))
    inner = best.clip(1, 2 * reach - 1)
    low, mid, high = (support[rows, inner + k] for k in (-1, 0, 1))
    bend = low - 2 * mid + high
    fine = np.where(bend < -1e-6, 0.5 * (low - high) / np.minimum(bend, -1e-6), 0).clip(-0.5, 0.5)
    return inner - reach + fine, support[rows, best]


@dataclass(frozen=True)
class Fit:
    """How much of a photo light explains at a pose, how well edges meet the outline, how many features agree."""

    explained: float  # 1 - unexplained over spread, of the object's pixels; at most 1
    edges: float  # mean support of the outline by edges within a pixel, 0 to 1
    agreed: float = 0.0  # share of the matched features that agree, 0 to 1

    @property
    def score(self) -> float:
        """One number to choose among poses of one photo by."""
        return 0.5 * float(np.log(1 / max(1.02 - self.explained, 0.02))) + 2 * self.edges + self.agreed


def refine(
    known: KnownObject,
    pyramid: PhotoPyramid,
    camera: Camera,
    *,
    matches: Matches = NO_MATCHES,
    diameter: float,
    steps: int,
    focal: bool = False,
    still: float = 0.0,
) -> tuple[Camera, Fit]:
    """Return the best pose met in `steps` steps from a normalised-frame `camera` in the photo's pixels.

    diameter: pixels of the object's sphere at the size that the photo is scaled to. focal: whether the focal
    length is free. still: pixels at that size; the pose stands still, and is not refined any more, when two steps in
    turn have moved the object by less in the mean.
    """
    best, motions = None, [np.inf]
    for step in range(steps + 1):
        seen = _Seen.of(known, pyramid, camera, diameter, step, matches)
        if seen is None:
            break
        if best is None or seen.fit.score > best[1].score:
            best = camera, seen.fit
        if step == steps:
            break
        start, camera = camera, moved(camera, seen.step(focal))
        scale = diameter * float(np.linalg.norm(start.position)) / (2 * start.fx)
        motions.append(mean_distance(start, camera, known.points) * scale)
        if max(motions[-2:]) < still:
            break
    return best if best is not None else (camera, Fit(0.0, 0.0))


def pose_uncertainty(
    known: KnownObject, pyramid: PhotoPyramid, camera: Camera, points: np.ndarray, *, diameter: float
) -> float:
    """Return how far the object could move and hardly be explained worse, in its sphere's diameters.

    The pose's covariance is the inverse of the matrix of its steps (Laplace's approximation), times the mean
    square of the unexplained residuals, as if all pixels of a channel had one error in common, and all points
    of the outline another. The result is the root mean square motion of `points` (N, 3) on the object under
    this covariance with a fixed focal length; infinite where the object is not in the photo. The other
    arguments are those of `refine`.
    """
    seen = _Seen.of(known, pyramid, camera, diameter, 0, NO_MATCHES)
    if seen is None:
        return float("inf")
    matrix, _ = seen.system(focal=False)
    moves = motion(camera, points)[..., : len(matrix)]
    product = np.einsum("nxk,nxl->kl", moves, moves) / len(moves)
    spread = np.trace(np.linalg.solve(matrix + _LEAST_TOLD * np.eye(len(matrix)), product))
    unexplained = (seen.weight * seen.residual**2).sum() + (seen.trust * seen.distance**2).sum()
    mean_unexplained = unexplained / (len(seen.residual) + 1)  # of the channels and the outline
    diameter_here = 2 * camera.fx / float(np.linalg.norm(camera.position))
    return float(np.sqrt(spread * mean_unexplained)) / diameter_here


@dataclass(frozen=True)
class _Seen:
    """A pose's pixels: their system for light and pose."""

    fit: Fit
    transport: np.ndarray  # (3, N, T)
    weight: np.ndarray  # (3, N)
    residual: np.ndarray  # (3, N) A E - I under the best light
    change: np.ndarray  # (3, N, 7) of the residual with a step
    ridge: np.ndarray  # (3,) pull to the grey light
    outline_motion: np.ndarray  # (M, 7) of the outline along its normal, pixels
    distance: np.ndarray  # (M,) to the photo's edge
    trust: np.ndarray  # (M,)
    matched_motion: np.ndarray  # (K, 2, 7) of matched points, pixels
    pull: Pull

    @staticmethod
    def of(
        known: KnownObject,
        pyramid: PhotoPyramid,
        camera: Camera,
        diameter: float,
        turn: int,
        matches: Matches,
    ) -> "_Seen | None":
        """Return what a pose shows, or None where the object is not in the photo."""
        far = float(np.linalg.norm(camera.position))
        if not 1.05 < far < 1e3:
            return None
        photo = pyramid.near(diameter / (2 * camera.fx / far))
        small = camera.resized(*photo.size)
        view = View.of(small, known.mesh.vertices.device)
        surface = visible_surface(known.mesh.vertices, known.mesh.faces, view)
        if len(surface.pixel) < _FEWEST:
            return None
        share = min(1.0, diameter / 80)
        outline = outline_of(surface.pixel.cpu().numpy(), *photo.size, round(_OUTLINE * share))
        every = torch.arange(len(surface.pixel))
        some = draw_rows(every, round(_PIXELS * share), generator(0, "locate-pixels", turn))
        chosen = torch.cat([torch.from_numpy(outline.row), some]).to(surface.pixel.device)
        reach = int(np.clip(0.1 * np.sqrt(len(surface.pixel)), 3, 8))  # a tenth of the object's size
        return _seen(known, photo, small, view, surface.select(chosen), outline, reach, matches.pull(small))

    def step(self, focal: bool) -> np.ndarray:
        """Return the damped Gauss-Newton step (7,) of the pose."""
        matrix, right = self.system(focal)
        step = np.zeros(PARAMETERS)
        damped = matrix + np.diag(_DAMPING * np.diag(matrix) + 1e-3)
        step[: len(right)] = np.linalg.solve(damped, right)
        return step * min(1.0, _LARGEST_STEP / max(float(np.abs(step).max()), 1e-9))

    def system(self, focal: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return matrix (K, K) and right side (K,) of the Gauss-Newton step, K = 7 or, without `focal`, 6."""
        matrix, right = np.zeros((PARAMETERS, PARAMETERS)), np.zeros(PARAMETERS)
        channels = (self.transport, self.weight, self.residual, self.change, self.ridge)
        a, w, r, j, pull = (torch.from_numpy(channel) for channel in channels)
        made_up = _ridge_regression(a, w, pull, (a.mT * w[:, None]) @ j)
        weighted = j.mT * w[:, None]
        matrix += (weighted @ (j - a @ made_up)).sum(0).numpy()
        right -= (weighted @ r[..., None]).sum(0)[:, 0].numpy()
        trusted = self.outline_motion.T * (_EDGES_WEIGH * self.trust)
        matrix += trusted @ self.outline_motion
        right += trusted @ self.distance
        pulled = np.einsum("kxn,k->nkx", self.matched_motion, self.pull.weight)
        matrix += np.einsum("nkx,kxm->nm", pulled, self.matched_motion)
        right += np.einsum("nkx,kx->n", pulled, self.pull.off)
        free = slice(0, PARAMETERS if focal else PARAMETERS - 1)
        return matrix[free, free], right[free]


def _seen(
    known: KnownObject,
    photo: ScaledPhoto,
    camera: Camera,
    view: View,
    surface: Surface,
    outline: Outline,
    reach: int,
    pull: Pull,
) -> _Seen:
    """Return the system of the chosen `surface` points, those of the `outline` first.

    reach: pixels from the outline in which edges are looked for.
    """
    edge = len(outline.row)
    inner = slice(edge, None)
    full = known.transport(surface, view).double().cpu().numpy()
    pixel, points = surface.pixel.cpu().numpy(), surface.position.double().cpu().numpy()
    row, column = np.divmod(pixel, photo.size[0])
    color, clipped = photo.color[row, column], photo.clipped[row, column]
    inside = color[inner].T
    moves = motion(camera, points)
    weight, ridge, light = fitted_light(full[:, inner], inside, clipped[inner].T)
    render = np.einsum("cnt,ct->nc", full, light)
    residual = (render - color)[inner].T
    change = -np.einsum("ncx,nxk->cnk", photo.gradient[row, column][inner], moves[inner])
    looks = appearance(torch.from_numpy(render[:edge])).numpy()
    support = edge_support(photo, outline, looks, reach)
    distance, trust = nearest_edges(support)
    trust = trust / (1 + (distance / (3 * _EDGE_ERROR)) ** 2) / _EDGE_ERROR**2 / max(edge, 1)
    along = np.einsum("mx,mxk->mk", outline.normal, moves[:edge])
    near = support[:, reach - 1 : reach + 2].max(1) if edge else np.zeros(1)
    mean = (weight * inside).sum(1, keepdims=True) / np.maximum(weight.sum(1, keepdims=True), 1e-12)
    spread, left = (weight * (inside - mean) ** 2).sum(), (weight * residual**2).sum()
    fit = Fit(1 - float(left / max(spread, 1e-12)), float(near.mean()), pull.agreed)
    scale = 1 / max(len(residual[0]), 1)
    robust = weight * scale / (1 + weight * residual**2)
    moves_matched = motion(camera, pull.point)
    return _Seen(
        fit,
        full[:, inner],
        robust,
        residual,
        change,
        ridge * scale,
        along,
        distance,
        trust,
        moves_matched,
        pull,
    )


def fitted_light(
    matrix: np.ndarray, color: np.ndarray, clipped: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return weights (3, N), pulls (3,) and light (3, T) of the ridge regression for linear `color` (3, N).

    matrix: (3, N, T) of `KnownObject.transport`. clipped: (3, N) bool, values that tell nothing.
    """
    mean = max(float(color.mean()), 1e-6)
    size = color.mean(0) + _DARK * mean
    weight = np.where(clipped, 0.0, 1.0) / (_ERROR**2 * size * max(mean, 1e-6))
    white = matrix.sum(2)
    level = (weight * white * color).sum() / max(float((weight * white**2).sum()), 1e-12)
    ridge = _PULL * (weight * white**2).sum(1) / matrix.shape[2] + 1e-9
    a, w, pull = (torch.from_numpy(values) for values in (matrix, weight, ridge))
    right = (a.mT @ torch.from_numpy(weight * color)[..., None]) + (pull * level)[:, None, None]
    light = _ridge_regression(a, w, pull, right)[..., 0].numpy()
    return weight, ridge, light


def _ridge_regression(matrix: Tensor, weight: Tensor, pull: Tensor, right: Tensor) -> Tensor:
    """Return x (3, T, K) of (A^T W A + pull) x = `right` (3, T, K), by channel.

    By PyTorch, as NumPy's library of linear algebra lets its threads wait by spinning: beside other work, several
    times as much as all else of a step takes.
    """
    normal = (matrix.mT * weight[:, None]) @ matrix
    normal.diagonal(dim1=1, dim2=2).add_(pull[:, None])
    return torch.linalg.solve(normal, right)
