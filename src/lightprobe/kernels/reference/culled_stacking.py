"""Plain body of the culled stacking: the exact sums at the tree's texels, which the culled ones approach."""

import torch
from torch import Tensor

from lightprobe.kernels.culled_stacking import NODES, TileTree
from lightprobe.kernels.reference import stacking


def stack(
    colors: Tensor, normals: Tensor, views: Tensor, alpha2: Tensor, tree: TileTree
) -> tuple[Tensor, Tensor]:
    """Return radiance (M, 3) and weight (M,)."""
    texel = torch.from_numpy(tree.texels).to(colors.device).reshape(-1)
    places = torch.from_numpy(tree.tiles[:, -tree.texels.shape[1] :, : 3 * NODES]).to(colors)
    points = places.unflatten(2, (3, NODES)).swapaxes(2, 3).reshape(-1, 3)
    directions = torch.empty_like(points).index_copy(0, texel, points)
    total, weight = stacking.stack(colors, normals, views, alpha2, directions)
    return torch.where(weight[:, None] == 0, 0, total / weight[:, None]), weight
