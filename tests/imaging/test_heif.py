"""HEIF: Apple's gain maps, pictures turned by the format, and files of several pictures."""

import warnings

import numpy as np
import pillow_heif
import pytest
from PIL import Image

from lightprobe.core.errors import LightprobeWarning
from lightprobe.imaging import image_size, read_ldr, read_photo, srgb_decode
from tests.imaging.apple_notes import apple_note
from tests.imaging.heif_files import box, write_heif


def pair():
    """A picture (128, 192, 3) whose upper half is white, and a map of half its size with dark right columns."""
    picture, second = np.full((128, 192, 3), 255, np.uint8), np.full((64, 96), 255, np.uint8)
    picture[64:], second[:, 48:] = 128, 128
    return picture, second


def note(entries):
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0x927C] = apple_note(entries)
    return exif.tobytes()


@pytest.mark.parametrize(
    ("headroom", "gain", "stops"),
    [(0.8, 0.005, 1.7), (0.8, 0.5, 1.5505), (1.0, 0.005, 2.65), (1.2, 0.5, 2.1515), (1.2, 8.0, 0.0)],
)
def test_apples_gain_map(tmp_path, headroom, gain, stops):
    """Stops by the table in Apple's "Applying Apple HDR effect to your photos"."""
    picture, second = pair()
    exif = note({33: [headroom], 48: [gain]})
    path = write_heif(tmp_path / "a.heic", picture, auxiliary=second, exif=exif)
    color, _, clipped = read_photo(path)
    light = np.array([1.0, ((128 / 255 + 0.099) / 1.099) ** (1 / 0.45)])
    base = srgb_decode(np.array([[255] * 3, [128] * 3]) / 255)
    expected = base[:, None] * (1 + (2**stops - 1) * light)[None, :, None]
    np.testing.assert_allclose(color[[[8], [120]], [8, 184]], expected, rtol=0.02)
    assert clipped[8, 8].all()
    assert not clipped[8, 184].any()
    assert not clipped[72:].any()


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"exif": None}, "the camera's note, which says how bright it is, is missing"),
        ({"exif": note({33: [1.0]})}, "the camera's note, which says how bright it is, is missing"),
        ({"exif": note({33: [0.5], 48: [-9.0]})}, "the camera.s note has a headroom that no picture has"),
        ({"exif": None, "auxiliary": None, "brands": b"mif1heictmap"}, "by ISO 21496-1 in HEIF"),
    ],
)
def test_a_map_that_cannot_be_read_is_one_sentence(tmp_path, options, reason):
    picture, second = pair()
    path = write_heif(tmp_path / "a.heic", picture, **{"auxiliary": second, **options})
    with pytest.warns(LightprobeWarning, match=rf"a\.heic has a gain map that is not read \({reason}"):
        color, _, clipped = read_photo(path)
    assert color.max() == 1
    assert clipped[:60].all()
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # said once for each photo
        read_ldr(path)


def test_a_map_larger_than_its_picture(tmp_path):
    picture, second = pair()
    large = second.repeat(4, 0).repeat(4, 1)
    exif = note({33: [1.0], 48: [0.005]})
    path = write_heif(tmp_path / "a.heic", picture, auxiliary=large, exif=exif)
    with pytest.warns(LightprobeWarning, match="it is larger than its picture"):
        assert read_ldr(path)[0].max() == 1


def test_an_auxiliary_picture_of_another_kind_is_left_aside(tmp_path):
    picture, second = pair()
    kind = "urn:com:apple:photo:2018:aux:portraiteffectsmatte"
    path = write_heif(tmp_path / "a.heic", picture, auxiliary=second, kind=kind)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_ldr(path)[0].max() == 1


@pytest.mark.parametrize(
    ("turns", "size", "place"),
    [
        ([], (192, 128), (8, 8)),
        ([box(b"irot", b"\1")], (128, 192), (184, 8)),  # a quarter against the clock
        ([box(b"irot", b"\2")], (192, 128), (120, 184)),
        ([box(b"irot", b"\3")], (128, 192), (8, 120)),
        ([box(b"imir", b"\1")], (192, 128), (8, 184)),  # about the vertical axis (ISO/IEC 23008-12:2022)
        ([box(b"irot", b"\3"), box(b"imir", b"\1")], (128, 192), (8, 8)),
    ],
)
def test_pictures_are_turned_by_the_format_itself(tmp_path, turns, size, place):
    picture = np.zeros((128, 192, 3), np.uint8)
    picture[:40, :40] = 255
    exif = Image.Exif()
    exif[0x0112] = 6  # says it once more, or something else: the format counts
    path = write_heif(tmp_path / "a.heic", picture, turns=turns, exif=exif.tobytes())
    color = read_ldr(path)[0]
    assert image_size(path) == color.shape[1::-1] == size
    assert color[place].min() > 0.95
    assert color.mean() == pytest.approx(40 * 40 / (128 * 192), rel=0.03)


def test_the_primary_picture_of_a_burst(tmp_path):
    burst = pillow_heif.from_pillow(Image.new("RGB", (64, 64), (200, 120, 60)))
    burst.add_from_pillow(Image.new("RGB", (64, 64)))
    for primary, expected in ((0, (200, 120, 60)), (1, (0, 0, 0))):
        burst.save(tmp_path / "a.heic", quality=100, chroma=444, primary_index=primary)
        np.testing.assert_allclose(
            read_ldr(tmp_path / "a.heic")[0][30, 30], srgb_decode(np.array(expected) / 255), atol=0.01
        )
