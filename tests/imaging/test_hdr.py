import itertools
import struct

import numpy as np
import OpenEXR
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lightprobe.core.errors import InputError
from lightprobe.imaging import read_hdr, write_exr, write_radiance
from lightprobe.imaging.decoding import read_header

RNG = np.random.default_rng(5)


def exr(path, channels, **header):
    settings_ = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **header}
    OpenEXR.File(settings_, channels).write(str(path))
    return path


@pytest.mark.parametrize("shape", [(9, 13), (9, 13, 1), (9, 13, 3), (9, 13, 4)])
@pytest.mark.parametrize("half", [False, True])
def test_exr_round_trip(tmp_path, shape, half):
    array = np.exp(RNG.normal(size=shape) * 3).astype(np.float32)
    write_exr(tmp_path / "a.exr", array, half=half)
    read = read_hdr(tmp_path / "a.exr")
    assert read.dtype == np.float32
    np.testing.assert_allclose(read, array.reshape(9, 13, -1), rtol=5e-4 if half else 0)


def test_colors_of_other_primaries_are_converted(tmp_path):
    """ACEScg's, by the standard attribute; those of sRGB change no bit."""
    planes = {
        name: np.full((3, 4), value, np.float32) for name, value in zip("RGB", (1.0, 0.5, 0.1), strict=True)
    }
    wide = exr(
        tmp_path / "a.exr", planes, chromaticities=(0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
    )
    np.testing.assert_allclose(read_hdr(wide)[1, 2], (1.3858, 0.4391, 0.0268), atol=1e-3)
    usual = exr(
        tmp_path / "b.exr", planes, chromaticities=(0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
    )
    np.testing.assert_array_equal(read_hdr(usual)[1, 2], np.float32((1.0, 0.5, 0.1)))


def test_channels_beside_the_colors_count_for_memory(tmp_path, monkeypatch):
    """All of them are decoded, those of other parts as well."""
    planes = {name: np.zeros((30, 40), np.float32) for name in (*"RGB", *(f"more{k}" for k in range(37)))}
    many = exr(tmp_path / "a.exr", planes)
    assert read_header(many).pixel_bytes == pytest.approx(16 + 40 * 4)
    shown, parts = (np.int32((0, 0)), np.int32((3, 2))), []
    for rows, columns in ((3, 4), (300, 400)):
        header = {"displayWindow": shown, "dataWindow": (np.int32((0, 0)), np.int32((columns - 1, rows - 1)))}
        pixels = np.zeros((rows, columns), np.float32)
        parts.append(OpenEXR.Part(header, dict.fromkeys("RGB", pixels), f"of {rows} rows"))
    OpenEXR.File(parts).write(str(tmp_path / "b.exr"))
    assert read_header(tmp_path / "b.exr").pixel_bytes == pytest.approx(16 + 12 * (1 + 1e4))
    monkeypatch.setattr("lightprobe.imaging.hdr._MOST_BYTES", 30 * 40 * 16)
    with pytest.raises(InputError, match="40 channels"):
        read_hdr(many)


def test_half_clips_instead_of_overflowing(tmp_path):
    write_exr(tmp_path / "a.exr", np.full((2, 2, 3), 1e9, np.float32), half=True)
    np.testing.assert_array_equal(read_hdr(tmp_path / "a.exr"), np.full((2, 2, 3), 65504))


def test_channels_are_read_by_name(tmp_path):
    planes = {name: np.full((3, 4), k, np.float32) for k, name in enumerate(("B", "G", "R", "Z"))}
    assert read_hdr(exr(tmp_path / "rgb.exr", planes))[0, 0].tolist() == [2, 1, 0]
    planes = {name: np.full((3, 4), k, np.float16) for k, name in enumerate(("Z", "X", "Y"))}
    assert read_hdr(exr(tmp_path / "xyz.exr", planes))[0, 0].tolist() == [1, 2, 0]


def test_other_channels_are_named(tmp_path):
    path = exr(tmp_path / "a.exr", {"layer.R": np.zeros((2, 2), np.float32)})
    with pytest.raises(InputError, match=r"a\.exr has the channels layer\.R"):
        read_hdr(path)


def test_cropped_exr_is_refused(tmp_path):
    window = (np.array([0, 0], np.int32), np.array([7, 7], np.int32))
    planes = {name: np.zeros((4, 4), np.float32) for name in "RGB"}
    with pytest.raises(InputError, match="cropped"):
        read_hdr(exr(tmp_path / "a.exr", planes, displayWindow=window))


def test_huge_exr_header_is_refused_before_decoding(tmp_path):
    write_exr(tmp_path / "a.exr", np.zeros((4, 4, 3)))
    data = (tmp_path / "a.exr").read_bytes()
    for name in (b"dataWindow", b"displayWindow"):
        start = data.index(name + b"\0") + len(name) + 1 + len(b"box2i\0") + 4
        data = data[:start] + struct.pack("<4i", 0, 0, 59999, 59999) + data[start + 16 :]
    (tmp_path / "a.exr").write_bytes(data)
    with pytest.raises(InputError, match="60000 x 60000"):
        read_hdr(tmp_path / "a.exr")


@pytest.mark.parametrize("kind", ["exr", "hdr"])
def test_truncation(tmp_path, kind):
    path = tmp_path / f"a.{kind}"
    (write_exr if kind == "exr" else write_radiance)(path, RNG.random((20, 30, 3)))
    data = path.read_bytes()
    for length in (0, 3, 40, len(data) // 2, len(data) - 1):
        path.write_bytes(data[:length])
        with pytest.raises(InputError, match=rf"a\.{kind}"):
            read_hdr(path)
    with pytest.raises(InputError, match="does not exist"):
        read_hdr(tmp_path / "none")


@pytest.mark.parametrize("width", [1, 7, 8, 200, 40000])
def test_radiance_round_trip(tmp_path, width):
    array = np.exp(RNG.normal(size=(3, width, 3)) * 8).astype(np.float32)
    array[1] = 2.5
    array[2, ::5] = 0
    write_radiance(tmp_path / "a.hdr", array)
    read = read_hdr(tmp_path / "a.hdr")
    assert (np.abs(read - array) <= array.max(axis=2, keepdims=True) / 255).all()
    assert (read[2, ::5] == 0).all()


def run_lengths(plane):
    """Return a plane (W,) uint8 as Radiance codes it: runs of up to 127, and single values as literals."""
    coded = b""
    for value, same in itertools.groupby(plane.tolist()):
        count = len(list(same))
        for length in [127] * (count // 127) + [count % 127] * (count % 127 > 0):
            coded += bytes([128 + length if length > 1 else 1, value])
    return coded


@settings(deadline=None, max_examples=60)
@given(st.lists(st.tuples(st.integers(0, 255), st.integers(1, 300)), min_size=1, max_size=12))
def test_radiance_runs_of_any_length(tmp_path_factory, runs):
    """A row in four planes of runs and literals, as other programs write it, is its pixels."""
    codes = np.concatenate([np.full(count, value) for value, count in runs]).astype(np.uint8)
    codes = np.concatenate([codes, np.arange(8, dtype=np.uint8)])  # narrower rows have no runs
    planes = (codes, codes[::-1], np.full_like(codes, 255), np.full_like(codes, 128))
    coded = b"".join(map(run_lengths, planes))
    header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X {len(codes)}\n".encode()
    path = tmp_path_factory.mktemp("hdr") / "a.hdr"
    path.write_bytes(header + struct.pack(">BBH", 2, 2, len(codes)) + coded)
    np.testing.assert_array_equal(
        read_hdr(path)[0], np.stack([codes, codes[::-1], np.full_like(codes, 255)], 1) / np.float32(256)
    )


def test_radiance_pixel_value_and_exposure(tmp_path):
    header = b"#?RGBE\nEXPOSURE=2\nFORMAT=32-bit_rle_rgbe\n# note\nEXPOSURE= 4\n\n-Y 1 +X 3\n"
    pixels = (
        bytes([128, 64, 0, 129]) + bytes([1, 1, 1, 1]) + bytes([200, 100, 50, 0])
    )  # old format: repeat, then zero
    (tmp_path / "a.hdr").write_bytes(header + pixels)
    np.testing.assert_allclose(read_hdr(tmp_path / "a.hdr")[0] * 8, [[1, 0.5, 0], [1, 0.5, 0], [0, 0, 0]])


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (b"#?RADIANCE\n\n+Y 2 +X 2\n", "top left"),
        (b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 2 +X 2\n", "XYZ"),
        (b"#?RADIANCE\nEXPOSURE=0\n\n-Y 2 +X 2\n", "EXPOSURE"),
        (b"#?RADIANCE\n\n-Y 60000 +X 60000\n", "60000 x 60000"),
        (b"#?RADIANCE\n\n-Y 0 +X 2\n", "no pixels"),
    ],
)
def test_bad_radiance_headers(tmp_path, header, message):
    (tmp_path / "a.hdr").write_bytes(header + bytes(16))
    with pytest.raises(InputError, match=message):
        read_hdr(tmp_path / "a.hdr")


def test_rgbe_negative_and_nan_become_zero(tmp_path):
    write_radiance(tmp_path / "a.hdr", np.array([[[-1, np.nan, 0.5]]]))
    np.testing.assert_array_equal(read_hdr(tmp_path / "a.hdr"), [[[0, 0, 0.5]]])


def test_a_damaged_exr_is_one_error_and_no_print(tmp_path, capfd):
    """The decoder prints to both streams, in part past Python."""
    write_exr(tmp_path / "a.exr", np.random.default_rng(0).random((16, 32, 3)))
    data = (tmp_path / "a.exr").read_bytes()
    for number in range(6):
        (tmp_path / "cut.exr").write_bytes(data[: len(data) * (number + 1) // 8])
        print("before")
        with pytest.raises(InputError, match=r"cut\.exr"):
            read_hdr(tmp_path / "cut.exr")
        print("after")
        assert capfd.readouterr() == ("before\nafter\n", "")
