"""Each kernel's Numba body beside its plain reference and beside what the machine can do.

Work is what the formula asks for, once, whatever the loops do. Additions, multiplications, divisions, minima
and maxima count as one operation each, so a fused multiply-add as two. A pair of the stacking needs
(`kernels.stacking.lobe_frames`)

    t.w + t.v, b.w + b.v, n.w      6, 6 and 5 operations
    k, s                           4 and 1
    (k + s^2) / (k + a2 s^2)       5
    the lobe                       3: the square, max(n.w, 0), their product
    the sums                       8 forward, 6 backward, 2 for the weight alone, a multiply-add for each sum

No pair is culled: those below a pixel's horizon cost as much as the others. Kernels that wait for memory are
held against the rate of copying instead, with the bytes that their loops name: the rows that a gather looks
up every time, although tables that fit into a cache come from there. So that share may exceed 1.
"""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
import scipy.sparse
import torch

from benchmarks.speed import cases
from benchmarks.speed.ball import CPU
from benchmarks.speed.timing import Limits, seconds
from lightprobe.kernels import sparse_product
from lightprobe.light import prefilter

LOBE = 6 + 6 + 5 + 4 + 1 + 5 + 3  # operations of a pair before it is summed
TABLE = ("kernel", "Numba, ms", "reference, ms", "ratio", "work", "rate", "share of the limit")


@dataclass(frozen=True)
class Kernel:
    """A kernel with its inputs, and how much work that is."""

    name: str
    module: str  # of `kernels.numba` and `kernels.reference`
    call: Callable[[Any], object]  # takes the module
    work: float
    flops: bool = True  # work is counted in operations, else in bytes


@dataclass(frozen=True)
class Timing:
    """The median seconds of a kernel's two bodies."""

    kernel: Kernel
    fast: float
    plain: float


def stacking_kernels(pixels: int, device: torch.device = CPU) -> list[Kernel]:
    """Return forward, backward and the weight alone, on 6 x 64 x 64 directions."""
    colors, *lobes = (tensor.to(device) for tensor in cases.probes(pixels))
    grad, pairs = torch.rand(len(lobes[-1]), 3).to(device), pixels * len(lobes[-1])
    size = f"{pairs / 1e6:.1f} M pairs"
    black = torch.zeros_like(colors)
    return [
        Kernel(f"stacking, {size}", "stacking", lambda b: b.stack(colors, *lobes), pairs * (LOBE + 8.0)),
        Kernel(
            "stacking backward", "stacking", lambda b: b.stack_backward(grad, *lobes), pairs * (LOBE + 6.0)
        ),
        Kernel("probe_weight", "stacking", lambda b: b.stack(black, *lobes)[1], pairs * (LOBE + 2.0)),
    ]


def raster_kernels(device: torch.device = CPU) -> list[Kernel]:
    """Return the rasteriser: reading faces and their corners, writing pixels."""
    screen, faces = (tensor.to(device) for tensor in cases.bumpy_sphere())
    name = f"rasterise, {len(faces) / 1000:.0f} k faces, 512 x 512"
    moved = len(faces) * (12 + 3 * 12) + 512 * 512 * 8.0
    return [Kernel(name, "rasterize", lambda b: b.rasterize(screen, faces, 512, 512), moved, flops=False)]


def grid_kernels(points: int, device: torch.device = CPU) -> list[Kernel]:
    """Return the hash grid's passes: rows of 8 bytes looked up, or read and written again."""
    at, table, resolutions = (tensor.to(device) for tensor in cases.grid(points))
    cells, features = resolutions.tolist(), table.shape[0] * table.shape[2]
    grad, looked_up = torch.rand(points, features).to(device), points * table.shape[0] * 8 * 8.0
    outside = points * (12 + 4.0 * features)
    back = 2 * looked_up + outside + 4 * table.numel()
    to_points = looked_up + outside + points * 12.0
    size = f"{points / 1000:.0f} k x 8 x 2"
    return [
        Kernel(
            f"hash grid, {size}",
            "hash_grid",
            lambda b: b.encode(at, table, cells),
            looked_up + outside,
            False,
        ),
        Kernel(
            "hash grid backward",
            "hash_grid",
            lambda b: b.encode_backward(grad, at, cells, table.shape),
            back,
            False,
        ),
        Kernel(
            "hash grid backward, to points",
            "hash_grid",
            lambda b: b.encode_backward_to_points(grad, at, table, cells),
            to_points,
            False,
        ),
    ]


def gather_kernels(queries: int, device: torch.device = CPU) -> list[Kernel]:
    """Return the weighted gather and its two gradients: rows of 12 bytes, index and weight of 4."""
    values, index, weight = (tensor.to(device) for tensor in cases.taps(queries))
    grad = torch.rand(queries, 3).to(device)

    def backward(body: ModuleType) -> object:
        return body.scatter_weighted(grad, index, weight, len(values)), body.row_products(grad, index, values)

    forward, back = index.numel() * 20.0 + 12 * queries, index.numel() * (32.0 + 20.0) + 24 * queries
    name = f"weighted gather, {queries / 1000:.0f} k x 8 x 3"
    return [
        Kernel(name, "gather", lambda b: b.weighted_gather(values, index, weight), forward, False),
        Kernel("weighted gather backward", "gather", backward, back, False),
    ]


def occlusion_kernels(pixels: int, device: torch.device = CPU) -> list[Kernel]:
    """Return the occluded light, its gradient and its weights: per pixel and direction 5 operations for v and 6 for
    the cosine.

    Then come 18 for the sums of `occluded_light`, 4 for its denominators and 13 for what each direction is given, or 4 and
    4 for the weights.
    """
    case = tuple(tensor.to(device) for tensor in cases.shadowed(pixels))
    pairs, grad = pixels * len(case[0]), torch.rand(pixels, 7).to(device)
    name, forward, back = f"occluded light, {pixels / 1000:.0f} k x 384", 5 + 6 + 18.0, 5 + 6 + 4 + 13.0
    out, written = grad.new_empty(2, pixels, len(case[0])), 5 + 6 + 4 + 4.0
    return [
        Kernel(name, "occlusion", lambda b: b.occluded_light(*case), pairs * forward),
        Kernel(f"{name}, adjoint", "occlusion", lambda b: b.light_gradient(grad, *case[1:]), pairs * back),
        Kernel(f"{name}, weights", "occlusion", lambda b: b.weights(out, *case[1:]), pairs * written),
    ]


def all_kernels(*, quick: bool, device: torch.device = CPU) -> list[Kernel]:
    """Return all kernels that have a reference body, on the same inputs everywhere; `quick`: an eighth."""
    part = 8 if quick else 1
    return [
        *raster_kernels(device),
        *grid_kernels(65_536 // part, device),
        *stacking_kernels(1024 // part, device),
        *occlusion_kernels(12_288 // part, device),
        *gather_kernels(65_536 // part, device),
    ]


def time_kernel(kernel: Kernel, repeats: int) -> Timing:
    """Return the times of both bodies; the reference is called once, after a warm-up only when it is fast."""
    fast, plain = (
        importlib.import_module(f"lightprobe.kernels.{body}.{kernel.module}")
        for body in ("numba", "reference")
    )
    once = seconds(lambda: kernel.call(plain), 1, warm_up=False)
    if once < 0.3:
        once = seconds(lambda: kernel.call(plain), repeats, warm_up=False)
    return Timing(kernel, seconds(lambda: kernel.call(fast), max(repeats, 3)), once)


def time_prefilter(resolution: int, repeats: int) -> Timing:
    """Return the times of the prefilter's product with its lobes, the reference being SciPy's product."""
    matrix = prefilter.cached(resolution, CPU).lobes.forward
    x = torch.rand(matrix.columns, 3)
    parts = (matrix.value.numpy(), matrix.column.numpy().astype(np.int32), matrix.start.numpy())
    plain = scipy.sparse.csr_array(parts, shape=(len(matrix.start) - 1, matrix.columns))
    entries = len(matrix.value)
    moved = entries * (4.0 + matrix.column.element_size()) + 4 * len(matrix.start) + 12 * sum(plain.shape)
    name = f"prefilter product, 6 x {resolution}², {entries / 1e6:.1f} M entries"
    kernel = Kernel(name, "", lambda _: None, moved, flops=False)
    slow = seconds(lambda: plain @ x.numpy(), repeats)
    return Timing(kernel, seconds(lambda: sparse_product(matrix, x), max(repeats, 3)), slow)


def kernel_rows(timings: list[Timing], limits: Limits) -> list[str]:
    """Return the table of kernels."""
    rows = [f"| {' | '.join(TABLE)} |", "| --- | ---: | ---: | ---: | ---: | ---: | ---: |"]
    for timing in timings:
        kernel, rate = timing.kernel, timing.kernel.work / timing.fast
        unit, limit = ("GFLOP", limits.arithmetic) if kernel.flops else ("GB", limits.copy)
        times = f"{1000 * timing.fast:.1f} | {1000 * timing.plain:.0f} | {timing.plain / timing.fast:.1f}"
        work = f"{kernel.work / 1e9:.3f} {unit} | {rate / 1e9:.1f} {unit}/s | {100 * rate / limit:.0f} %"
        rows.append(f"| {kernel.name} | {times} | {work} |")
    return rows
