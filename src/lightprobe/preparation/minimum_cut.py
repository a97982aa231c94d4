"""The minimum cut of a grid between two labels, by its convex relaxation.

    minimise  sum_x area(x) |grad u(x)| - sum_x evidence(x) u(x)  over 0 <= u <= 1

Where u > 1/2 is a minimum cut for almost any level in place of 1/2 (Chan, Esedoglu, Nikolova 2006); unlike a cut of
a graph it measures lengths alike in all directions. Found by the primal-dual steps of Chambolle and Pock (2011).
"""

from collections.abc import Sequence

import numpy as np
import torch


def minimum_cut(
    evidence: np.ndarray, area: float | np.ndarray, steps: int, spacing: Sequence[float] | None = None
) -> np.ndarray:
    """Return which cells of a grid, of any shape, have the label that positive `evidence` speaks for, bool.

    evidence: float, of the grid's shape. area: cost of a face between labels, one or one for each cell. spacing:
    size of a cell along each axis; only their ratios matter.
    """
    given = torch.from_numpy(np.ascontiguousarray(evidence, np.float32))
    cost = torch.as_tensor(np.asarray(area, np.float32))
    lengths = np.ones(given.dim()) if spacing is None else np.asarray(spacing, float)
    scale = (np.exp(np.log(lengths).mean()) / lengths).tolist()
    u, dual = torch.full_like(given, 0.5), torch.zeros((given.dim(), *given.shape))
    step = 1 / (2 * float(np.linalg.norm(scale)))  # the operator's norm is at most its inverse
    ahead = u
    for _ in range(steps):
        for axis, weight in enumerate(scale):
            dual[axis].narrow(axis, 0, given.shape[axis] - 1).add_(ahead.diff(dim=axis), alpha=step * weight)
        dual /= dual.square().sum(0).sqrt_().div_(cost.clamp_min(1e-6)).clamp_(min=1)
        descent = given.clone()
        for axis, weight in enumerate(scale):
            descent.add_(dual[axis], alpha=weight)
            inner = given.shape[axis] - 1
            descent.narrow(axis, 1, inner).sub_(dual[axis].narrow(axis, 0, inner), alpha=weight)
        before, u = u, (u + step * descent).clamp_(0, 1)
        ahead = 2 * u - before
    return u.numpy() > 0.5
