"""The weights of reflection lobes over the squares of a pyramid on the cube's faces, by adaptive refinement.

    d (N, 3) unit directions     t = |l - d| the chord to a direction l     alpha the width of all N lobes
    lobe(t) = max(1 - t^2/2, 0) / (alpha^2 + (1 - alpha^2) t^2/4)^2       (where it comes from: `light.lobes`)

Level s = 2, 4, ... R of the pyramid has s x s squares per face; node 2 (s^2 - 4) + (face s + row) s + column
is one of them. From the top, a square is cut into its quarters while it might misplace too much of the lobe:
while share x extent > tolerance sqrt(4 alpha^2 + near^2), where share bounds the square's part of the whole
lobe, extent is the square root of its area on the sphere, and near the chord to about its closest point. A
square that is not cut gives its node the lobe's integral, by 2 x 2 Gauss points on the face plane; squares
below level R give it to the node that they lie in.
"""

import numpy as np

from lightprobe.kernels import dispatch

ROOT = 2  # squares along a face edge at the top of the pyramid
STEPS_PER_ROW = 10_000  # nanoseconds or so


def lobe_rows(
    directions: np.ndarray, frames: np.ndarray, alpha: float, total: float, resolution: int, tolerance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return compressed rows: start (N + 1,) int64, node (entries,) int32 and weight (entries,) float64 >= 0.

    directions (N, 3) float64; frames (6, 3, 3) float64, each face's major, along and down axis; total: the
    lobe's integral over the sphere, in which `tolerance` is counted; resolution R, a power of two from 2. A
    node is named once in a row, and nodes are not sorted. NumPy arrays on the CPU; not differentiable.
    """
    loops = dispatch.compiled_loops("lobe_rows", STEPS_PER_ROW * len(directions))
    lobe = (alpha, total, resolution, tolerance)
    counts = np.zeros(len(directions), np.int64)
    nothing = np.zeros(0, np.int32), np.zeros(0)
    loops.refine(directions, frames, lobe, np.zeros_like(counts), counts, *nothing, False)  # counts entries
    start = np.concatenate([[0], np.cumsum(counts)])
    index, weight = np.empty(start[-1], np.int32), np.empty(start[-1])
    loops.refine(directions, frames, lobe, start[:-1], counts, index, weight, True)
    return start, index, weight
