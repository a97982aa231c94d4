"""Exposure out of EXIF, whatever stands there."""

import numpy as np
import pytest
from PIL import Image

from lightprobe.imaging import read_exif_ev100
from lightprobe.imaging.exif import read_orientation

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
    root = b"\1\0" + (_FOLDER).to_bytes(2, "little") + b"\4\0\1\0\0\0" + offset.to_bytes(4, "little") + bytes(4)
    exif = b"Exif\0\0II*\0\x08\0\0\0" + root + folder + bytes(4) + data
    Image.new("RGB", (8, 6)).save(path, exif=exif)
    return path


def rational(above, below):
    return above.to_bytes(4, "little") + below.to_bytes(4, "little")


def double(value):
    return np.float64(value).tobytes()


def test_a_usual_exposure(tmp_path):
    entries = [(_TIME, _RATIONAL, rational(1, 100)), (_F_NUMBER, _RATIONAL, rational(4, 1)), (_ISO, _SHORT, b"\xc8\0")]
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
    entries = [(_TIME, _RATIONAL, rational(1, 100)), (_F_NUMBER, _RATIONAL, rational(4, 1)), (_ISO, _SHORT, b"\x64\0")]
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
