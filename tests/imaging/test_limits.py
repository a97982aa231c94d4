"""Photos for which there is too little memory: reduced and said so, or refused before they are decoded."""

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.imaging import PhotoFile, check_memory, limits, worked_size, write_exr
from lightprobe.imaging.decoding import read_header


@pytest.fixture
def free(monkeypatch):
    """Return what sets how many bytes the machine seems to have free, beside those kept for strips."""
    return lambda left: monkeypatch.setattr(limits, "available_bytes", lambda: limits._BESIDE + int(left))


def png_bomb(path, side, depth=8):
    """Write the header of a PNG and nothing else: decoding it would say that it is damaged."""
    header = b"IHDR" + struct.pack(">IIBBBBB", side, side, depth, 2, 0, 0, 0)
    data = b"IDAT" + zlib.compress(b"\0")
    chunks = [
        struct.pack(">I", len(c) - 4) + c + struct.pack(">I", zlib.crc32(c)) for c in (header, data, b"IEND")
    ]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunks))
    return path


def test_a_bomb_is_refused_by_its_header(tmp_path, free):
    free(500e6)
    sentence = (
        r"bomb\.png has 11000 x 11000 pixels: this would take 0\.97 GB of memory, more than the 0\.50 GB"
    )
    with pytest.raises(InputError, match=sentence):
        PhotoFile(png_bomb(tmp_path / "bomb.png", 11000))
    with pytest.raises(InputError, match="cannot be decoded"):
        PhotoFile(png_bomb(tmp_path / "small.png", 40))


@pytest.mark.parametrize(
    ("name", "options", "estimate"),
    [
        ("a.png", {}, 8),
        ("a.jpg", {}, 8),
        ("a.jpg", {"progressive": True}, 10),
        ("a.webp", {}, 12),
        ("a.tif", {}, 9),
    ],
)
def test_the_estimate_of_memory_goes_by_the_kind_of_file(tmp_path, free, name, options, estimate):
    Image.new("RGB", (50, 40)).save(tmp_path / name, **options)
    assert read_header(tmp_path / name).pixel_bytes == estimate
    free(50 * 40 * estimate)
    assert PhotoFile(tmp_path / name).width == 50
    free(50 * 40 * estimate - 1)
    with pytest.raises(InputError, match="50 x 40 pixels"):
        PhotoFile(tmp_path / name)


def test_deep_samples_take_more(tmp_path):
    assert read_header(png_bomb(tmp_path / "a.png", 100, 16)).pixel_bytes == 20
    write_exr(tmp_path / "a.exr", np.ones((40, 50, 3)))
    assert read_header(tmp_path / "a.exr").pixel_bytes == 16 + 12


def test_new_photos_are_worked_on_at_a_size_that_is_held(monkeypatch):
    monkeypatch.setattr(limits, "WORKED_PIXELS", 10_000)
    assert worked_size(Path("a"), (100, 100)) == (100, 100)
    assert worked_size(Path("a"), (200, 800)) == (50, 200)
    assert worked_size(Path("a"), (200, 800), (20, 80)) == (20, 80)


def test_little_memory_reduces_them_further_and_says_so(free):
    free(2**20 * limits._WORKED_BYTES + limits._LATER)
    with pytest.warns(LightprobeWarning, match="from 4096 x 2048 to 1448 x 724"):
        assert worked_size(Path("a"), (2048, 4096)) == (724, 1448)
    free(2**18 * limits._WORKED_BYTES + limits._LATER - 100)
    with pytest.raises(InputError, match="4096 x 2048 pixels"):
        worked_size(Path("a"), (2048, 4096))


def test_work_on_all_pixels_is_refused_where_there_is_too_little(monkeypatch, free):
    free(1e8)
    check_memory(Path("a"), (1000, 1000), 100)
    with pytest.raises(InputError, match="1001 x 1000 pixels"):
        check_memory(Path("a"), (1001, 1000), 100)
    monkeypatch.setattr(limits, "available_bytes", lambda: None)
    check_memory(Path("a"), (1001, 1000), 100)
