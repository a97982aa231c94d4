"""Exposure, focal length and gravity out of EXIF, whatever stands there."""

import struct

import numpy as np
import pillow_heif
import pytest
from PIL import Image

from lightprobe.imaging import focal_ratio, gravity, read_exif_ev100
from lightprobe.imaging.exif import read_orientation
from tests.imaging.apple_notes import apple_note
from tests.imaging.raw_files import write_dng

_FOLDER, _TIME, _F_NUMBER, _ISO = 0x8769, 0x829A, 0x829D, 0x8827
_RATIONAL, _SHORT, _DOUBLE = 5, 3, 12


def photo(path, entries):
    """Write a photo with the entries (tag, type, bytes) in its EXIF folder, little-endian as they are."""
    offset = 8 + 2 + 12 + 4
    folder = len(entries).to_bytes(2, "little")
    data, behind = b"", offset + 2 + 12 * len(entries) + 4
    for tag, kind, value in entries:
        count = len(value) // {_RATIONAL: 8, _SHORT: 2, _DOUBLE: 8}[kind]
        head = tag.to_bytes(2, "little") + kind.to_bytes(2, "little") + count.to_bytes(4, "little")
        if len(value) <= 4:
            folder += head + value.ljust(4, b"\0")
        else:
            folder += head + (behind + len(data)).to_bytes(4, "little")
            data += value
    root = struct.pack("<HHHIII", 1, _FOLDER, 4, 1, offset, 0)
    exif = b"Exif\0\0II*\0\x08\0\0\0" + root + folder + bytes(4) + data
    Image.new("RGB", (8, 6)).save(path, exif=exif)
    return path


def rational(above, below):
    return above.to_bytes(4, "little") + below.to_bytes(4, "little")


def double(value):
    return np.float64(value).tobytes()


def test_a_usual_exposure(tmp_path):
    entries = [
        (_TIME, _RATIONAL, rational(1, 100)),
        (_F_NUMBER, _RATIONAL, rational(4, 1)),
        (_ISO, _SHORT, b"\xc8\0"),
    ]
    assert read_exif_ev100(photo(tmp_path / "a.jpg", entries)) == pytest.approx(np.log2(1600) - 1)


@pytest.mark.parametrize("tag", [_TIME, _F_NUMBER, _ISO])
@pytest.mark.parametrize("value", [0.0, -1.0, 5e-324, 1e-200, 1e200, 1.7e308, np.inf, -np.inf, np.nan])
def test_extreme_numbers_are_no_exposure(tmp_path, tag, value):
    entries = [(other, _DOUBLE, double(value if other == tag else 4.0)) for other in (_TIME, _F_NUMBER, _ISO)]
    assert read_exif_ev100(photo(tmp_path / "a.jpg", entries)) is None


@pytest.mark.parametrize("value", [rational(0, 0), rational(1, 0), rational(0, 1), b""])
def test_rationals_that_are_no_numbers(tmp_path, value):
    entries = [(_TIME, _RATIONAL, value), (_F_NUMBER, _DOUBLE, double(4.0)), (_ISO, _DOUBLE, double(100.0))]
    assert read_exif_ev100(photo(tmp_path / "a.jpg", entries)) is None


@pytest.mark.filterwarnings("ignore::UserWarning")  # Pillow's, which nobody sees twice
def test_broken_exif_is_none(tmp_path):
    """A photo is no worse for what stands beside its pixels: any byte of it may be wrong."""
    entries = [
        (_TIME, _RATIONAL, rational(1, 100)),
        (_F_NUMBER, _RATIONAL, rational(4, 1)),
        (_ISO, _SHORT, b"\x64\0"),
    ]
    whole = photo(tmp_path / "a.jpg", entries).read_bytes()
    start = whole.index(b"Exif\0\0")
    end = start - 2 + int.from_bytes(whole[start - 2 : start])
    for position in range(start + 6, end):
        for value in (0, 7, 255):
            spoilt = bytearray(whole)
            spoilt[position] = value
            (tmp_path / "b.jpg").write_bytes(spoilt)
            found = read_exif_ev100(tmp_path / "b.jpg")
            assert found is None or abs(found) < 100
            assert read_orientation(tmp_path / "b.jpg") in (None, *range(1, 9))


def with_tags(path, tags, *, size=(8, 6), orientation=None):
    """Write a photo with tags in its EXIF folder, as Pillow encodes them."""
    exif = Image.Exif()
    exif.get_ifd(_FOLDER).update(tags)
    if orientation is not None:
        exif[0x0112] = orientation
    if path.suffix == ".heic":
        pillow_heif.from_pillow(Image.new("RGB", size)).save(path, exif=exif.tobytes())
    else:
        Image.new("RGB", size).save(path, exif=exif.tobytes())
    return path


_FOCAL, _FOCAL_35, _PITCH, _UNIT, _WIDE, _HIGH = 0x920A, 0xA405, 0xA20E, 0xA210, 0xA002, 0xA003


@pytest.mark.parametrize("suffix", ["jpg", "heic", "tif", "png"])
@pytest.mark.parametrize(
    ("size", "side"), [((36, 24), 36), ((24, 36), 36), ((40, 30), 34.613), ((64, 36), 37.711)]
)
def test_a_film_equivalent_is_of_the_diagonal(tmp_path, suffix, size, side):
    """26 mm on 43.27 mm of diagonal: of a 4:3 picture the longer side is as wide as 34.6 mm of film."""
    path = with_tags(tmp_path / f"a.{suffix}", {_FOCAL_35: 26}, size=size)
    assert focal_ratio(path) == pytest.approx(26 / side, rel=1e-4)


def test_focal_length_by_the_sensors_pitch(tmp_path):
    """A 50 mm lens on 22.3 mm of 6000 pixels; the equivalent of 80 mm is rounded, one of 50 is another
    lens's.
    """
    tags = {_FOCAL: 50.0, _PITCH: 6000 / 22.3 * 25.4, _UNIT: 2, _WIDE: 6000, _HIGH: 4000}
    exact = 50 / 22.3
    assert focal_ratio(with_tags(tmp_path / "a.jpg", tags)) == pytest.approx(exact, rel=1e-4)
    both = with_tags(tmp_path / "b.jpg", tags | {_FOCAL_35: 80}, size=(36, 24))
    assert focal_ratio(both) == pytest.approx(exact, rel=1e-4)
    contrary = with_tags(tmp_path / "c.jpg", tags | {_FOCAL_35: 50}, size=(36, 24))
    assert focal_ratio(contrary) == pytest.approx(50 / 36, rel=1e-4)
    centimetres = with_tags(tmp_path / "d.jpg", tags | {_UNIT: 3, _PITCH: 6000 / 2.23})
    assert focal_ratio(centimetres) == pytest.approx(exact, rel=1e-4)


def test_the_pitch_of_a_photo_that_was_scaled_down_is_none(tmp_path):
    """A photo of 5184 pixels and 22.3 mm, whose size was rewritten, is not taken with a lens four times as
    long.
    """
    tags = {_FOCAL: 50.0, _PITCH: 5184 / 22.3 * 25.4, _UNIT: 2}
    assert focal_ratio(with_tags(tmp_path / "a.jpg", tags | {_WIDE: 1200, _HIGH: 800})) is None
    assert focal_ratio(with_tags(tmp_path / "b.jpg", tags | {_WIDE: 2592, _HIGH: 1728})) is None
    whole = with_tags(tmp_path / "c.jpg", tags | {_WIDE: 5184, _HIGH: 3456})
    assert focal_ratio(whole) == pytest.approx(50 / 22.3, rel=1e-4)


@pytest.mark.parametrize(
    "tags",
    [{}, {_FOCAL_35: 0}, {_FOCAL: 50.0}, {_FOCAL_35: 60000}, {_FOCAL: 50.0, _PITCH: 0.0, _WIDE: 6, _HIGH: 4}],
)
def test_no_focal_length(tmp_path, tags):
    assert focal_ratio(with_tags(tmp_path / "a.jpg", tags)) is None


_NOTE, _LENS = 0x927C, 0xA434


@pytest.mark.parametrize("suffix", ["jpg", "heic"])
@pytest.mark.parametrize(
    ("orientation", "value"),
    [(6, (0, -1, 0)), (1, (-1, 0, 0)), (3, (1, 0, 0)), (8, (0, 1, 0)), (None, (-1, 0, 0))],
)
def test_up_is_up_however_the_phone_is_held(tmp_path, suffix, orientation, value):
    """Upright: the top of the device is up. On its left side: its right one is, the sensor's own way to lie."""
    path = with_tags(tmp_path / f"a.{suffix}", {_NOTE: apple_note({8: value})}, orientation=orientation)
    np.testing.assert_allclose(gravity(path), [0, 1, 0], atol=1e-6)


def test_up_of_a_camera_that_looks_down_and_of_one_that_is_tilted(tmp_path):
    """Looking straight down, up is behind the camera, +z; the screen faces up, into which z points: value -z."""
    down = with_tags(tmp_path / "a.jpg", {_NOTE: apple_note({8: (0, 0, -1.02)})}, orientation=6)
    np.testing.assert_allclose(gravity(down), [0, 0, 1], atol=1e-6)
    rolled = with_tags(tmp_path / "b.jpg", {_NOTE: apple_note({8: (-0.6, -0.8, 0)})}, orientation=6)
    np.testing.assert_allclose(gravity(rolled), [0.6, 0.8, 0], atol=1e-3)


@pytest.mark.parametrize(
    "tags",
    [
        {},
        {_NOTE: b"Nikon\0" + bytes(40)},
        {_NOTE: apple_note({8: (0, -3, 0)})},
        {_NOTE: apple_note({8: (0, -0.3, 0)})},
        {_NOTE: apple_note({8: (0, -1, 0)})[:40]},
        {_NOTE: apple_note({8: (0, -1, 0)}), _LENS: "iPhone 12 front camera 2.71mm f/2.2"},
    ],
)
def test_no_gravity(tmp_path, tags):
    assert gravity(with_tags(tmp_path / "a.jpg", tags, orientation=6)) is None


def test_a_mirrored_picture_has_no_gravity(tmp_path):
    assert gravity(with_tags(tmp_path / "a.jpg", {_NOTE: apple_note({8: (0, -1, 0)})}, orientation=5)) is None


def test_focal_length_of_camera_raw(tmp_path):
    """A raw file that is a TIFF inside has its EXIF there."""
    path = write_dng(tmp_path / "a.dng", np.full((24, 36, 3), 0.3), focal_35=26)
    assert focal_ratio(path) == pytest.approx(26 / 36, rel=1e-4)
