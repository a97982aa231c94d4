"""A map as an Ultra HDR JPEG, as libultrahdr, which Android and browsers' readers come from, and Pillow read it."""

import io
import warnings
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import LightprobeWarning
from lightprobe.export.ultra_hdr import BRIGHTEST, encode_ultra_hdr, write_ultra_hdr
from lightprobe.light.environment import Environment
from tests.marked_light import COLORS, marked_cubemap

imagecodecs = pytest.importorskip("imagecodecs")
SPOT = (slice(10, 16), slice(40, 48))  # rows and columns
XMP, ISO = b"hdr-gain-map/1.0", b"urn:iso:std:iso:ts:21496"  # what readers know either description by


def marked_map(spot: float) -> np.ndarray:
    image = Environment(marked_cubemap(32)).panorama()
    image[SPOT] = spot * np.array([1.0, 0.75, 0.5], np.float32)
    return image


def decoded(data: bytes) -> np.ndarray:
    return imagecodecs.ultrahdr_decode(data, dtype="float16")[..., :3].astype(np.float32)


@pytest.mark.parametrize("hidden", [None, XMP, ISO], ids=["both", "ISO alone", "XMP alone"])
@pytest.mark.parametrize("spot", [3.0, 8.0])
def test_radiance_comes_back_where_it_was(spot, hidden):
    image, data = marked_map(spot), encode_ultra_hdr(marked_map(spot))
    if hidden is not None:
        assert hidden in data
        data = data.replace(hidden, hidden[::-1])
    found = decoded(data)
    assert found[SPOT].mean((0, 1)) == pytest.approx(spot * np.array([1, 0.75, 0.5]), rel=0.02)
    for (x, y, z), color in COLORS.items():
        row = {1: 3, 0: 32, -1: 60}[z]
        column = 20 if z else round((0.5 - np.arctan2(y, x) / (2 * np.pi)) * 128) % 128
        around = found[row - 2 : row + 3, np.arange(column - 2, column + 3) % 128]
        assert around.mean((0, 1)) == pytest.approx(color, rel=0.02), (x, y, z)
    error = np.abs(found / image - 1)
    assert np.mean(error < 0.02) > 0.95
    assert error.max() < 0.06


def test_any_program_shows_the_first_picture_and_finds_the_second():
    data = encode_ultra_hdr(marked_map(3.0))
    with Image.open(io.BytesIO(data)) as picture:
        assert (picture.format, picture.size, picture.mode) == ("JPEG", (128, 64), "RGB")
        shown = np.asarray(picture)
        (first, second) = picture._getmp()[0xB002]
        about = ElementTree.fromstring(picture.info["xmp"])
    assert shown[32, 64, 0] > shown[32, 64, 1] + 50  # +x is red
    item = "{http://ns.google.com/photos/1.0/container/item/}"
    kinds = {one.get(f"{item}Semantic"): one.get(f"{item}Length") for one in about.iter()}
    assert kinds["GainMap"] == str(second["Size"])
    assert first["Size"] + second["Size"] == len(data)
    with Image.open(io.BytesIO(data[first["Size"] :])) as gain:
        assert gain.size == (128, 64)


def test_what_the_file_cannot_hold_is_cut_and_told(tmp_path):
    image = marked_map(320.0)
    with pytest.warns(
        LightprobeWarning, match=r"holds radiance up to 8 and the map has up to 320: .* light\.exr"
    ):
        write_ultra_hdr(tmp_path / "light.jpg", image)
    found = decoded((tmp_path / "light.jpg").read_bytes())
    assert found[SPOT].mean() == pytest.approx(BRIGHTEST, rel=0.02)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_ultra_hdr(tmp_path / "light.jpg", marked_map(8.0))


@pytest.mark.parametrize("level", [0.0, 1e-4, 8.0])
def test_maps_of_one_radiance_come_back(level):
    found = decoded(encode_ultra_hdr(np.full((8, 16, 3), level, np.float32)))
    assert found == pytest.approx(level, rel=0.02, abs=1e-3)
