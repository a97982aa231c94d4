"""Textures: look-ups between texels and their gradients, other sizes, and one flat tensor and back."""

import pytest
import torch

from lightprobe.geometry.textures import Textures, bilinear_taps, sample
from tests.lit_sphere import glossy_sphere


@pytest.mark.parametrize("size", [64, 256])
def test_resized_textures_show_the_same(size):
    maps = glossy_sphere().textures
    resized = maps.resized(size)
    assert resized.base_color.shape == (size, size, 3)
    back = resized.resized(maps.size)
    assert (back.base_color - maps.base_color).abs().mean() < 0.01
    assert torch.allclose(resized.normal.norm(dim=-1), torch.ones(size, size))
    assert isinstance(resized, Textures)


def linear(size, dtype=torch.float32):
    """Return a texture (S * S, 2) whose channels are u and v."""
    centres = (torch.arange(size, dtype=dtype) + 0.5) / size
    v, u = torch.meshgrid(centres, centres, indexing="ij")
    return torch.stack([u, v], -1).reshape(-1, 2)


def test_a_texture_of_coordinates_gives_them_back():
    """u runs along columns and v down rows; beyond the outermost centres the border's value holds."""
    uv = torch.rand(200, 2, generator=torch.Generator().manual_seed(0))
    expected = uv.clamp(0.5 / 8, 1 - 0.5 / 8)
    torch.testing.assert_close(sample(linear(8), uv), expected)


def test_at_a_centre_there_is_one_texel():
    uv = torch.tensor([[(2 + 0.5) / 5, (3 + 0.5) / 5]])
    index, weight = bilinear_taps(uv, 5)
    assert float(weight.sum()) == pytest.approx(1)
    assert int(index[0, weight[0].argmax()]) == 3 * 5 + 2
    assert float(weight.max()) == pytest.approx(1, abs=1e-5)


def test_gradients_in_texels_and_in_uv():
    random = torch.Generator().manual_seed(1)
    texels = torch.rand(36, 3, generator=random, dtype=torch.float64).requires_grad_()
    uv = (0.1 + 0.8 * torch.rand(20, 2, generator=random, dtype=torch.float64)).requires_grad_()
    assert torch.autograd.gradcheck(sample, (texels, uv))


def test_flat_and_back():
    maps = glossy_sphere().textures
    again = Textures.from_flat(maps.flat())
    for name, value in vars(maps).items():
        assert torch.equal(getattr(again, name), value), name


def test_bent_normals_are_unit_again_and_nothing_else_changes():
    flat = glossy_sphere().textures.flat().clone()
    flat[:, 5:] *= 0.5 + torch.rand(len(flat), 1, generator=torch.Generator().manual_seed(2))
    maps = Textures.of_bent(flat)
    torch.testing.assert_close(maps.normal.norm(dim=-1), torch.ones(maps.size, maps.size))
    assert torch.equal(maps.flat()[:, :5], flat[:, :5])


def test_halfway_lies_between():
    maps = glossy_sphere().textures
    other = Textures.from_flat(1 - maps.flat())
    between = maps.halfway(other)
    torch.testing.assert_close(between.base_color, torch.full_like(maps.base_color, 0.5))
    assert torch.equal(maps.halfway(maps).roughness, maps.roughness)
