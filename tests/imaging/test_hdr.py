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
        (b"#?RADIANCE\n\n+Y 2 +Y 2\n", "names no size"),
        (b"#?RADIANCE\n\n-Y 2\n", "names no size"),
        (b"#?RADIANCE\nCOLORCORR=1 0 1\n\n-Y 2 +X 2\n", "a COLORCORR that is not three positive numbers"),
        (b"#?RADIANCE\nCOLORCORR=1\n\n-Y 2 +X 2\n", "a COLORCORR that is not three positive numbers"),
        (b"#?RADIANCE\nEXPOSURE=one\n\n-Y 2 +X 2\n", "an EXPOSURE that is not a positive number"),
        (b"#?RADIANCE\nPRIMARIES=.64 .33\n\n-Y 2 +X 2\n", "PRIMARIES that is not eight numbers"),
        (b"#?RADIANCE\nPRIMARIES=0 0 0 0 0 0 0 0\n\n-Y 2 +X 2\n", "PRIMARIES that are no colours"),
        (b"#?RADIANCE\nGAMMA=2.2\n\n-Y 2 +X 2\n", "a GAMMA of 2.2; save it with linear values"),
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


# Radiance: what else its header says


def radiance(path, pixels, *, header="", size="-Y {h} +X {w}"):
    """Write pixels (lines, length, 4) one after the other."""
    lines, length = pixels.shape[:2]
    size = size.format(h=lines, w=length, lines=lines, length=length)
    path.write_bytes(f"#?RADIANCE\n{header}\n{size}\n".encode() + pixels.astype(np.uint8).tobytes())
    return path


ORDERS = {
    "-Y +X": lambda picture: picture,
    "+Y +X": lambda picture: picture[::-1],
    "-Y -X": lambda picture: picture[:, ::-1],
    "+Y -X": lambda picture: picture[::-1, ::-1],
    "+X -Y": lambda picture: picture.swapaxes(0, 1),
    "+X +Y": lambda picture: picture[::-1].swapaxes(0, 1),
    "-X -Y": lambda picture: picture[:, ::-1].swapaxes(0, 1),
    "-X +Y": lambda picture: picture[::-1, ::-1].swapaxes(0, 1),
}


@pytest.mark.parametrize("order", ORDERS)
def test_radiance_in_every_order_of_its_pixels(tmp_path, order):
    """The scan lines come in the first direction, the pixels of each in the second; +Y is upwards."""
    picture = RNG.integers(2, 200, (5, 9, 4))
    picture[..., 3] = 128
    first, second = order.split()
    path = radiance(tmp_path / "a.hdr", ORDERS[order](picture), size=f"{first} {{lines}} {second} {{length}}")
    np.testing.assert_array_equal(read_hdr(path), (picture[..., :3] / 256).astype(np.float32))
    assert read_header(path).size == (9, 5)


def grey(path, header):
    pixels = np.full((2, 3, 4), 128)
    return read_hdr(radiance(path, pixels, header=header))[0, 0]


def test_radiance_corrections_are_taken_out(tmp_path):
    """Both are what the picture was multiplied with, all of them; a line behind a tab is of an older file."""
    header = "EXPOSURE=2\nCOLORCORR=.5 1 2\nCOLORCORR= 1 1 .25\n\tEXPOSURE=64\nVIEW= -vtv -vp 0 0 1\nPIXASPECT=1\nGAMMA=1\n"
    np.testing.assert_allclose(grey(tmp_path / "a.hdr", header), (0.5, 0.25, 0.5))


def test_radiance_primaries_are_converted(tmp_path):
    """White stays white, also another one; P3's red is stronger than sRGB's."""
    usual = "PRIMARIES=0.640 0.330 0.290 0.600 0.150 0.060 0.333 0.333\n"
    np.testing.assert_allclose(grey(tmp_path / "a.hdr", usual), 0.5, atol=1e-6)
    pixels = np.array([[[128, 0, 0, 128]]])
    p3 = "PRIMARIES=0.680 0.320 0.265 0.690 0.150 0.060 0.3127 0.3290\n"
    red = read_hdr(radiance(tmp_path / "b.hdr", pixels, header=p3))[0, 0]
    np.testing.assert_allclose(red, (0.5 * 1.2249, 0, 0), atol=1e-4)
    srgb = "PRIMARIES=0.64 0.33 0.30 0.60 0.15 0.06 0.3127 0.3290\n"
    np.testing.assert_array_equal(
        read_hdr(radiance(tmp_path / "c.hdr", pixels, header=srgb))[0, 0], (0.5, 0, 0)
    )


def test_radiance_header_with_carriage_returns(tmp_path):
    pixels = bytes([128, 64, 0, 129])
    (tmp_path / "a.hdr").write_bytes(b"#?RADIANCE\r\nEXPOSURE=2\r\n\r\n-Y 1 +X 1\r\n" + pixels)
    np.testing.assert_array_equal(read_hdr(tmp_path / "a.hdr")[0, 0], (0.5, 0.25, 0))


# OpenEXR: layers and parts


def planes(*names, size=(3, 4)):
    """Channels of constants: 1 for the first name, 2 for the second, ..."""
    return {name: np.full(size, number, np.float32) for number, name in enumerate(names, start=1)}


def layer(name, letters="RGB"):
    return [f"{name}.{letter}" for letter in letters]


@pytest.mark.parametrize(
    ("names", "read"),
    [
        (["diffuse.R", "diffuse.G", "diffuse.B", "R", "G", "B", "A"], [4, 5, 6, 7]),
        (
            [*layer("ViewLayer.DiffDir"), *layer("ViewLayer.Combined", "RGBA"), "ViewLayer.Depth.Z"],
            [4, 5, 6, 7],
        ),
        ([*layer("diffuse_color"), *layer("Beauty"), *layer("rgb_noise")], [4, 5, 6]),
        ([*layer("only"), "only.Z"], [1, 2, 3]),
        (["r", "g", "b"], [1, 2, 3]),
        (["red", "green", "blue", *layer("specular")], [1, 2, 3]),
        (["X", "Y", "Z", *layer("beauty")], [4, 5, 6]),
        ([*layer("normal", "XYZ"), *layer("position", "XYZ"), *layer("color")], [7, 8, 9]),
    ],
)
def test_the_beauty_of_an_exr_s_layers(tmp_path, names, read):
    path = exr(tmp_path / "a.exr", planes(*names))
    assert read_hdr(path)[1, 2].tolist() == read
    assert read_header(path).size == (4, 3)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (
            [*layer("diffuse"), *layer("specular")],
            "holds the layers diffuse, specular, of which not exactly one",
        ),
        ([*layer("left.beauty"), *layer("right.beauty")], "holds the layers left.beauty, right.beauty"),
        (layer("normal", "XYZ"), "has the channels normal.X, normal.Y, normal.Z; save one layer"),
        (["depth.Z"], "has the channels depth.Z"),
    ],
)
def test_layers_of_which_none_is_the_picture(tmp_path, names, said):
    with pytest.raises(InputError) as caught:
        read_hdr(exr(tmp_path / "a.exr", planes(*names)))
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("parts", "read", "size"),
    [
        ([("rgba", "RGBA", (3, 4)), ("depth", "Z", (3, 4))], [1, 2, 3, 4], (4, 3)),
        ([("depth", "Z", (3, 4)), ("rgba", "RGBA", (3, 4))], [1, 2, 3, 4], (4, 3)),
        (
            [("normal", "XYZ", (5, 6)), ("diffuse", "RGB", (5, 6)), ("beauty", "RGB", (5, 6))],
            [1, 2, 3],
            (6, 5),
        ),
        ([("depth", "Z", (3, 4)), ("render", "RGB", (3, 4))], [1, 2, 3], (4, 3)),
    ],
)
def test_the_beauty_of_an_exr_s_parts(tmp_path, parts, read, size):
    zero = np.int32((0, 0))
    made = []
    for name, letters, shape in parts:
        window = (zero, np.int32((shape[1] - 1, shape[0] - 1)))
        header = {"dataWindow": window, "displayWindow": window}
        made.append(OpenEXR.Part(header, planes(*letters, size=shape), name))
    OpenEXR.File(made).write(str(tmp_path / "a.exr"))
    found = read_hdr(tmp_path / "a.exr")
    assert found[1, 1].tolist() == read
    assert found.shape[1::-1] == read_header(tmp_path / "a.exr").size == size
