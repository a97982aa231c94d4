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

The cube's 48 symmetries carry texels onto one another, and the rows with them: if symmetry k carries texel t onto f and
node m onto n, the weight of m in the row of t is that of n in the row of f. So of 6 R^2 rows only R (R + 2) / 8 are
computed, for the first texel of each orbit; the other rows hold the same numbers elsewhere.
"""

import functools
import math
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse
import torch

from lightprobe.kernels import lobe_rows, permute_rows
from lightprobe.kernels.lobe_rows import ROOT
from lightprobe.light import cubemap

_FRAMES = torch.stack(cubemap.frames(torch.device("cpu")), 1).numpy()  # (face, major|along|down, xyz)
_NEGLIGIBLE = 1e-4  # weights below this part of a row's largest are left out of tent rows


@dataclass(frozen=True)
class Nodes:
    """The averages of a light (6, R, R) that rows refer to: the pyramid's squares, then the grid's tents."""

    resolution: int  # R
    tent_resolution: int

    @property
    def squares(self) -> int:
        """Number of the pyramid's squares: 6 (2^2 + 4^2 + ... + R^2)."""
        return sum(6 * size * size for size in self._sizes())

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
            tables.append(carried(size) + np.int32(first))
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


def narrow_rows(
    directions: np.ndarray, alpha: float, nodes: Nodes, tolerance: float
) -> scipy.sparse.csr_array:
    """Return rows (N, nodes.total) over squares for unit directions (N, 3) float64; >= 0, each sums to 1.

    tolerance: the share of a row's weight that one square may misplace by its own size.
    """
    lobe = alpha, _lobe_integral(alpha), nodes.resolution, tolerance
    start, index, weight = lobe_rows(directions, _FRAMES, *lobe)
    return _normalised(scipy.sparse.csr_array((weight, index, start), shape=(len(directions), nodes.total)))


def wide_rows(directions: np.ndarray, alpha: float, nodes: Nodes) -> scipy.sparse.csr_array:
    """Return rows (N, nodes.total) over tents for unit directions (N, 3) float64; >= 0, each sums to 1."""
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
    entries = weight.ravel(), index.ravel(), start
    return scipy.sparse.csr_array(entries, shape=(len(points), 6 * tent_resolution**2))


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
    high = a2 + 0.5 * k
    bracket = (1.0 + 2.0 * a2 / k) * (1.0 / a2 - 1.0 / high) - 2.0 / k * math.log(high / a2)
    return 4.0 * math.pi / k * bracket


@dataclass(frozen=True)
class Orbits:
    """The orbits of a cubemap's texels: symmetry `by[t]` carries texel t onto `first[which[t]]`."""

    first: np.ndarray  # (K,) flat texel indices, ascending
    which: np.ndarray  # (6 R^2,) in 0..K-1
    by: np.ndarray  # (6 R^2,) in 0..47

    @staticmethod
    def of(resolution: int) -> "Orbits":
        """Return the orbits of 6 R^2 texels."""
        first, by = cubemap.symmetries(resolution, torch.device("cpu"))[0].min(0)
        unique, which = torch.unique(first, return_inverse=True)
        return Orbits(unique.numpy(), which.numpy(), by.numpy())


def carried(resolution: int) -> np.ndarray:
    """Return the texel that each of the cube's symmetries carries onto each texel, (48, 6 R^2) int32."""
    index, _ = cubemap.symmetries(resolution, torch.device("cpu"))
    texel = torch.arange(index.shape[1], dtype=torch.int32).expand_as(index)
    return torch.empty_like(texel).scatter_(1, index, texel).numpy()


def unfold(
    rows: scipy.sparse.csr_array, which: np.ndarray, by: np.ndarray, source: np.ndarray
) -> scipy.sparse.csr_array:
    """Return rows (T, N) from the rows of the orbits' first texels (K, N): row t is row `which[t]` permuted.

    which and by: (T,) as in `Orbits`. source: (48, N) int32, the node that each symmetry carries onto each
    node. Entries keep the order of the row that they come from, so that they are not sorted.
    """
    start, index, weight = permute_rows(rows.indptr, rows.indices, rows.data, which, by, source)
    return scipy.sparse.csr_array((weight, index, start), shape=(len(which), rows.shape[1]))
