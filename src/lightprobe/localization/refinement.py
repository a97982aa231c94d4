"""A pose refined by the light itself: for any pose the photo is linear in its light, so both are sought together.

At a pose q, with A(q) the coarse transport of some of the object's pixels, I their colours in the photo, W weights:

    minimise over q and E:  |A E - I(q)|_W^2 + pull |E - level|^2 + weight sum_k (distance to the photo's edge)_k^2

The light is eliminated (variable projection; Golub & Pereyra 1973, in Kaufman's form): the best E(q) is a ridge
regression, and a step of the pose is judged by what the light cannot make up for, J - A (A^T W A + R)^-1 A^T W J, with
J how the photo's colours change as points of the object move over them. So the light may be any.
"""

from dataclasses import dataclass

import numpy as np
import torch

from lightprobe.core.device import draw_rows, generator
from lightprobe.localization.appearance import appearance
from lightprobe.localization.contour import Outline, edge_support, nearest_edges, outline_of
from lightprobe.localization.known_object import KnownObject
from lightprobe.localization.level import Level, Levels
from lightprobe.localization.pose import PARAMETERS, motion, moved
from lightprobe.render.surface import Surface, View, visible_surface
from lightprobe.scene.camera import Camera

_PIXELS, _OUTLINE = (
    600,
    160,
)  # that a step looks at, of an object of 80 pixels and more; fewer of a smaller one
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
class Fit:
    """What a photo shows at a pose: how much of it light explains, and how well its edges meet the outline."""

    explained: float  # 1 - unexplained over spread, of the object's pixels; at most 1
    edges: float  # mean support of the outline by edges within a pixel, 0 to 1

    @property
    def score(self) -> float:
        """One number to choose among poses of one photo by."""
        return 0.5 * float(np.log(1 / max(1.02 - self.explained, 0.02))) + 2 * self.edges


def refine(
    known: KnownObject, levels: Levels, camera: Camera, *, diameter: float, steps: int, focal: bool = False
) -> tuple[Camera, Fit]:
    """Return the best of the poses met in `steps` steps from `camera`, normalised frame and the photo's
    pixels.

    diameter: pixels of the object's sphere at the size the photo is worked at. focal: whether the focal
    length is free.
    """
    best = None
    for step in range(steps + 1):
        seen = _Seen.of(known, levels, camera, diameter, step)
        if seen is None:
            break
        if best is None or seen.fit.score > best[1].score:
            best = camera, seen.fit
        if step < steps:
            camera = moved(camera, seen.step(focal))
    return best if best is not None else (camera, Fit(0.0, 0.0))


def leeway(
    known: KnownObject, levels: Levels, camera: Camera, points: np.ndarray, *, diameter: float
) -> float:
    """Return how far the object could move in the photo and hardly be explained worse, in its sphere's
    diameters.

    The pose's covariance is the inverse of the matrix of its steps (Laplace's approximation), times the mean
    square of what stays unexplained: as if all pixels of a channel had one error in common, and so all of the
    outline. What is returned is the root mean square motion of `points` (N, 3) on the object under it, with
    the focal length as it is; infinite where the object is not in the photo. The rest as in `refine`.
    """
    seen = _Seen.of(known, levels, camera, diameter, 0)
    if seen is None:
        return float("inf")
    matrix, _ = seen.system(focal=False)
    moves = motion(camera, points)[..., : len(matrix)]
    product = np.einsum("nxk,nxl->kl", moves, moves) / len(moves)
    spread = np.trace(np.linalg.solve(matrix + _LEAST_TOLD * np.eye(len(matrix)), product))
    unexplained = (seen.weight * seen.residual**2).sum() + (seen.trust * seen.distance**2).sum()
    mean_unexplained = unexplained / (len(seen.residual) + 1)  # of the channels and the outline
    return float(np.sqrt(spread * mean_unexplained)) / (
        2 * camera.fx / float(np.linalg.norm(camera.position))
    )


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

    @staticmethod
    def of(known: KnownObject, levels: Levels, camera: Camera, diameter: float, turn: int) -> "_Seen | None":
        """Return what a pose shows, or None where the object is not in the photo."""
        far = float(np.linalg.norm(camera.position))
        if not 1.05 < far < 1e3:
            return None
        level = levels.near(diameter / (2 * camera.fx / far))
        small = camera.resized(*level.size)
        view = View.of(small, known.mesh.vertices.device)
        surface = visible_surface(known.mesh.vertices, known.mesh.faces, view)
        if len(surface.pixel) < _FEWEST:
            return None
        share = min(1.0, diameter / 80)
        outline = outline_of(surface.pixel.cpu().numpy(), *level.size, round(_OUTLINE * share))
        chosen = _chosen(surface, outline, round(_PIXELS * share), turn)
        return _seen(known, level, small, view, surface.select(chosen), outline, len(surface.pixel))

    def step(self, focal: bool) -> np.ndarray:
        """Return the damped Gauss-Newton step (7,) of the pose."""
        matrix, right = self.system(focal)
        step = np.zeros(PARAMETERS)
        damped = matrix + np.diag(_DAMPING * np.diag(matrix) + 1e-3)
        step[: len(right)] = np.linalg.solve(damped, right)
        return step * min(1.0, _LARGEST_STEP / max(float(np.abs(step).max()), 1e-9))

    def system(self, focal: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return matrix (K, K) and right side (K,) of the Gauss-Newton step, K = 7 with a free focal length,
        else 6.
        """
        matrix, right = np.zeros((PARAMETERS, PARAMETERS)), np.zeros(PARAMETERS)
        for a, w, r, j, pull in zip(
            self.transport, self.weight, self.residual, self.change, self.ridge, strict=True
        ):
            weighted = a.T * w
            made_up = np.linalg.solve(weighted @ a + pull * np.eye(a.shape[1]), weighted @ j)
            matrix += (j.T * w) @ (j - a @ made_up)
            right -= (j.T * w) @ r
        trusted = self.outline_motion.T * (_EDGES_WEIGH * self.trust)
        matrix += trusted @ self.outline_motion
        right += trusted @ self.distance
        free = slice(0, PARAMETERS if focal else PARAMETERS - 1)
        return matrix[free, free], right[free]


def _chosen(surface: Surface, outline: Outline, count: int, turn: int) -> torch.Tensor:
    """Return the rows of the pixels to look at: the outline's, then some of all."""
    every = torch.arange(len(surface.pixel))
    some = draw_rows(every, count, generator(0, "locate-pixels", turn))
    return torch.cat([torch.from_numpy(outline.row), some]).to(surface.pixel.device)


def _seen(
    known: KnownObject,
    level: Level,
    camera: Camera,
    view: View,
    surface: Surface,
    outline: Outline,
    count: int,
) -> _Seen:
    """Return the system of the chosen `surface` points, those of the `outline` first."""
    edge = len(outline.row)
    full = known.transport(surface, view).double().cpu().numpy()
    pixel, points = surface.pixel.cpu().numpy(), surface.position.double().cpu().numpy()
    column, row = pixel % level.size[0], pixel // level.size[0]
    color, clipped = level.color[row, column], level.clipped[row, column]
    inner = slice(edge, None)
    moves = motion(camera, points)
    weight, ridge, light = fitted_light(full[:, inner], color[inner].T, clipped[inner].T)
    render = np.einsum("cnt,ct->nc", full, light)
    residual = (render - color)[inner].T
    gradient = level.gradient[row, column][inner]
    change = -np.einsum("ncx,nxk->cnk", gradient, moves[inner])
    support = edge_support(
        level, outline, appearance(torch.from_numpy(render[:edge])).numpy(), _reach(level, count)
    )
    distance, trust = nearest_edges(support)
    trust = trust / (1 + (distance / (3 * _EDGE_ERROR)) ** 2) / _EDGE_ERROR**2 / max(edge, 1)
    along = np.einsum("mx,mxk->mk", outline.normal, moves[:edge])
    middle = support.shape[1] // 2
    near = support[:, middle - 1 : middle + 2].max(1) if edge else np.zeros(1)
    spread = (weight * (color[inner].T - _mean(color[inner].T, weight)) ** 2).sum()
    left = (weight * residual**2).sum()
    fit = Fit(1 - float(left / max(spread, 1e-12)), float(near.mean()))
    scale = 1 / max(len(residual[0]), 1)
    robust = weight * scale / (1 + weight * residual**2)
    return _Seen(fit, full[:, inner], robust, residual, change, ridge * scale, along, distance, trust)


def _reach(level: Level, count: int) -> int:
    """Return how many pixels from the outline edges are looked for: a tenth of the object's size."""
    return int(np.clip(0.1 * np.sqrt(count), 3, 8))


def fitted_light(
    matrix: np.ndarray, color: np.ndarray, clipped: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return weights (3, N), pulls (3,) and the light (3, T) of the ridge regression for linear colours (3,
    N).

    matrix: (3, N, T) of `KnownObject.transport`. clipped: (3, N) bool, values that tell nothing.
    """
    mean = max(float(color.mean()), 1e-6)
    size = color.mean(0) + _DARK * mean
    weight = np.where(clipped, 0.0, 1.0) / (_ERROR**2 * size * max(mean, 1e-6))
    white = matrix.sum(2)
    level = (weight * white * color).sum() / max(float((weight * white**2).sum()), 1e-12)
    ridge = _PULL * (weight * white**2).sum(1) / matrix.shape[2] + 1e-9
    light = np.empty((3, matrix.shape[2]))
    for c in range(3):
        weighted = matrix[c].T * weight[c]
        right = weighted @ color[c] + ridge[c] * level
        light[c] = np.linalg.solve(weighted @ matrix[c] + ridge[c] * np.eye(matrix.shape[2]), right)
    return weight, ridge, light


def _mean(color: np.ndarray, weight: np.ndarray) -> np.ndarray:
    return (weight * color).sum(1, keepdims=True) / np.maximum(weight.sum(1, keepdims=True), 1e-12)
