import io
import math

import numpy as np
import pytest
import torch
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.imaging import write_exr, write_radiance
from lightprobe.light import cubemap
from lightprobe.light.environment import Environment, load_environments


def test_a_folder_of_maps_is_read_in_the_order_of_names(tmp_path):
    write_exr(tmp_path / "b.exr", np.full((16, 32, 3), 2.0, np.float32))
    write_radiance(tmp_path / "a.hdr", np.full((16, 32, 3), 1.0, np.float32))
    (tmp_path / "README.md").write_text("not a map")
    first, second = (light.texels for light in load_environments(tmp_path, 16))
    torch.testing.assert_close(first, torch.ones(6, 16, 16, 3), rtol=0.01, atol=0)
    torch.testing.assert_close(second, torch.full((6, 16, 16, 3), 2.0), rtol=0.01, atol=0)


def test_a_folder_without_maps_is_named(tmp_path):
    with pytest.raises(InputError, match=r"has no \.exr or \.hdr"):
        load_environments(tmp_path, 16)
    with pytest.raises(InputError, match="is not a folder"):
        load_environments(tmp_path / "nowhere", 16)


def test_the_constant_light_has_its_radiance_as_mean_and_is_the_same_from_all_sides():
    light = Environment(torch.tensor([1.0, 2.0, 3.0]).expand(6, 16, 16, 3).contiguous())
    assert torch.allclose(light.mean(), torch.tensor([1.0, 2.0, 3.0]), rtol=1e-5)
    assert float(light.solid_angles().sum()) == pytest.approx(4 * math.pi, rel=1e-5)
    turned = light.rotated(torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(0)))[0])
    assert torch.allclose(turned.texels, light.texels, rtol=1e-5)
    assert torch.allclose(light.scaled(2.0).mean(), 2 * light.mean())


def test_a_turned_lamp_stands_where_it_was_turned_to():
    towards, turn = cubemap.directions(16), torch.tensor([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    lamp = Environment((towards[..., :1] > 0.9).float().expand(6, 16, 16, 3).contiguous())  # around +x
    seen = lamp.rotated(turn.T)  # its radiance in direction d is the lamp's in turn.T d
    brightest = (towards * seen.texels[..., :1]).sum((0, 1, 2))
    assert torch.nn.functional.normalize(brightest, dim=0)[1] > 0.99


@pytest.mark.parametrize("suffix", [".exr", ".hdr"])
def test_what_is_saved_is_loaded(tmp_path, suffix):
    light = Environment(1 + 0.5 * cubemap.directions(16))
    light.save(tmp_path / f"light{suffix}")
    again = Environment.load(tmp_path / f"light{suffix}")
    assert again.resolution == 16
    assert torch.allclose(again.mean(), light.mean(), rtol=0.01)
    assert torch.allclose(again.texels, light.texels, rtol=0.02)


@pytest.mark.parametrize(
    ("rows", "resolution"), [(4, 8), (16, 8), (62, 16), (64, 32), (128, 64), (200, 64), (256, 128), (600, 128)]
)
def test_a_map_becomes_the_cubemap_with_half_as_many_texels_on_an_edge_as_it_has_rows(rows, resolution):
    assert Environment.from_panorama(np.ones((rows, 2 * rows, 3), np.float32)).resolution == resolution


@pytest.mark.parametrize("shape", [(6, 8, 4, 3), (5, 8, 8, 3), (6, 8, 8), (8, 8, 3)])
def test_what_is_no_cubemap_of_colours_is_refused(shape):
    with pytest.raises(ValueError, match=r"texels \(6, R, R, 3\)"):
        Environment(torch.zeros(shape))


def test_a_notebook_shows_the_map_at_a_middling_brightness():
    texels = torch.full((6, 16, 16, 3), 0.001)
    texels[4] = 1000.0  # a sky that bends, and is not cut
    picture = np.asarray(Image.open(io.BytesIO(Environment(texels)._repr_png_())))
    assert picture.shape == (32, 64, 3)
    assert picture[0].min() > 250
    assert 1 < picture[-1].mean() < 250


def test_a_black_map_is_shown_black():
    picture = np.asarray(Image.open(io.BytesIO(Environment(torch.zeros(6, 8, 8, 3))._repr_png_())))
    assert picture.max() == 0
