"""Averages of a light under reflection lobes, as sparse rows over a few averages of its texels.

The prefiltered radiance of direction d at roughness r is the mean of the light under the lobe

    D(h) max(n.l, 0),  with v = n = d, h the half vector, D = GGX of alpha = r^2.

With t the chord |l - d|: (n.h)^2 = cos^2(angle / 2) = 1 - t^2/4 and n.l = 1 - t^2/2, so the lobe depends on t alone:

    lobe(t) = max(1 - t^2/2, 0) / (alpha^2 + (1 - alpha^2) t^2/4)^2    (half width about 2 alpha; a cosine if alpha = 1)

Rows over the light's own texels would be nearly full. They go over *nodes* instead, in one of two ways:

- Narrow lobes have a sharp core and a long faint tail. Nodes are area averages over the squares of a pyramid (2 x 2
  per face, 4 x 4, ... the texels): fine under the core, coarse in the tail, so that averaging the light over a node
  misplaces little of the row's weight. Under a lobe narrower than a texel the squares go on below the texel, which
  integrates the lobe properly; their weights add up in that texel.
- Wide lobes are smooth. Nodes are the light's moments with the tent functions of one coarse grid, and the weights are
  the least-squares fit of the lobe by these tents. Under a sun this is several times as exact as as many squares.
"""

import functools
import math
from dataclasses import dataclass

import numba
import numpy as np
import scipy.linalg
import scipy.sparse
import torch

from lightprobe.core.jit import compiled, threads
from lightprobe.light import cubemap
from lightprobe.light.orbits import sources

ROOT = 2  # squares along a face edge at the top of the pyramid
_GAUSS = 1.0 / math.sqrt(3.0)
_FRAMES = np.stack(
    [frame.numpy() for frame in cubemap.frames(torch.device("cpu"))], axis=1
)  # (face, major|along|down, xyz)
_NEGLIGIBLE = 1e-4  # weights below this part of a row's largest are left out of tent rows


@dataclass(frozen=True)
class Nodes:
    """The averages of a light (6, R, R) that rows refer to: the pyramid's squares, then the coarse grid's tents."""

    resolution: int  # R
    tent_resolution: int

    @property
    def squares(self) -> int:
        """Number of the pyramid's squares: 6 (2^2 + 4^2 + ... + R^2)."""
        return _pyramid_offset(2 * self.resolution)

    @property
    def total(self) -> int:
        """Number of all nodes."""
        return self.squares + 6 * self.tent_resolution**2

    def matrix(self) -> scipy.sparse.csr_array:
        """Return the matrix (total, 6 R^2) that averages a light over the nodes; rows sum to 1."""
        solid_angle = cubemap.exact_solid_angles(self.resolution).numpy()
        tents = _tents(self.resolution, self.tent_resolution).T.tocsr() * solid_angle.ravel()
        moments = scipy.sparse.vstack([*self._square_moments(solid_angle), tents], format="csr")
        return scipy.sparse.csr_array(scipy.sparse.diags_array(1.0 / moments.sum(axis=1)) @ moments)

    def sources(self) -> np.ndarray:
        """Return the node that each symmetry of the cube carries onto each node, (48, total) int32."""
        tables, first = [], 0
        for size in (*self._sizes(), self.tent_resolution):
            tables.append(sources(size) + np.int32(first))
            first += 6 * size * size
        return np.concatenate(tables, axis=1)

    def _sizes(self) -> list[int]:
        """Return the squares along a face edge in every level of the pyramid, from the top."""
        return [2**k for k in range(ROOT.bit_length() - 1, self.resolution.bit_length())]

    def _square_moments(self, solid_angle: np.ndarray) -> list[scipy.sparse.csr_array]:
        face, row, column = np.indices(solid_angle.shape)
        texel = np.arange(solid_angle.size)
        moments = []
        for size in self._sizes():
            ratio = self.resolution // size
            square = ((face * size + row // ratio) * size + column // ratio).ravel()
            shape = (6 * size * size, solid_angle.size)
            moments.append(scipy.sparse.csr_array((solid_angle.ravel(), (square, texel)), shape=shape))
        return moments


def narrow_rows(directions: np.ndarray, alpha: float, nodes: Nodes, tolerance: float) -> scipy.sparse.csr_array:
    """Return rows (N, nodes.total) over squares, for directions (N, 3) float64 unit; each is >= 0 and sums to 1.

    tolerance: the share of a row's weight that one square may misplace by its own size.
    """
    shape = (alpha, _lobe_integral(alpha), nodes.resolution, tolerance)
    threads(10_000 * len(directions))
    counts = np.zeros(len(directions), np.int64)
    nothing = np.zeros(0, np.int32), np.zeros(0)
    _refine(directions, _FRAMES, *shape, np.zeros_like(counts), counts, *nothing, False)
    start = np.concatenate([[0], np.cumsum(counts)])
    index, weight = np.empty(start[-1], np.int32), np.empty(start[-1])
    _refine(directions, _FRAMES, *shape, start[:-1], counts, index, weight, True)
    return _normalised(scipy.sparse.csr_array((weight, index, start), shape=(len(directions), nodes.total)))


def wide_rows(directions: np.ndarray, alpha: float, nodes: Nodes) -> scipy.sparse.csr_array:
    """Return rows (N, nodes.total) over tents, for directions (N, 3) float64 unit; each is >= 0 and sums to 1."""
    fit = _tent_fit(nodes.tent_resolution, min(nodes.resolution, 2 * nodes.tent_resolution))
    cosine = directions @ fit.directions.T
    projected = (_lobe_of_cosine(cosine, alpha) * fit.solid_angles) @ fit.tents
    height = scipy.linalg.cho_solve(fit.gram, projected.T).T
    weight = height.clip(min=0.0) * fit.mass
    weight[weight < _NEGLIGIBLE * weight.max(axis=1, keepdims=True)] = 0.0
    rows = scipy.sparse.csr_array(weight)
    nothing = scipy.sparse.csr_array((len(directions), nodes.squares))
    return _normalised(scipy.sparse.csr_array(scipy.sparse.hstack([nothing, rows], format="csr")))


@dataclass(frozen=True)
class _TentFit:
    """What the least-squares fit by tents needs: a dense grid of n points and K tents."""

    directions: np.ndarray  # (n, 3)
    solid_angles: np.ndarray  # (n,)
    tents: scipy.sparse.csr_array  # (n, K)
    gram: tuple[np.ndarray, bool]  # Cholesky factor of the tents' inner products
    mass: np.ndarray  # (K,) integral of each tent


@functools.lru_cache(maxsize=4)
def _tent_fit(tent_resolution: int, resolution: int) -> _TentFit:
    solid_angles = cubemap.exact_solid_angles(resolution).numpy().ravel()
    tents = _tents(resolution, tent_resolution)
    gram = (tents.T @ scipy.sparse.diags_array(solid_angles) @ tents).toarray()
    directions = cubemap.exact_directions(resolution).reshape(-1, 3).numpy()
    return _TentFit(directions, solid_angles, tents, scipy.linalg.cho_factor(gram), tents.T @ solid_angles)


def _tents(resolution: int, tent_resolution: int) -> scipy.sparse.csr_array:
    """Return the values (6 R^2, K) of the coarse grid's tents, bilinear and seamless, at the texel centres."""
    points = cubemap.exact_directions(resolution).reshape(-1, 3)
    index, weight = (taps.numpy() for taps in cubemap.bilinear_taps(points, tent_resolution))
    start = np.arange(0, index.size + 1, index.shape[1])
    return scipy.sparse.csr_array((weight.ravel(), index.ravel(), start), shape=(len(points), 6 * tent_resolution**2))


def _normalised(rows: scipy.sparse.csr_array) -> scipy.sparse.csr_array:
    return scipy.sparse.csr_array(scipy.sparse.diags_array(1.0 / rows.sum(axis=1)) @ rows)


def _lobe_of_cosine(cosine: np.ndarray, alpha: float) -> np.ndarray:
    """Return the lobe at n.l = cosine; only for wide lobes, as 1 - cosine loses the digits of small chords."""
    return cosine.clip(min=0.0) / (alpha**2 + (1.0 - alpha**2) * 0.5 * (1.0 - cosine)) ** 2


def _lobe_integral(alpha: float) -> float:
    """Return the integral of the lobe over the sphere: with q = t^2/4, dl = 4 pi dq and q runs from 0 to 1/2."""
    a2, k = alpha**2, 1.0 - alpha**2
    if k < 1e-4:
        return math.pi
    low, high = a2, a2 + 0.5 * k
    return 4.0 * math.pi / k * ((1.0 + 2.0 * a2 / k) * (1.0 / low - 1.0 / high) - 2.0 / k * math.log(high / low))


@compiled()
def _lobe(chord2: float, alpha: float) -> float:
    quarter = 0.25 * chord2
    denominator = alpha * alpha + (1.0 - alpha * alpha) * quarter
    return max(1.0 - 2.0 * quarter, 0.0) / (denominator * denominator)


@compiled()
def _pyramid_offset(size: int) -> int:
    """Return the number of squares in the pyramid's levels above the one with `size` squares along an edge."""
    return 2 * (size * size - ROOT * ROOT)


@compiled()
def _chord2(frame: np.ndarray, direction: np.ndarray, a: float, b: float) -> tuple[float, float]:
    """Return the squared chord from `direction` to the face point (a, b), and that point's distance from the origin."""
    length = math.sqrt(1.0 + a * a + b * b)
    chord2 = 0.0
    for axis in range(3):
        step = (frame[0, axis] + a * frame[1, axis] + b * frame[2, axis]) / length - direction[axis]
        chord2 += step * step
    return chord2, length


@compiled()
def _square_weight(frame: np.ndarray, direction: np.ndarray, x: int, y: int, size: int, alpha: float) -> float:
    """Return the integral of the lobe over a square by 2 x 2 Gauss points on the face plane."""
    weight = 0.0
    for corner in range(4):
        a = (2.0 * x + 1.0 + (_GAUSS if corner & 1 else -_GAUSS)) / size - 1.0
        b = (2.0 * y + 1.0 + (_GAUSS if corner & 2 else -_GAUSS)) / size - 1.0
        chord2, length = _chord2(frame, direction, a, b)
        weight += _lobe(chord2, alpha) / (length * length * length)
    return weight / (size * size)


@compiled(parallel=True)
def _refine(
    directions: np.ndarray, frames: np.ndarray, alpha: float, total: float, resolution: int, tolerance: float,
    start: np.ndarray, counts: np.ndarray, index: np.ndarray, weight: np.ndarray, write: bool,
) -> None:  # fmt: skip
    """Refine each row's pyramid from the top, depth first; count its entries or write them from `start`.

    All parts of a texel follow one another in this order, so they add up in the entry written last.
    """
    for row in numba.prange(len(directions)):
        direction = directions[row]
        stack = np.empty((160, 4), np.int64)
        top, count, last = 0, 0, -1
        for root in range(6 * ROOT * ROOT):
            stack[top] = (ROOT, root // (ROOT * ROOT), root // ROOT % ROOT, root % ROOT)
            top += 1
        while top > 0:
            top -= 1
            size, face, y, x = stack[top]
            chord2, length = _chord2(
                frames[face], direction, (2.0 * x + 1.0) / size - 1.0, (2.0 * y + 1.0) / size - 1.0
            )
            area = 4.0 / (size * size * length * length * length)
            extent = math.sqrt(area)
            near = max(math.sqrt(chord2) - 0.75 * extent, 0.0)  # about the closest point of the square
            share = min(area * _lobe(near * near, alpha) / total, 1.0)
            if share <= 0.0:
                continue
            deeper = share * extent > tolerance * math.sqrt(4.0 * alpha * alpha + near * near)
            if deeper and top + 4 <= len(stack):  # a lobe without width would go down for ever
                for quarter in range(4):
                    stack[top] = (2 * size, face, 2 * y + quarter // 2, 2 * x + quarter % 2)
                    top += 1
                continue
            ratio = max(size // resolution, 1)
            level = size // ratio
            node = _pyramid_offset(level) + (face * level + y // ratio) * level + x // ratio
            if node != last:
                last = node
                count += 1
                if write:
                    index[start[row] + count - 1] = node
                    weight[start[row] + count - 1] = 0.0
            if write:
                weight[start[row] + count - 1] += _square_weight(frames[face], direction, x, y, size, alpha)
        counts[row] = count
