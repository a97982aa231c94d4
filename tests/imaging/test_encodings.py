"""Encodings against published numbers, against a colour management module, and in files."""

import io
import struct
import zlib

import numpy as np
import pillow_heif
import pytest
import tifffile
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageCms

from lightprobe.imaging import foreign_encoding, read_ldr, srgb_decode, write_png
from lightprobe.imaging.encodings import SRGB, camera_matrix, coded, hlg, pq, primaries_matrix
from lightprobe.imaging.profiles import icc_encoding
from tests.imaging.icc_profiles import P3_PRIMARIES, SRGB_PRIMARIES, fixed, icc, own_srgb, profile_of

RNG = np.random.default_rng(2)
ADOBE = ((0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457))  # XYZ, D50
PROPHOTO = ((0.79767, 0.28804, 0.0), (0.13519, 0.71188, 0.0), (0.03134, 0.00009, 0.82491))


def test_primaries_as_css_color_4_prints_them():
    p3 = primaries_matrix((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), (0.3127, 0.3290))
    expected = [[1.22494, -0.22494, 0], [-0.04206, 1.04206, 0], [-0.01964, -0.07864, 1.09827]]
    np.testing.assert_allclose(p3, expected, atol=1e-4)
    wide = coded(9, 13).matrix
    expected = [[1.66049, -0.58764, -0.07285], [-0.12455, 1.13290, -0.00835], [-0.01815, -0.10058, 1.11873]]
    np.testing.assert_allclose(wide, expected, atol=1e-4)


def test_white_stays_white_whatever_the_white_point():
    matrix = primaries_matrix(
        (0.734, 0.266), (0.160, 0.840), (0.037, 0.0001), (0.3457, 0.3585)
    )  # ProPhoto, D50
    np.testing.assert_allclose(matrix @ np.ones(3), 1, atol=2e-3)
    from_xyz = RNG.uniform(0.1, 1, (3, 3)) + np.eye(3)
    np.testing.assert_allclose(camera_matrix(from_xyz) @ np.ones(3), 1, atol=1e-12)


def test_high_dynamic_range_curves():
    """BT.2408: reference white is 58 % of PQ and 75 % of HLG; PQ's code 1 is 10000 cd/m2, HLG's 1 is 1 /
    .265.
    """
    assert float(pq(np.array(0.5807))) == pytest.approx(1, abs=0.002)
    assert float(pq(np.array(1.0))) == pytest.approx(10000 / 203)
    assert float(hlg(np.array(0.75))) == pytest.approx(1)
    assert float(hlg(np.array(1.0))) == pytest.approx(1 / 0.2650, rel=1e-3)
    assert float(hlg(np.array(0.5))) == pytest.approx((1 / 12) / 0.2650, rel=1e-3)


def test_code_points_of_srgb_and_television_are_srgb():
    for primaries, transfer in ((1, 13), (2, 2), (1, 1), (1, 6), (0, 255)):
        assert coded(primaries, transfer) is SRGB


def managed(samples, profile):
    """What the colour management module makes of 8-bit samples, linear."""
    source, target = ImageCms.ImageCmsProfile(io.BytesIO(profile)), ImageCms.createProfile("sRGB")
    shown = ImageCms.profileToProfile(
        Image.fromarray(samples), source, target, ImageCms.Intent.RELATIVE_COLORIMETRIC
    )
    return srgb_decode(np.asarray(shown) / 255)


PARAMETRIC = (
    b"para" + bytes(4) + struct.pack(">HH", 3, 0) + fixed(2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
)
TABLE = (
    b"curv"
    + bytes(4)
    + struct.pack(">I", 64)
    + (np.linspace(0, 1, 64) ** 1.8 * 65535).astype(">u2").tobytes()
)


@pytest.mark.parametrize("primaries", [P3_PRIMARIES, ADOBE, PROPHOTO])
@pytest.mark.parametrize("curve", [None, PARAMETRIC, TABLE])
def test_profiles_do_what_a_colour_management_module_does(tmp_path, primaries, curve):
    """Within its rounding to 8 bits, for colours within sRGB; a photo of a phone has the parametric curve."""
    profile = icc("Some Thing", primaries, 2.2, curve)
    samples = RNG.integers(90, 170, (20, 30, 3), dtype=np.uint8)
    Image.fromarray(samples).save(tmp_path / "a.png", icc_profile=profile)
    expected = managed(samples, profile)
    inside = ((expected > 0) & (expected < 1)).all(axis=2)
    assert inside.mean() > 0.5
    found = read_ldr(tmp_path / "a.png")[0]
    np.testing.assert_allclose(found[inside], expected[inside], atol=0.006)
    assert foreign_encoding(tmp_path / "a.png") == "ICC profile Some Thing"


@pytest.mark.parametrize("kind", range(5))
def test_parametric_curves_of_every_kind(kind):
    """The formulas of ICC.1:2022, table 68, written out."""
    g, a, b, c, d, e, f = 2.2, 0.9, 0.1, 0.3, 0.2, 0.05, 0.02
    values = {0: (g,), 1: (g, a, b), 2: (g, a, b, c), 3: (g, a, b, c, d), 4: (g, a, b, c, d, e, f)}[kind]
    content = b"para" + bytes(4) + struct.pack(">HH", kind, 0) + fixed(*values)
    x = np.linspace(0, 1, 101)
    power = (a * x + b) ** g
    pieces = (np.where(x >= d, power, c * x), np.where(x >= d, power + e, c * x + f))
    expected = (x**g, power, power + c, *pieces)[kind]
    encoding = icc_encoding(icc("x", P3_PRIMARIES, 1.0, content))
    np.testing.assert_allclose(encoding.curves[0](x), expected, atol=1e-4)


def swapped():
    """A profile whose table swaps red and blue, which no curves and matrix could say."""
    grid = np.stack(np.meshgrid(*[[0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    srgb = np.array([[0.4360, 0.3851, 0.1431], [0.2225, 0.7169, 0.0606], [0.0139, 0.0971, 0.7141]])
    xyz = np.clip(grid[:, ::-1] @ srgb.T / (1 + 32767 / 32768), 0, 1)
    head = (
        b"mft2" + bytes(4) + bytes([3, 3, 2, 0]) + fixed(1, 0, 0, 0, 1, 0, 0, 0, 1) + struct.pack(">HH", 2, 2)
    )
    ramp = np.array([0, 65535] * 3, ">u2").tobytes()
    table = head + ramp + (xyz * 65535).astype(">u2").tobytes() + ramp
    return profile_of("Swapped", b"RGB ", {b"A2B0": table})


@pytest.mark.parametrize("kind", ["png", "alpha.png", "tif", "deep.tif", "deep.png", "heic"])
def test_profiles_of_tables_are_converted_too(tmp_path, kind):
    profile = swapped()
    assert icc_encoding(profile).profile == profile
    path = tmp_path / f"a.{kind}"
    red = np.zeros((16, 16, 4 if kind == "alpha.png" else 3), np.uint8)
    red[..., 0] = red[..., 3:] = 255
    if kind == "deep.tif":
        tifffile.imwrite(path, red.astype(np.uint16) * 257, photometric="rgb", iccprofile=profile)
    elif kind == "heic":
        pillow_heif.from_pillow(Image.fromarray(red)).save(path, quality=100, chroma=444, icc_profile=profile)
    elif kind == "deep.png":
        write_png(path, red / 255, bits=16)
        name = b"x\0\0" + zlib.compress(profile)
        chunk = struct.pack(">I", len(name)) + b"iCCP" + name + struct.pack(">I", zlib.crc32(b"iCCP" + name))
        path.write_bytes(path.read_bytes()[:33] + chunk + path.read_bytes()[33:])
    else:
        Image.fromarray(red).save(path, icc_profile=profile)
    color, alpha = read_ldr(path)
    assert color[4, 4, 2] > 0.9
    assert color[4, 4, 0] < 0.1
    assert (alpha is not None) == (kind == "alpha.png")


def png_with(path, samples, *chunks):
    buffer = io.BytesIO()
    Image.fromarray(samples).save(buffer, "PNG")
    data = buffer.getvalue()
    for kind, content in chunks:
        crc = zlib.crc32(kind + content)
        chunk = struct.pack(">I", len(content)) + kind + content + struct.pack(">I", crc)
        data = data[:33] + chunk + data[33:]
    path.write_bytes(data)
    return path


def test_png_gamma_chromaticities_and_code_points(tmp_path):
    samples = RNG.integers(60, 200, (8, 8, 3), dtype=np.uint8)
    linear = png_with(tmp_path / "a.png", samples, (b"gAMA", struct.pack(">I", 100000)))
    np.testing.assert_allclose(read_ldr(linear)[0], samples / 255, atol=1e-6)
    steep = png_with(tmp_path / "b.png", samples, (b"gAMA", struct.pack(">I", 55556)))
    np.testing.assert_allclose(read_ldr(steep)[0], (samples / 255) ** 1.8, atol=1e-4)
    p3 = struct.pack(">8I", 31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000)
    wide = png_with(tmp_path / "c.png", samples, (b"cHRM", p3), (b"gAMA", struct.pack(">I", 45455)))
    matrix = coded(12, 13).matrix
    expected = np.maximum(srgb_decode(samples / 255) @ matrix.T, 0)
    np.testing.assert_allclose(read_ldr(wide)[0], expected, atol=1e-3)
    points = png_with(tmp_path / "d.png", samples, (b"cICP", bytes([12, 13, 0, 1])))
    np.testing.assert_allclose(read_ldr(points)[0], expected, atol=1e-5)
    assert foreign_encoding(points) == "Display P3"
    profile = b"x\0\0" + zlib.compress(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    both = png_with(tmp_path / "e.png", samples, (b"cICP", bytes([12, 13, 0, 1])), (b"iCCP", profile))
    np.testing.assert_allclose(read_ldr(both)[0], expected, atol=1e-5)
    broken = b"x\0\0" + zlib.compress(b"nonsense" * 40)
    short = png_with(tmp_path / "f.png", samples, (b"cICP", bytes([12, 13, 0])), (b"iCCP", broken))
    assert foreign_encoding(short) == "ICC profile that cannot be read"  # so the profile counts


def test_adobe_rgb_that_a_camera_declares_by_exif_alone(tmp_path):
    picture, exif = Image.new("RGB", (32, 32), (200, 120, 60)), Image.Exif()
    exif.get_ifd(0x8769)[0xA005] = {1: "R03"}
    picture.save(tmp_path / "a.jpg", quality=100, subsampling=0, exif=exif)
    assert foreign_encoding(tmp_path / "a.jpg") == "Adobe RGB"
    np.testing.assert_allclose(read_ldr(tmp_path / "a.jpg")[0][5, 5], (0.7436, 0.1906, 0.0351), atol=5e-3)
    exif.get_ifd(0x8769)[0xA005] = {1: "R98"}
    picture.save(tmp_path / "b.jpg", exif=exif)
    assert foreign_encoding(tmp_path / "b.jpg") is None


def test_code_points_of_avif_are_followed(tmp_path):
    path = tmp_path / "a.avif"
    Image.fromarray(np.full((16, 16, 3), 180, np.uint8)).save(path, quality=100)
    assert foreign_encoding(path) is None
    path.write_bytes(path.read_bytes().replace(b"nclx\0\x01\0\x0d", b"nclx\0\x09\0\x12"))
    assert foreign_encoding(path) == coded(9, 18).name == "BT.2020 HLG"
    np.testing.assert_allclose(read_ldr(path)[0].mean(), hlg(np.array(180 / 255)), rtol=0.03)


def test_cmyk_with_a_broken_profile_is_still_read(tmp_path):
    Image.new("CMYK", (8, 8), (0, 0, 0, 0)).save(tmp_path / "a.jpg", icc_profile=b"nonsense" * 40)
    np.testing.assert_allclose(read_ldr(tmp_path / "a.jpg")[0], 1, atol=0.01)
    assert foreign_encoding(tmp_path / "a.jpg") == "ICC profile that cannot be read"


@pytest.fixture
def image():
    return Image.fromarray(np.random.default_rng(1).integers(0, 256, (16, 16, 3), dtype=np.uint8))


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp"])
def test_another_profile_is_named_in_every_format(tmp_path, image, suffix):
    path = tmp_path / f"a.{suffix}"
    image.save(path, icc_profile=icc("Wide Thing", P3_PRIMARIES, 2.2))
    assert foreign_encoding(path) == "ICC profile Wide Thing"
    image.save(path, icc_profile=own_srgb())
    assert foreign_encoding(path) is None
    image.save(path)
    assert foreign_encoding(path) is None


@pytest.mark.parametrize("suffix", ["png", "jpg"])
def test_a_grey_picture_may_have_the_profile_of_its_colour_one(tmp_path, image, suffix):
    path = tmp_path / f"grey.{suffix}"
    image.convert("L").save(path, icc_profile=icc("Wide Thing", P3_PRIMARIES, 2.2))
    color = read_ldr(path)[0]
    assert color.shape == (*image.size[::-1], 3)
    levels = np.asarray(Image.open(path)) / 255
    np.testing.assert_allclose(color, np.repeat(levels[..., None] ** 2.2, 3, 2), atol=2e-3)


def test_the_colours_decide_not_the_name(tmp_path, image):
    image.save(tmp_path / "liar.png", icc_profile=icc("sRGB IEC61966-2.1", SRGB_PRIMARIES, 1.0))
    assert foreign_encoding(tmp_path / "liar.png") == "ICC profile sRGB IEC61966-2.1"
    renamed = own_srgb().replace("sRGB".encode("utf-16-be"), "some".encode("utf-16-be"))
    assert renamed != own_srgb()
    image.save(tmp_path / "modest.png", icc_profile=renamed)
    assert foreign_encoding(tmp_path / "modest.png") is None


def test_a_broken_profile_is_no_traceback(tmp_path, image):
    image.save(tmp_path / "a.png", icc_profile=b"nonsense" * 40)
    assert foreign_encoding(tmp_path / "a.png") == "ICC profile that cannot be read"


@pytest.mark.parametrize(
    ("gamma", "srgb", "expected"),
    [
        (45455, False, None),
        (100000, False, "PNG gamma 1"),
        (55556, False, "PNG gamma 0.5556"),
        (100000, True, None),
    ],
)
def test_png_gamma(tmp_path, gamma, srgb, expected):
    """The standard's own value means sRGB, and an sRGB chunk overrides any."""
    chunks = [(b"sRGB", b"\0")] * srgb + [(b"gAMA", struct.pack(">I", gamma))]
    path = png_with(tmp_path / "a.png", np.zeros((4, 4, 3), np.uint8), *chunks)
    assert foreign_encoding(path) == expected


@settings(deadline=None, max_examples=150)
@given(st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), min_size=1, max_size=4))
def test_a_profile_with_wrong_bytes_is_some_encoding(changes):
    data = bytearray(icc("Wide Thing", P3_PRIMARIES, 2.2, TABLE))
    for place, value in changes:
        data[place % len(data)] = value
    encoding = icc_encoding(bytes(data))
    assert encoding.name is None or "ICC profile" in encoding.name
