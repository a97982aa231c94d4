"""The hot loops: tensors in, tensors out; each op has a plain reference and fast backends of one signature."""

from lightprobe.core import first_calls  # noqa: F401  (its import is its work)
from lightprobe.kernels.culled_stacking import stack_probes_culled
from lightprobe.kernels.gather import gather_rows, scatter_rows, values_at, weighted_gather, weighted_scatter
from lightprobe.kernels.hash_grid import hash_encode
from lightprobe.kernels.lobe_rows import lobe_rows
from lightprobe.kernels.occlusion import occluded_light, occlusion_weights
from lightprobe.kernels.rasterize import Visibility, rasterize
from lightprobe.kernels.sparse import CompressedRows, permute_rows, sparse_product, sparse_product_transposed
from lightprobe.kernels.stacking import probe_weight, stack_probes
from lightprobe.kernels.voxels import cast_voxels, vote_on_voxels

__all__ = [
    "CompressedRows",
    "Visibility",
    "cast_voxels",
    "gather_rows",
    "hash_encode",
    "lobe_rows",
    "occluded_light",
    "occlusion_weights",
    "permute_rows",
    "probe_weight",
    "rasterize",
    "scatter_rows",
    "sparse_product",
    "sparse_product_transposed",
    "stack_probes",
    "stack_probes_culled",
    "values_at",
    "vote_on_voxels",
    "weighted_gather",
    "weighted_scatter",
]
