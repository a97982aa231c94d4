"""AVIF files whose boxes say what their colours are."""

import numpy as np
import pytest
from PIL import Image

from lightprobe.imaging import foreign_encoding, read_ldr
from lightprobe.imaging.avif import avif_encoding
from lightprobe.imaging.encodings import SRGB, coded

SRGB_POINTS, HLG_POINTS = b"nclx\0\x01\0\x0d", b"nclx\0\x09\0\x12"


@pytest.fixture
def path(tmp_path):
    Image.fromarray(np.full((16, 16, 3), 180, np.uint8)).save(tmp_path / "a.avif", quality=100)
    return tmp_path / "a.avif"


def test_code_points_are_followed(path):
    assert avif_encoding(path) is SRGB
    plain = read_ldr(path)[0]
    data = path.read_bytes()
    assert SRGB_POINTS in data
    path.write_bytes(data.replace(SRGB_POINTS, HLG_POINTS))
    assert foreign_encoding(path) == coded(9, 18).name != SRGB.name
    curve = coded(9, 18).curves[0]
    np.testing.assert_allclose(read_ldr(path)[0].mean(), float(curve(180 / 255)), rtol=0.03)
    assert abs(read_ldr(path)[0].mean() - plain.mean()) > 0.05


@pytest.mark.parametrize("box", [b"meta", b"iprp", b"ipco", b"colr", b"nclx"])
@pytest.mark.parametrize("size", [b"\0\0\0\0", b"\0\0\0\x01", b"\0\0\0\x03", b"\xff\xff\xff\xff"])
def test_boxes_of_sizes_that_cannot_be_end_the_search(path, box, size):
    data = path.read_bytes().replace(SRGB_POINTS, HLG_POINTS)
    at = data.find(box)
    path.write_bytes(data[: at - 4] + size + data[at:])
    to_the_end = size in (b"\0\0\0\0", b"\xff\xff\xff\xff") and box != b"nclx"
    assert avif_encoding(path) == (coded(9, 18) if to_the_end else SRGB)
    path.write_bytes(data[: at + 2])
    assert avif_encoding(path) is SRGB


def test_a_box_may_tell_its_size_in_64_bits(path):
    data = bytearray(path.read_bytes().replace(SRGB_POINTS, HLG_POINTS))
    at, size = data.find(b"colr"), {box: data.find(box) - 4 for box in (b"meta", b"iprp", b"ipco", b"colr")}
    for place in size.values():
        data[place : place + 4] = (int.from_bytes(data[place : place + 4], "big") + 8).to_bytes(4, "big")
    data[at + 4 : at + 4] = data[at - 4 : at].rjust(8, b"\0")
    data[at - 4 : at] = b"\0\0\0\x01"
    path.write_bytes(data)
    assert avif_encoding(path) == coded(9, 18)
