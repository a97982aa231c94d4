"""Photos in every kind of file: the colours that were put in come out, in linear sRGB."""

import builtins
import importlib.util
import io
import subprocess
import sys

import numpy as np
import pillow_heif
import pytest
import tifffile
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.imaging import (
    PhotoFile,
    foreign_encoding,
    image_size,
    read_exif_ev100,
    read_ldr,
    read_mask,
    read_orientation,
    read_photo,
    srgb_decode,
    srgb_encode,
    write_exr,
    write_png,
    write_radiance,
)
from tests.imaging.icc_profiles import P3_PRIMARIES, grey_icc, icc
from tests.imaging.raw_files import NEUTRAL, XYZ_TO_CAMERA, write_dng

RNG = np.random.default_rng(8)
P3_TO_SRGB = np.array([[1.2249, -0.2247, 0], [-0.0420, 1.0419, 0], [-0.0197, -0.0786, 1.0979]])  # CSS Color 4
SRGB_TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def patches(levels=255):
    """Four flat patches of 16 x 16, of colours within sRGB: encoded integers (32, 32, 3)."""
    colors = np.array([[[0.8, 0.3, 0.2], [0.2, 0.6, 0.3]], [[0.25, 0.3, 0.7], [0.5, 0.5, 0.5]]])
    dtype = np.uint8 if levels == 255 else np.uint16
    return np.rint(colors.repeat(16, 0).repeat(16, 1) * levels).astype(dtype)


def centres(image):
    """The middle of every patch of `patches`."""
    return image[[8, 8, 24, 24], [8, 24, 8, 24]]


@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("compression", [None, "zlib"])
def test_sixteen_bit_tiff_keeps_its_very_samples(tmp_path, channels, compression):
    samples = RNG.integers(0, 65536, (13, 17, channels), dtype=np.uint16)
    kind = "minisblack" if channels == 1 else "rgb"
    alpha = {"extrasamples": ["unassalpha"]} if channels == 4 else {}
    tifffile.imwrite(
        tmp_path / "a.tif", samples.squeeze(), photometric=kind, compression=compression, **alpha
    )
    color, own = read_ldr(tmp_path / "a.tif", srgb=False)
    expected = samples / 65535
    np.testing.assert_allclose(color, np.broadcast_to(expected[..., :3], color.shape), atol=1e-7)
    assert (own is not None) == (channels == 4)
    if own is not None:
        np.testing.assert_allclose(own, expected[..., 3], atol=1e-7)
    np.testing.assert_allclose(read_ldr(tmp_path / "a.tif")[0][..., :3], srgb_decode(color), atol=1e-6)


@pytest.mark.parametrize("turn", range(1, 9))
@pytest.mark.parametrize("kind", ["plain", "compressed", "deep", "float", "big-endian", "pillow"])
def test_tiff_is_turned_once(tmp_path, kind, turn):
    samples = RNG.integers(0, 256, (6, 9, 3), dtype=np.uint8)
    path, tags = tmp_path / "a.tif", [(0x0112, "H", 1, turn, True)]
    if kind == "pillow":
        exif = Image.Exif()
        exif[0x0112] = turn
        Image.fromarray(samples).save(path, exif=exif.tobytes())
    else:
        stored = {"deep": samples.astype(np.uint16) * 257, "float": (samples / 255).astype(np.float32)}
        tifffile.imwrite(
            path,
            stored.get(kind, samples),
            photometric="rgb",
            extratags=tags,
            byteorder=">" if "big" in kind else "<",
            compression="deflate" if kind == "compressed" else None,
        )
    upright = samples if turn < 5 else samples.swapaxes(0, 1)
    down, back = (turn in numbers for numbers in ((3, 4, 7, 8), (2, 3, 6, 7)))
    upright = upright[::-1] if down else upright
    upright = upright[:, ::-1] if back else upright
    assert image_size(path) == upright.shape[1::-1]
    np.testing.assert_allclose(read_ldr(path, srgb=False)[0], upright / np.float32(255), atol=1e-6)
    np.testing.assert_allclose(
        read_ldr(path, srgb=False, orient=False)[0], samples / np.float32(255), atol=1e-6
    )


def test_premultiplied_alpha_of_tiff_is_divided_out(tmp_path):
    samples = np.full((4, 4, 4), 32768, np.uint16)
    samples[..., 0] = 16384
    tifffile.imwrite(tmp_path / "a.tif", samples, photometric="rgb", extrasamples=["assocalpha"])
    color, alpha = read_ldr(tmp_path / "a.tif", srgb=False)
    np.testing.assert_allclose(color[0, 0], [0.5, 1, 1], atol=2e-5)
    np.testing.assert_allclose(alpha, 0.5, atol=1e-5)


@pytest.mark.parametrize("mode", ["1", "L", "P", "RGB", "RGBA"])
@pytest.mark.parametrize("compression", ["raw", "tiff_adobe_deflate", "packbits"])
def test_eight_bit_tiff(tmp_path, mode, compression):
    image = Image.fromarray(patches()).convert(mode)
    image.save(tmp_path / "a.tif", compression=compression)
    expected = srgb_decode(np.asarray(image.convert("RGB")) / 255)
    np.testing.assert_allclose(read_ldr(tmp_path / "a.tif")[0], expected, atol=1e-6)


def test_what_is_clipped_is_told_by_what_the_file_stores(tmp_path):
    """One saturated colour of a wide gamut, which lies above white in sRGB, hides nothing of the others."""
    samples = np.full((12, 12, 3), 120, np.uint8)
    samples[3:5, 4:8], samples[9, 9] = 255, (255, 200, 150)
    path = tmp_path / "a.png"
    Image.fromarray(samples).save(path, icc_profile=icc("Wide Thing", P3_PRIMARIES, 2.2))
    color, alpha, clipped = read_photo(path)
    assert alpha is None
    assert color[9, 9, 0] > 1.02
    np.testing.assert_array_equal(clipped, samples == 255)
    small = read_photo(path, size=(4, 4))
    np.testing.assert_array_equal(small[2][..., 0], [[0, 0, 0, 0], [0, 1, 1, 0], [0, 0, 0, 0], [0, 0, 0, 1]])
    np.testing.assert_allclose(small[0], read_ldr(path, size=(4, 4))[0])


@pytest.mark.parametrize("write", ["tiff", "exr", "hdr"])
def test_floats_are_linear_and_have_no_white(tmp_path, write):
    light = np.exp(RNG.normal(size=(9, 11, 3)) * 2).astype(np.float32)
    path = tmp_path / f"a.{write}"
    if write == "tiff":
        tifffile.imwrite(path, light, photometric="rgb")
    else:
        {"exr": write_exr, "hdr": write_radiance}[write](path, light)
    color, alpha = read_ldr(path)
    assert alpha is None
    np.testing.assert_allclose(color, light, atol=0.004 * light.max() if write == "hdr" else 0)
    assert not PhotoFile(path).clipped_rows(0, 9).any()
    assert image_size(path) == (11, 9)
    assert foreign_encoding(path) is None


def test_exr_photos_have_straight_colour_and_finite_values(tmp_path):
    planes = np.full((4, 4, 4), 0.5, np.float32)
    planes[0, 0] = np.nan
    planes[0, 1, :3] = np.inf
    planes[0, 2, :3] = -1
    write_exr(tmp_path / "a.exr", planes)
    color, alpha = read_ldr(tmp_path / "a.exr")
    np.testing.assert_allclose(color[1:], 1)
    np.testing.assert_allclose(alpha[1:], 0.5)
    assert np.isfinite(color).all()
    assert color.min() == 0
    assert alpha[0, 0] == 0


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp", "tif", "heic", "avif", "deep"])
def test_display_p3_becomes_srgb(tmp_path, suffix):
    """The colours of P3 samples, by the matrix that CSS Color 4 prints; what lies outside sRGB is kept above
    1.
    """
    profile = icc("Wide Thing", P3_PRIMARIES, 2.2)
    samples = patches(65535 if suffix == "deep" else 255)
    samples[:16, :16] = np.array([1.0, 0.2, 0.2]) * samples.max() / 0.8 if suffix == "deep" else (255, 51, 51)
    path = tmp_path / f"a.{'tif' if suffix == 'deep' else suffix}"
    if suffix == "deep":
        samples[:16, :16] = (65535, 13107, 13107)
        tifffile.imwrite(path, samples, photometric="rgb", iccprofile=profile)
    elif suffix == "heic":
        pillow_heif.from_pillow(Image.fromarray(samples)).save(
            path, quality=100, chroma=444, icc_profile=profile
        )
    else:
        options = {
            "jpg": {"quality": 100, "subsampling": 0},
            "webp": {"lossless": True},
            "avif": {"quality": 100},
        }
        Image.fromarray(samples).save(path, icc_profile=profile, **options.get(suffix, {}))
    white = 65535 if suffix == "deep" else 255
    expected = np.maximum((centres(samples) / white) ** 2.2 @ P3_TO_SRGB.T, 0)
    found = centres(read_ldr(path)[0])
    code = {"deep": 1e-3, "png": 2e-3, "webp": 2e-3, "tif": 2e-3}.get(
        suffix, 0.03
    )  # lossy: a few codes of 255
    np.testing.assert_allclose(found, expected, atol=code)
    assert found[0, 0] > 1.15
    assert foreign_encoding(path) == "ICC profile Wide Thing"
    clipped = PhotoFile(path).clipped_rows(0, 32)
    if suffix in ("png", "tif", "webp", "deep"):
        np.testing.assert_array_equal(clipped[8, 8], [True, False, False])
        assert not clipped[16:].any()


def heic(path, samples, *, bits=8, **options):
    """Write encoded samples as HEIC, without loss but for its colour transform."""
    if bits == 8:
        image = pillow_heif.from_pillow(Image.fromarray(samples))
    else:
        height, width = samples.shape[:2]
        image = pillow_heif.from_bytes(mode="RGB;16", size=(width, height), data=samples.tobytes())
    image.save(path, quality=100, chroma=444, **options)
    return path


def test_heic_of_ten_bits(tmp_path):
    """White must be white: ten bits are stored in sixteen, where 1023 is not 65535."""
    samples = patches(65535)
    samples[:16, :16] = 65535
    path = heic(tmp_path / "a.heic", samples, bits=10)
    color = read_ldr(path)[0]
    np.testing.assert_allclose(srgb_encode(centres(color)), centres(samples) / 65535, atol=3 / 1023)
    np.testing.assert_allclose(color[8, 8], 1, atol=1e-6)
    assert PhotoFile(path).clipped_rows(0, 32)[8, 8].all()


@pytest.mark.parametrize("orientation", [1, 3, 6, 8])
def test_heic_is_turned_once(tmp_path, orientation):
    """The file's own turn and the EXIF tag say the same; following both would turn twice."""
    samples = np.zeros((24, 40, 3), np.uint8)
    samples[:12, :12] = 255
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = heic(tmp_path / "a.heic", samples, exif=exif.tobytes())
    corner = {1: (4, 4), 3: (-4, -4), 6: (4, -4), 8: (-4, 4)}[orientation]
    color = read_ldr(path)[0]
    assert color[corner].min() > 0.9
    assert color[-corner[0], -corner[1]].max() < 0.1
    assert image_size(path) == color.shape[1::-1] == ((40, 24) if orientation < 5 else (24, 40))
    assert read_orientation(path) is None


def test_hdr_heic_by_its_code_points(tmp_path):
    """PQ (ST 2084): the code of 203 cd/m2 is .58; the file's BT.2020 grey stays grey."""
    samples = np.full((32, 32, 3), round(0.5807 * 65535), np.uint16)
    path = heic(tmp_path / "a.heic", samples, bits=10, color_primaries=9, transfer_characteristics=16)
    np.testing.assert_allclose(read_ldr(path)[0], 1, atol=0.03)
    assert foreign_encoding(path) == "BT.2020 PQ"


def test_heic_and_avif_with_alpha(tmp_path):
    samples = np.dstack([patches(), np.full((32, 32), 255, np.uint8)])
    samples[:16, :, 3] = 0
    pillow_heif.from_pillow(Image.fromarray(samples)).save(tmp_path / "a.heic", quality=100)
    Image.fromarray(samples).save(tmp_path / "a.avif", quality=100)
    for name in ("a.heic", "a.avif"):
        mask = read_mask(tmp_path / name)
        assert mask[:14].max() < 0.05
        assert mask[18:].min() > 0.95


def dng(path, **options):
    """Write two halves: grey of .4 (white balanced), and one where red and green saturate."""
    camera = np.empty((48, 64, 3))
    camera[:, :32] = 0.4 * np.array(NEUTRAL)
    camera[:, 32:] = (1.0, 1.0, 0.3)
    return write_dng(path, camera, **options)


def test_camera_raw_is_linear_in_the_cameras_white_balance(tmp_path):
    path = dng(tmp_path / "a.dng")
    photo = PhotoFile(path)
    color, alpha = read_ldr(path)
    assert alpha is None
    np.testing.assert_allclose(color[12:36, 6:24], 0.4, atol=0.002)
    clipped = photo.clipped_rows(0, 48)
    assert not clipped[:, :28].any()
    np.testing.assert_array_equal(clipped[24, 50], [True, True, False])
    balanced = np.array([1.0, 1.0, 0.3 / NEUTRAL[2]])
    matrix = XYZ_TO_CAMERA @ SRGB_TO_XYZ
    expected = np.linalg.solve(matrix / matrix.sum(axis=1, keepdims=True), balanced)
    np.testing.assert_allclose(color[24, 50], np.maximum(expected, 0), atol=0.005)


def test_white_of_camera_raw_is_the_sensors_and_not_the_photos_brightest(tmp_path):
    path = write_dng(tmp_path / "a.dng", np.broadcast_to(0.9 * np.array(NEUTRAL), (48, 64, 3)))
    np.testing.assert_allclose(read_ldr(path)[0][12:36, 12:52], 0.9, atol=0.002)
    assert not PhotoFile(path).clipped_rows(0, 48).any()


@pytest.mark.parametrize(("orientation", "column"), [(1, -8), (3, 8)])
def test_camera_raw_is_turned(tmp_path, orientation, column):
    path = dng(tmp_path / "a.dng", orientation=orientation)
    assert read_ldr(path)[0][24, column, 0] > 0.9
    assert read_orientation(path) == orientation
    assert image_size(path) == (64, 48)
    assert image_size(dng(tmp_path / "b.dng", orientation=6)) == (48, 64)


def test_the_content_tells_camera_raw_from_tiff(tmp_path):
    dng(tmp_path / "a.tif")
    assert read_ldr(tmp_path / "a.tif")[0][24, 12] == pytest.approx(0.4, abs=0.002)
    Image.fromarray(patches()).save(tmp_path / "b.tif")
    (tmp_path / "b.tif").rename(tmp_path / "b.dng")
    assert read_ldr(tmp_path / "b.dng")[0].shape == (32, 32, 3)


def test_exposure_of_tiff_and_heic(tmp_path):
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0x829A: 1 / 60, 0x829D: 2.8, 0x8827: 400})
    heic(tmp_path / "a.heic", patches(), exif=exif.tobytes())
    Image.fromarray(patches()).save(tmp_path / "a.tif", exif=exif.tobytes())
    for name in ("a.heic", "a.tif"):
        assert read_exif_ev100(tmp_path / name) == pytest.approx(np.log2(2.8**2 * 60) - 2, abs=1e-3)


KINDS = ("jpg", "png", "deep.png", "webp", "heic", "avif", "deep.tif", "tif", "dng", "exr", "hdr")


def any_photo(path):
    """Write a photo of 32 x 32 or more of the kind that `path` is named after."""
    if path.suffix == ".heic":
        return heic(path, patches())
    if path.suffix == ".dng":
        return dng(path)
    if path.suffix in (".exr", ".hdr"):
        {".exr": write_exr, ".hdr": write_radiance}[path.suffix](path, patches() / 255)
    elif path.name.endswith("deep.png"):
        write_png(path, RNG.random((40, 50, 3)), bits=16)
    elif path.name.endswith("deep.tif"):
        tifffile.imwrite(path, RNG.integers(0, 65536, (40, 50, 3), dtype=np.uint16), photometric="rgb")
    else:
        Image.fromarray(patches()).save(path)
    return path


@pytest.mark.filterwarnings("ignore::UserWarning")  # Pillow's, of odd tags
@pytest.mark.parametrize("kind", KINDS)
def test_damage_is_one_sentence(tmp_path, kind):
    path = any_photo(tmp_path / f"a.{kind}")
    data = path.read_bytes()
    for length in (0, 5, 20, 70, len(data) // 3, len(data) // 2):
        path.write_bytes(data[:length])
        with pytest.raises(InputError, match=r"a\..*\.$") as caught:
            read_ldr(path)
        assert "\n" not in str(caught.value)


def test_a_heic_without_its_primary_picture(tmp_path):
    data = bytearray(heic(tmp_path / "a.heic", patches()).read_bytes())
    at = data.index(b"pitm") + 8  # ISO 14496-12: version and flags, then the number of the item
    data[at : at + 2] = b"\x7f\x7f"
    (tmp_path / "a.heic").write_bytes(data)
    with pytest.raises(InputError, match=r"a\.heic cannot be decoded"):
        image_size(tmp_path / "a.heic")


@pytest.mark.slow
def test_damaged_tiff_prints_nothing_of_its_own(tmp_path):
    """In a process of its own, where nobody has set up logging."""
    path = any_photo(tmp_path / "a.deep.tif")
    data = bytearray(path.read_bytes())
    start = int.from_bytes(data[4:8], "little")
    following = start + 2 + 12 * int.from_bytes(data[start : start + 2], "little")
    data[following : following + 4] = (10**9).to_bytes(4, "little")  # where a second page would be
    path.write_bytes(data)
    code = "import sys; from lightprobe.imaging import tiff; print(tiff.is_raw(sys.argv[1]))"
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
    assert "invalid page offset" not in done.stderr


def test_a_tiff_whose_rows_lie_beyond_its_end_takes_no_memory_for_what_is_between(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((8, 16), np.uint8), bigtiff=True, rowsperstrip=4)
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        places = file.pages[0].tags["StripOffsets"]
        at, width = places.valueoffset, len(file.pages[0].dataoffsets)
        size = {3: 2, 4: 4, 16: 8}[int(places.dtype)]
    content = bytearray((tmp_path / "a.tif").read_bytes())
    content[at + size : at + width * size] = (2**63 - 1 if size == 8 else 2 ** (8 * size) - 1).to_bytes(
        size, "little"
    )
    (tmp_path / "a.tif").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.tif cannot be decoded"):
        read_ldr(tmp_path / "a.tif")


def test_sizes_are_checked_before_decoding(tmp_path):
    deep = tmp_path / "deep.tif"
    tifffile.imwrite(deep, np.zeros((4, 4, 3), np.uint16), photometric="rgb")
    with tifffile.TiffFile(deep, mode="r+b") as file:
        file.pages[0].tags["ImageWidth"].overwrite(60000)
        file.pages[0].tags["ImageLength"].overwrite(60000)
    for read in (read_ldr, image_size):
        with pytest.raises(InputError, match=r"deep\.tif announces 60000 x 60000 pixels"):
            read(deep)


@pytest.mark.parametrize(
    ("kind", "library"),
    [("heic", "pillow_heif"), ("tif", "tifffile"), ("dng", "rawpy")],
)
def test_a_missing_library_is_named_with_its_remedy(tmp_path, monkeypatch, kind, library):
    path = any_photo(tmp_path / f"a.{kind}")
    usual = builtins.__import__

    def without(name, *arguments, **options):
        if name.partition(".")[0] == library:
            raise ImportError(name)
        return usual(name, *arguments, **options)

    monkeypatch.setattr("importlib.import_module", lambda name: without(name))
    with pytest.raises(InputError, match=rf"without the library {library}; install .*lightprobe\[photos\]"):
        read_ldr(path)


def test_plain_srgb_keeps_its_bits(tmp_path):
    """No profile, sRGB's own, and code points of sRGB: exactly the look-up of the curve."""
    samples = RNG.integers(0, 256, (9, 12, 3), dtype=np.uint8)
    table = srgb_decode(np.arange(256) / 255).astype(np.float32)
    for suffix in ("png", "tif"):
        Image.fromarray(samples).save(tmp_path / f"a.{suffix}")
        np.testing.assert_array_equal(read_ldr(tmp_path / f"a.{suffix}")[0], table[samples])
    write_png(tmp_path / "deep.png", RNG.random((4, 4, 3)), bits=16)
    assert foreign_encoding(tmp_path / "deep.png") is None


@pytest.mark.parametrize("depth", [8, 16])
def test_a_value_near_white_is_clipped_and_one_below_is_not(tmp_path, depth):
    """.98 in linear light, as the photo's consumers have it: from 253 of 255 on."""
    levels = 2**depth - 1
    ramp = np.arange(256) * (levels // 255)
    samples = np.dstack([ramp] * 3).astype(np.uint8 if depth == 8 else np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", samples, photometric="rgb")
    clipped = PhotoFile(tmp_path / "a.tif").clipped_rows(0, 1)[0]
    np.testing.assert_array_equal(clipped[:, 1], np.arange(256) >= 253)


def test_lzw_tiff_needs_another_library(tmp_path):
    Image.fromarray(patches()).save(tmp_path / "a.tif", compression="tiff_lzw")
    if importlib.util.find_spec("imagecodecs"):
        np.testing.assert_array_equal(
            read_ldr(tmp_path / "a.tif", srgb=False)[0], patches() / np.float32(255)
        )
        return
    with pytest.raises(InputError, match=r"a\.tif is compressed .* pip install imagecodecs, or save"):
        read_ldr(tmp_path / "a.tif")


def test_a_mask_in_a_float_file(tmp_path):
    mask = np.zeros((6, 7), np.float32)
    mask[2:4] = (1.5,)
    write_exr(tmp_path / "m.exr", mask)
    np.testing.assert_array_equal(read_mask(tmp_path / "m.exr"), np.minimum(mask, 1))


def test_grey_profile(tmp_path):
    """A grey profile of gamma 1, made of the three-channel one's description: a curve and no matrix."""
    buffer = io.BytesIO()
    ramp = np.arange(0, 256, 5, dtype=np.uint8)[None].repeat(4, 0)
    Image.fromarray(ramp).save(buffer, "PNG", icc_profile=grey_icc("Straight Grey", 1.0))
    (tmp_path / "a.png").write_bytes(buffer.getvalue())
    color = read_ldr(tmp_path / "a.png")[0]
    np.testing.assert_allclose(color, (ramp / 255)[..., None].repeat(3, 2), atol=1e-6)
