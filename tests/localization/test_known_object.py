"""The object prepared for many renders renders as the asset does."""

import torch

from lightprobe.render.asset import rasterize_asset
from lightprobe.render.coarse_transport import CoarseTransport
from lightprobe.render.surface import View, visible_surface
from tests.painted_object import CPU


def test_its_transport_is_the_coarse_transport_with_broader_texels(known, camera):
    view = View.of(camera, CPU)
    surface = visible_surface(known.mesh.vertices, known.mesh.faces, view)
    mine = known.transport(surface, view)
    whole = CoarseTransport.of(rasterize_asset(known.asset, camera, CPU)).matrix
    assert torch.allclose(mine, whole.unflatten(2, (6, 4, 2, 4, 2)).sum((4, 6)).flatten(2), atol=1e-6)
