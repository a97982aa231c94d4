import io
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.imaging import write_exr, write_radiance
from lightprobe.light import cubemap
from lightprobe.light.environment import Environment, load_environments, read_map


def test_a_folder_of_maps_is_read_in_the_order_of_names(tmp_path):
    write_exr(tmp_path / "b.exr", np.full((16, 32, 3), 2.0, np.float32))
    write_radiance(tmp_path / "a.hdr", np.full((16, 32, 3), 1.0, np.float32))
    (tmp_path / "README.md").write_text("not a map")
    first, second = (light.texels for light in load_environments(tmp_path, 16))
    torch.testing.assert_close(first, torch.ones(6, 16, 16, 3), rtol=0.01, atol=0)
    torch.testing.assert_close(second, torch.full((6, 16, 16, 3), 2.0), rtol=0.01, atol=0)


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


def test_a_map_becomes_the_cubemap_with_half_as_many_texels_on_an_edge_as_it_has_rows():
    for rows, side in {4: 8, 16: 8, 62: 16, 64: 32, 128: 64, 200: 64, 256: 128, 600: 128}.items():
        assert Environment.from_panorama(np.ones((rows, 2 * rows, 3), np.float32)).resolution == side


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


@pytest.mark.parametrize(
    ("shape", "size"), [((4, 9, 3), "9 x 4 with 3"), ((4, 7, 3), "7 x 4 with 3"), ((4, 8, 1), "8 x 4 with 1")]
)
def test_a_file_of_another_shape_is_named_with_its_size(
    tmp_path: Path, shape: tuple[int, int, int], size: str
) -> None:
    write_exr(tmp_path / "odd.exr", np.ones(shape, np.float32))
    words = rf"odd\.exr is {size} channels; an environment needs RGB and W = 2H\.$"
    with pytest.raises(InputError, match=words):
        read_map(tmp_path / "odd.exr")


@pytest.mark.parametrize("value", [-0.01, np.nan, np.inf])
def test_a_file_of_no_radiance_is_refused(tmp_path: Path, value: float) -> None:
    image = np.ones((4, 8, 3), np.float32)
    image[2, 5, 1] = value
    write_exr(tmp_path / "bad.exr", image)
    with pytest.raises(InputError, match=r"bad\.exr contains negative, infinite or NaN radiance; repair it"):
        Environment.load(tmp_path / "bad.exr")


def test_black_is_radiance_and_an_alpha_channel_is_left_out_whatever_it_holds(tmp_path: Path) -> None:
    image = np.arange(4 * 8 * 4, dtype=np.float32).reshape(4, 8, 4)
    image[..., 3] = -1
    image[1, 1, 3] = np.nan
    write_exr(tmp_path / "alpha.exr", image)
    read = read_map(tmp_path / "alpha.exr")
    assert read.dtype == np.float32
    assert np.array_equal(read, image[..., :3])


def test_a_resolution_and_a_height_may_be_asked_for(tmp_path: Path) -> None:
    light = Environment(1 + 0.5 * cubemap.directions(8))
    light.save(tmp_path / "light.exr", 64)
    assert read_map(tmp_path / "light.exr").shape == (64, 128, 3)
    assert Environment.load(tmp_path / "light.exr").resolution == 32
    assert Environment.load(str(tmp_path / "light.exr"), resolution=4).resolution == 4
    assert light.panorama().shape == (16, 32, 3)
    assert light.rotated(torch.eye(3)).resolution == 8
    assert light.rotated(torch.eye(3), 4).resolution == light.resized(4).resolution == 4
