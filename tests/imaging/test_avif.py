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
    data = path.read_bytes()
    at = data.find(box)
    path.write_bytes(data[: at - 4] + size + data[at:])
    assert avif_encoding(path).name == SRGB.name
    path.write_bytes(data[: at + 2])
    assert avif_encoding(path) is SRGB
