"""The object prepared for many renders renders as the asset does, and its silhouette is its coverage."""

import numpy as np
import torch

from lightprobe.render.asset import rasterize_asset
from lightprobe.render.coarse_transport import CoarseTransport
from lightprobe.render.surface import View, visible_surface
from tests.painted_object import CPU, view_from


def test_its_transport_is_the_coarse_transport_with_broader_texels(known, camera):
    view = View.of(camera, CPU)
    surface = visible_surface(known.mesh.vertices, known.mesh.faces, view)
    whole = CoarseTransport.of(rasterize_asset(known.asset, camera, CPU))
    assert torch.allclose(known.transport(surface, view), whole.broader(4), atol=1e-6)


def test_the_mask_is_the_object_s_coverage(known, camera, photo):
    mask = known.silhouette(camera)
    assert mask.shape == photo[1].shape
    assert mask.dtype == np.float32
    assert np.abs(mask - photo[1]).mean() < 0.003
    assert 0 < ((mask > 0) & (mask < 1)).sum() < 400  # its rim is soft


def test_the_share_within_the_photo(known):
    assert known.inside_share(view_from((2.6, 0, 1))) == 1
    assert 0.2 < known.inside_share(view_from((2.6, 0, 1), shift=1.0)) < 0.8
    assert known.inside_share(view_from((2.6, 0, 1), shift=4.0)) == 0
