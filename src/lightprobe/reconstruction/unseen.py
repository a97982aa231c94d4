"""What no photo sees of the space in an object is filled, before its surface becomes a mesh.

Inside the solid no photo holds the distances, and the first pass leaves caves there. Closed ones are dropped
with their surface (`geometry.mesh.clean`); those with a way out, through what photos do not see either, would
take triangles and texels from what they do see: more than half of both where an opening of the object is
closed in its masks.

Notation: L vertices of the lattice.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from lightprobe.core.config import SdfMode
from lightprobe.reconstruction.lattice_model import LatticeModel
from lightprobe.render.surface import View, visible_surface

_BESIDE = 1.0  # lattice cells behind the visible surface that count as seen: pixels are coarser than edges
_MARGIN = 2  # edges of the lattice around what is seen that stay as they are


@torch.no_grad()
def fill_unseen(model: LatticeModel, views: Sequence[View]) -> None:
    """Make solid what the model's surface hides from all of the views.

    What lies out of the picture in all of them, and what a network of distances says, stays as it is.
    """
    if model.config.sdf is SdfMode.MLP:
        return
    distance, edges = model.distances(), model.lattice.edges
    outside = distance >= 0
    kept = outside & ~_hidden(model, views)
    open_edges = edges[outside[edges].all(1)]
    for _ in range(_MARGIN):
        kept[open_edges[kept[open_edges].any(1)].reshape(-1)] = True
    filled = outside & ~kept
    if bool(filled.any()):
        model.reshape(torch.where(filled, distance.new_tensor(-model.lattice.cell), distance))


def _hidden(model: LatticeModel, views: Sequence[View]) -> Tensor:
    """Return which vertices of the lattice (L,) bool lie behind the model's surface in all views that frame
    them.
    """
    vertices, faces = model.present()
    points = model.positions()
    shown, framed = torch.zeros((2, len(points)), dtype=torch.bool, device=points.device)
    for view in views:
        surface = visible_surface(vertices, faces, view)
        nearest = points.new_full((view.height * view.width,), torch.inf)
        nearest[surface.pixel] = view.project(surface.position)[:, 2]
        x, y, depth = view.project(points).unbind(1)
        inside = (depth > 0) & (x >= 0) & (y >= 0) & (x < view.width) & (y < view.height)
        pixel = (y[inside].long() * view.width + x[inside].long()).clamp(max=len(nearest) - 1)
        framed |= inside
        shown[inside] |= depth[inside] < nearest[pixel] + _BESIDE * model.lattice.cell
    return framed & ~shown
