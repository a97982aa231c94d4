"""Photos that a limit of memory leaves no room for: reduced and said so, or refused before they are decoded."""

import struct
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lightprobe.core import memory_limit
from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.imaging import PhotoFile, limits, worked_size, write_exr
from lightprobe.imaging.decoding import read_header

BESIDE = 128 * 2**20  # bytes that are kept free for strips


@pytest.fixture
def limited(monkeypatch):
    """Return a limit that leaves so many bytes, whatever this process holds."""
    monkeypatch.setattr(memory_limit, "_held", lambda: 0)
    return lambda left: memory_limit.memory_limit(BESIDE + int(left))


def smooth(width, height):
    """Return colours (height, width, 3) uint8 without detail that reducing would lose."""
    x, y = np.meshgrid(np.linspace(0, 1, width), np.linspace(0, 1, height))
    return (255 * np.dstack([x, y, (x + y) / 2])).astype(np.uint8)


def png_bomb(path, side, depth=8):
    """Write the header of a PNG and nothing else: decoding it would say that it is damaged."""
    header = b"IHDR" + struct.pack(">IIBBBBB", side, side, depth, 2, 0, 0, 0)
    data = b"IDAT" + zlib.compress(b"\0")
    chunks = [
        struct.pack(">I", len(c) - 4) + c + struct.pack(">I", zlib.crc32(c)) for c in (header, data, b"IEND")
    ]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunks))
    return path


def test_a_bomb_is_refused_by_its_header(tmp_path, limited):
    bomb = png_bomb(tmp_path / "bomb.png", 11000)
    sentence = r"bomb\.png has 11000 x 11000 pixels: 0\.62 GB of memory are expected, more than --max-memory 0\.50 GB; "
    with (
        limited(500e6 - BESIDE),
        pytest.raises(InputError, match=sentence + "scale it down, save it as a baseline"),
    ):
        PhotoFile(bomb)
    with pytest.raises(InputError, match="cannot be decoded"):
        PhotoFile(png_bomb(tmp_path / "small.png", 40))


@pytest.mark.parametrize(("depth", "per_pixel"), [(8, 4), (16, 20)])
def test_what_a_png_takes_is_told_by_its_depth(tmp_path, depth, per_pixel):
    room = read_header(png_bomb(tmp_path / "a.png", 100, depth)).room
    assert room.bytes(100 * 100) == 100 * 100 * per_pixel
    assert room.coefficients is None


@pytest.mark.parametrize("turn", range(1, 9))
@pytest.mark.parametrize("size", [(96, 64), (97, 65)])
def test_a_jpeg_is_reduced_while_it_is_decoded_and_fits_as_if_it_were_not(tmp_path, limited, turn, size):
    path, exif = tmp_path / "a.jpg", Image.Exif()
    exif[0x0112] = turn
    Image.fromarray(smooth(*size)).save(path, quality=98, subsampling=0, exif=exif)
    whole = PhotoFile(path)
    needed = size[0] * size[1] * (4 if turn == 1 else 8)
    half = f"from {size[0]} x {size[1]} to {(size[0] + 1) // 2} x {(size[1] + 1) // 2} pixels"
    with limited(needed - 1), pytest.warns(LightprobeWarning, match=half):
        reduced = PhotoFile(path)
    assert (reduced.width, reduced.height) == (whole.width, whole.height)
    got, expected = (one.rows(0, one.height)[0] for one in (reduced, whole))
    assert np.abs(got - expected).max() < 0.05
    assert np.abs(got - expected[::-1]).max() > 0.5
    np.testing.assert_array_equal(reduced.rows(10, 21)[0], got[10:21])
    with limited(needed), warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_array_equal(PhotoFile(path).rows(0, whole.height)[0], expected)


def test_a_jpeg_is_reduced_as_far_as_it_has_to_be_and_said_once(tmp_path, limited):
    path = tmp_path / "a.jpg"
    Image.fromarray(smooth(160, 80)).save(path)
    with limited(160 * 80 * 4 / 16):
        with pytest.warns(LightprobeWarning, match="to 40 x 20 pixels"):
            PhotoFile(path)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            PhotoFile(path)
    with limited(160 * 80 * 4 / 64 - 1), pytest.raises(InputError, match="160 x 80 pixels"):
        PhotoFile(path)


def test_scans_of_a_progressive_jpeg_take_room_at_any_size(tmp_path, limited):
    path = tmp_path / "a.jpg"
    Image.fromarray(smooth(160, 80)).save(path, progressive=True, subsampling=2)
    room = read_header(path).room
    assert room.coefficients == pytest.approx(3)  # 16 bits of one luma and half a chroma sample
    with limited(160 * 80 * 3), pytest.raises(InputError, match="baseline"):
        PhotoFile(path)


def test_floats_take_more_than_bytes(tmp_path, limited):
    write_exr(tmp_path / "a.exr", np.ones((40, 50, 3)))
    with limited(40 * 50 * 8), pytest.raises(InputError, match="50 x 40 pixels"):
        PhotoFile(tmp_path / "a.exr")


def test_new_photos_are_worked_on_at_a_size_that_is_held(monkeypatch):
    monkeypatch.setattr(limits, "WORKED_PIXELS", 10_000)
    assert worked_size(Path("a"), (100, 100)) == (100, 100)
    assert worked_size(Path("a"), (200, 800)) == (50, 200)
    assert worked_size(Path("a"), (200, 800), (20, 80)) == (20, 80)


def test_a_limit_reduces_them_further_and_says_so(limited):
    with (
        limited(2**20 * limits._WORKED_BYTES + limits._LATER),
        pytest.warns(LightprobeWarning, match="from 4096 x 2048 to 1448 x 724"),
    ):
        assert worked_size(Path("a"), (2048, 4096)) == (724, 1448)
    with (
        limited(2**18 * limits._WORKED_BYTES + limits._LATER - 100),
        pytest.raises(InputError, match="4096 x 2048 pixels"),
    ):
        worked_size(Path("a"), (2048, 4096))


def test_work_on_all_pixels_is_refused_where_there_is_no_room(limited):
    limits.check_room(Path("a"), (1000, 1000), 100)
    with limited(1e8):
        limits.check_room(Path("a"), (1000, 1000), 100)
        with pytest.raises(InputError, match="1001 x 1000 pixels"):
            limits.check_room(Path("a"), (1001, 1000), 100)
