"""Compile every Triton kernel for a GPU that need not be there: `python -m tests.kernels.triton_compilation cuda 90`.

The interpreter runs kernels without looking at types, and would let pass what a compiler refuses. So here
kernels are called as usual while launches stop after compilation. Prints the names of the kernels compiled.
"""

import importlib
import sys

import torch
from triton.backends.compiler import GPUTarget
from triton.runtime import driver
from triton.runtime.jit import JITFunction

from lightprobe.kernels.reference import occlusion as reference_occlusion
from lightprobe.kernels.sparse import CompressedRows
from tests.kernels import test_gather, test_hash_grid, test_occlusion, test_rasterize, test_stacking


class AbsentGpu:
    """As much of a driver as compilation asks for."""

    def __init__(self, kind: str, architecture: str):
        self.target = GPUTarget(kind, *((int(architecture), 32) if kind == "cuda" else (architecture, 64)))

    def get_current_target(self):
        return self.target

    def get_current_device(self):
        return 0

    def get_current_stream(self, device):
        return 0


def call(op, function, *arguments):
    return getattr(importlib.import_module(f"lightprobe.kernels.triton.{op}"), function)(*arguments)


def call_all():
    """Call every kernel, with sizes of 1 too: Triton compiles those separately."""
    for channels, taps, dtype in ((3, 4, torch.int32), (80, 3, torch.int64), (1, 1, torch.int32)):
        values, index, weight, grad = test_gather.problem(k=taps, channels=channels, index_dtype=dtype)
        call("gather", "weighted_gather", values, index, weight)
        call("gather", "scatter_weighted", grad, index, weight, 60)
        call("gather", "row_products", grad, index, values)
        call("gather", "scatter_rows", grad, index[:, 0], 60)
    for features in (1, 2):
        points, table, _ = test_hash_grid.problem(features=features)
        call("hash_grid", "encode", points, table, test_hash_grid.CELLS)
        grad = torch.ones(len(points), len(test_hash_grid.CELLS) * features)
        call("hash_grid", "encode_backward", grad, points, test_hash_grid.CELLS, table.shape)
        call("hash_grid", "encode_backward_to_points", grad, points, table, test_hash_grid.CELLS)
    for pixels, texels in ((100, 300), (1, 1)):
        case = test_stacking.problem(pixels, texels)
        call("stacking", "stack", *case)
        call("stacking", "stack_backward", torch.ones(texels, 3), *case[1:])
    case, grad = test_occlusion.problem(9), torch.ones(9, 7)
    call("occlusion", "occluded_light", *case)
    call("occlusion", "light_gradient", grad, *case[1:])
    call("occlusion", "normal_gradient", grad, reference_occlusion.occluded_light(*case), *case)
    for columns in (1, 500):
        entries = torch.zeros(columns, dtype=torch.int32)
        matrix = CompressedRows(torch.tensor([0, columns]).int(), entries, entries.float(), columns)
        call("sparse", "product", matrix, torch.ones(columns, 3), None)
    screen, faces = test_rasterize.soup(40, 64, 64)
    call("rasterize", "rasterize", screen, faces, 64, 64)
    call("rasterize", "rasterize", screen, faces[:1].long(), 64, 1)


def main():
    compiled = set()
    run = JITFunction.run

    def compile_only(kernel, *arguments, grid, warmup, **options):
        compiled.add(kernel.fn.__name__)
        return run(kernel, *arguments, grid=grid, warmup=True, **options)

    JITFunction.run = compile_only
    driver.set_active(AbsentGpu(*sys.argv[1:]))
    call_all()
    print(*sorted(compiled))


if __name__ == "__main__":
    main()
