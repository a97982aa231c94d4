"""Colour encodings other than sRGB are named; sRGB under any name is not."""

import io
import struct

import numpy as np
import pytest
from PIL import Image

from lightprobe.imaging import foreign_encoding, read_ldr
from tests.imaging.icc_profiles import P3_PRIMARIES, SRGB_PRIMARIES, icc, own_srgb


@pytest.fixture
def image():
    return Image.fromarray(np.random.default_rng(1).integers(0, 256, (16, 16, 3), dtype=np.uint8))


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp"])
def test_another_profile_is_named_in_every_format(tmp_path, image, suffix):
    path = tmp_path / f"a.{suffix}"
    image.save(path, icc_profile=icc("Wide Thing", P3_PRIMARIES, 2.2))
    assert foreign_encoding(path) == "ICC profile Wide Thing"
    image.save(path, icc_profile=own_srgb())
    assert foreign_encoding(path) is None
    image.save(path)
    assert foreign_encoding(path) is None


@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_a_grey_picture_may_have_the_profile_of_its_colour_one(tmp_path, image, suffix):
    path = tmp_path / f"grey.{suffix}"
    image.convert("L").save(path, icc_profile=icc("Wide Thing", P3_PRIMARIES, 2.2))
    color = read_ldr(path)[0]
    assert color.shape == (*image.size[::-1], 3)
    levels = np.asarray(Image.open(path)) / 255
    np.testing.assert_allclose(color, np.repeat(levels[..., None] ** 2.2, 3, 2), atol=2e-3)


def test_the_colours_decide_not_the_name(tmp_path, image):
    image.save(tmp_path / "liar.png", icc_profile=icc("sRGB IEC61966-2.1", SRGB_PRIMARIES, 1.0))
    assert foreign_encoding(tmp_path / "liar.png") == "ICC profile sRGB IEC61966-2.1"
    renamed = own_srgb().replace("sRGB".encode("utf-16-be"), "some".encode("utf-16-be"))
    assert renamed != own_srgb()
    image.save(tmp_path / "modest.png", icc_profile=renamed)
    assert foreign_encoding(tmp_path / "modest.png") is None


def test_a_broken_profile_is_no_traceback(tmp_path, image):
    image.save(tmp_path / "a.png", icc_profile=b"nonsense" * 40)
    assert foreign_encoding(tmp_path / "a.png") == "ICC profile that cannot be read"


@pytest.mark.parametrize(
    ("gamma", "srgb", "expected"),
    [
        (45455, False, None),
        (100000, False, "PNG gamma 1"),
        (55556, False, "PNG gamma 0.5556"),
        (100000, True, None),
    ],
)
def test_png_gamma(tmp_path, image, gamma, srgb, expected):
    """The standard's own value means sRGB, and an sRGB chunk overrides any."""
    import zlib

    buffer = io.BytesIO()
    image.save(buffer, "PNG")
    data = buffer.getvalue()
    for kind, content in ((b"sRGB", b"\0"), (b"gAMA", struct.pack(">I", gamma)))[not srgb :]:
        chunk = (
            struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
        )
        data = data[:33] + chunk + data[33:]
    (tmp_path / "a.png").write_bytes(data)
    assert foreign_encoding(tmp_path / "a.png") == expected
