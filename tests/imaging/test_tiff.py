"""TIFF files of kinds that cameras do not write, and editing programs do."""

import numpy as np
import pytest
import tifffile

from lightprobe.core.errors import InputError
from lightprobe.imaging import foreign_encoding, read_ldr, srgb_decode
from tests.imaging.icc_profiles import P3_PRIMARIES, icc, own_srgb

RAMP = np.arange(4 * 6 * 3, dtype=np.uint16).reshape(4, 6, 3) * 800
LINEAR = srgb_decode(RAMP / 65535)


def read(path, values, **settings):
    tifffile.imwrite(path, values, **settings)
    return read_ldr(path)


def test_channels_one_after_the_other(tmp_path):
    planes = np.moveaxis(RAMP, 2, 0)
    color, alpha = read(tmp_path / "a.tif", planes, photometric="rgb", planarconfig="separate")[:2]
    assert alpha is None
    np.testing.assert_allclose(color, LINEAR, atol=1e-5)
    floats = (planes / 65535).astype(np.float32)
    color = read(tmp_path / "b.tif", floats, photometric="rgb", planarconfig="separate")[0]
    np.testing.assert_allclose(color, RAMP / 65535, atol=1e-6)


def test_white_as_zero(tmp_path):
    color = read(tmp_path / "a.tif", 65535 - RAMP[..., 0], photometric="miniswhite", compression="zlib")[0]
    np.testing.assert_allclose(color, LINEAR[..., :1].repeat(3, 2), atol=1e-5)


def test_grey_with_alpha_and_channels_that_nobody_asked_for(tmp_path):
    pair = np.stack([RAMP[..., 0], np.full((4, 6), 32768, np.uint16)], 2)
    side_by_side = {"planarconfig": "contig"}
    told = {"photometric": "minisblack", "extrasamples": ["unassalpha"], **side_by_side}
    color, alpha = read(tmp_path / "a.tif", pair, **told)[:2]
    np.testing.assert_allclose(color, LINEAR[..., :1].repeat(3, 2), atol=1e-5)
    np.testing.assert_allclose(alpha, 0.5, atol=1e-4)
    five = np.concatenate([RAMP, RAMP[..., :2]], 2)
    told = {"photometric": "rgb", "extrasamples": ["unspecified"] * 2, **side_by_side}
    color, alpha = read(tmp_path / "b.tif", five, **told)[:2]
    assert alpha is None
    np.testing.assert_allclose(color, LINEAR, atol=1e-5)


def test_inks_are_no_colours(tmp_path):
    inks = np.full((4, 4, 6), 9000, np.uint16)
    with pytest.raises(InputError, match=r"a\.tif"):
        read(tmp_path / "a.tif", inks, photometric="separated", planarconfig="separate")


def test_half_floats(tmp_path):
    color = read(tmp_path / "a.tif", (RAMP / 4000).astype(np.float16), photometric="rgb")[0]
    np.testing.assert_allclose(color, RAMP / 4000, rtol=1e-3)


def test_far_more_samples_than_a_picture_has_are_refused(tmp_path):
    many = np.zeros((4, 6, 40), np.uint16)
    with pytest.raises(InputError, match="40 samples per pixel"):
        read(tmp_path / "a.tif", many, photometric="rgb", planarconfig="contig")
    with pytest.raises(InputError, match="3 layers"):
        read(tmp_path / "b.tif", np.zeros((3, 32, 32, 3), np.uint16), photometric="rgb", volumetric=True)


def test_premultiplied_grey_of_eight_bits(tmp_path):
    pair = np.stack([np.full((4, 6), 50, np.uint8), np.full((4, 6), 100, np.uint8)], 2)
    told = {"photometric": "minisblack", "extrasamples": ["assocalpha"], "planarconfig": "contig"}
    color, alpha = read(tmp_path / "a.tif", pair, **told)[:2]
    np.testing.assert_allclose(color, srgb_decode(np.float32(50 / 100)), atol=4e-3)
    np.testing.assert_allclose(alpha, 100 / 255, atol=1e-6)


@pytest.mark.parametrize("dtype", [np.uint32, np.int16])
def test_other_whole_numbers_are_one_sentence(tmp_path, dtype):
    with pytest.raises(InputError, match=f"samples of type {np.dtype(dtype).name}"):
        read(tmp_path / "a.tif", RAMP.astype(dtype), photometric="rgb")


@pytest.mark.parametrize("compression", [None, "zlib", "lzw", "jpegxl"])
def test_tiles(tmp_path, compression):
    deep = np.random.default_rng(3).integers(0, 65536, (70, 50, 3), np.uint16)
    color = read(tmp_path / "a.tif", deep, photometric="rgb", tile=(32, 32), compression=compression)[0]
    np.testing.assert_allclose(color, srgb_decode(deep / 65535), atol=1e-5)


def test_floats_in_other_primaries(tmp_path):
    """Floats are linear; their profile tells of which primaries, as Photoshop's of 32 bits does."""
    light = np.full((4, 4, 3), (2.0, 0.5, 0.25), np.float32)
    profile = icc("Linear P3", P3_PRIMARIES, 1.0)
    color = read(tmp_path / "a.tif", light, photometric="rgb", iccprofile=profile)[0]
    to_srgb = np.array([[1.2249, -0.2247, 0], [-0.0420, 1.0419, 0], [-0.0197, -0.0786, 1.0979]])
    np.testing.assert_allclose(color[0, 0], to_srgb @ light[0, 0], atol=2e-3)
    assert foreign_encoding(tmp_path / "a.tif") == "ICC profile Linear P3"
    color = read(tmp_path / "b.tif", light, photometric="rgb", iccprofile=own_srgb())[0]
    np.testing.assert_allclose(color, light, atol=1e-6)
