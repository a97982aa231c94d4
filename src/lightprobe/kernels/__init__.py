"""The few hot loops. Tensors in, tensors out; each op has a plain reference and a fast body under one signature."""

from lightprobe.core import first_calls  # noqa: F401  (its import is its work)
from lightprobe.kernels.gather import gather_rows, scatter_rows, weighted_gather, weighted_scatter
from lightprobe.kernels.hash_grid import hash_encode
from lightprobe.kernels.occlusion import occluded_light, occluded_light_adjoint
from lightprobe.kernels.rasterize import Visibility, rasterize
from lightprobe.kernels.stacking import probe_weight, stack_probes

__all__ = [
    "Visibility",
    "gather_rows",
    "hash_encode",
    "occluded_light",
    "occluded_light_adjoint",
    "probe_weight",
    "rasterize",
    "scatter_rows",
    "stack_probes",
    "weighted_gather",
    "weighted_scatter",
]
