"""Photos that telephones, cameras and editing programs write: the colours that were put in come out."""

import io
import struct
import zlib

import imagecodecs
import numpy as np
import pillow_heif
import pytest
import tifffile
from PIL import Image

from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.imaging import (
    foreign_encoding,
    image_size,
    png16,
    read_ldr,
    read_photo,
    srgb_decode,
)
from tests.imaging.gain_files import XMP, iso_metadata, jpeg, segment
from tests.imaging.heif_files import write_avif_with_gain_map, write_heif
from tests.imaging.icc_profiles import P3_PRIMARIES, fixed, icc

RNG = np.random.default_rng(63)
# x y z of primaries in XYZ (D50), curve, and the published matrix to linear sRGB
SRGB_CURVE = (
    b"para" + bytes(4) + struct.pack(">HH", 3, 0) + fixed(2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
)
ADOBE = ((0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457))
SPACES = {
    "Adobe RGB (1998)": (
        icc("Adobe RGB (1998)", ADOBE, 563 / 256),
        lambda encoded: encoded ** (563 / 256),
        [[1.3983, -0.3983, 0], [0, 1, 0], [0, -0.0429, 1.0429]],
    ),
    "Display P3": (
        icc("Display P3", P3_PRIMARIES, 0, SRGB_CURVE),
        srgb_decode,
        [[1.2249, -0.2247, 0], [-0.0420, 1.0419, 0], [-0.0197, -0.0786, 1.0979]],
    ),
}


def patches(levels):
    colors = np.array([[[0.8, 0.3, 0.2], [0.2, 0.6, 0.3]], [[0.25, 0.3, 0.7], [0.5, 0.5, 0.5]]])
    return np.rint(colors.repeat(32, 0).repeat(32, 1) * levels).astype(
        np.uint8 if levels < 256 else np.uint16
    )


def centres(image):
    return image[[16, 16, 48, 48], [16, 48, 16, 48]]


def with_chunks(path, samples, *chunks):
    """A PNG of uint8 or uint16 samples with chunks behind its header."""
    if samples.dtype == np.uint16:
        data = png16.encode(samples)
    else:
        buffer = io.BytesIO()
        Image.fromarray(samples).save(buffer, "PNG")
        data = buffer.getvalue()
    for kind, content in chunks:
        crc = struct.pack(">I", zlib.crc32(kind + content))
        data = data[:33] + struct.pack(">I", len(content)) + kind + content + crc + data[33:]
    path.write_bytes(data)
    return path


def write(path, samples, profile):
    """Write samples in the kind of file that `path` is named after, as close as the kind allows."""
    kind = path.name.partition(".")[2]
    if kind == "png":
        with_chunks(path, samples, (b"iCCP", b"x\0\0" + zlib.compress(profile)))
    elif kind == "tif":
        tifffile.imwrite(path, samples, photometric="rgb", iccprofile=profile)
    elif kind == "heic":
        mode, data = ("RGB;16", samples) if samples.dtype == np.uint16 else ("RGB", samples)
        heif = pillow_heif.from_bytes(mode=mode, size=(64, 64), data=data.tobytes())
        heif.save(path, quality=100, chroma=444, icc_profile=profile)
    else:
        options = {"jpg": {"quality": 100, "subsampling": 0}, "webp": {"lossless": True}}[kind]
        Image.fromarray(samples).save(path, icc_profile=profile, **options)


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize(
    ("kind", "levels", "atol"),
    [
        *(("jpg", 255, 0.006), ("webp", 255, 0.002), ("png", 255, 0.002), ("png", 65535, 5e-4)),
        *(("tif", 255, 0.002), ("tif", 65535, 5e-4), ("heic", 255, 0.012), ("heic", 65535, 0.006)),
    ],
)
def test_profiles_in_every_kind_of_file(tmp_path, space, kind, levels, atol):
    profile, curve, matrix = SPACES[space]
    samples = patches(levels)
    path = tmp_path / f"a.{kind}"
    write(path, samples, profile)
    expected = np.maximum(curve(centres(samples) / levels) @ np.array(matrix).T, 0)
    np.testing.assert_allclose(centres(read_ldr(path)[0]), expected, atol=atol)
    assert foreign_encoding(path) == f"ICC profile {space}"


@pytest.mark.parametrize("levels", [255, 65535])
@pytest.mark.parametrize(
    ("points", "code", "light"),
    [
        ((1, 16), 0.5081, 100 / 203),  # PQ (ST 2084): codes of 100 and 1000 cd/m2, white being 203
        ((9, 16), 0.7518, 1000 / 203),
        ((12, 16), 0.7518, 1000 / 203),
        ((9, 18), 0.75, 1.0),  # HLG (BT.2100): .265 of the peak
        ((9, 18), 1.0, 1 / 0.265),
        ((12, 18), 0.5, 1 / 12 / 0.265),
    ],
)
def test_code_points_of_png(tmp_path, points, code, light, levels):
    samples = np.full((8, 8, 3), round(code * levels), np.uint8 if levels == 255 else np.uint16)
    path = with_chunks(tmp_path / "a.png", samples, (b"cICP", bytes([*points, 0, 1])))
    np.testing.assert_allclose(read_ldr(path)[0], light, rtol=0.025 if levels == 255 else 0.003)


def test_red_of_wide_code_points(tmp_path):
    """BT.2020's red is 1.66 of sRGB's, and what is negative of the others is cut."""
    samples = np.zeros((8, 8, 3), np.uint16)
    samples[..., 0] = round(0.75 * 65535)
    path = with_chunks(tmp_path / "a.png", samples, (b"cICP", bytes([9, 18, 0, 1])))
    np.testing.assert_allclose(read_ldr(path)[0][4, 4], [1.6605, 0, 0], atol=1e-3)


@pytest.mark.parametrize(("transfer", "code", "light"), [(18, 1.0, 1 / 0.265), (16, 0.7518, 1000 / 203)])
def test_code_points_of_heic(tmp_path, transfer, code, light):
    samples = np.full((64, 64, 3), round(code * 65535), np.uint16)
    heif = pillow_heif.from_bytes(mode="RGB;16", size=(64, 64), data=samples.tobytes())
    told = {"color_primaries": 9, "transfer_characteristics": transfer}
    heif.save(tmp_path / "a.heic", quality=100, chroma=444, **told)
    np.testing.assert_allclose(read_ldr(tmp_path / "a.heic")[0], light, rtol=0.03)


@pytest.mark.parametrize("bits", [8, 10, 12])
@pytest.mark.parametrize(("transfer", "code", "light"), [(18, 1.0, 1 / 0.265), (16, 0.7518, 1000 / 203)])
def test_code_points_of_avif(tmp_path, transfer, code, light, bits):
    """Its samples are read as 8 bits, of which a step of PQ is 4 %."""
    levels = 2**bits - 1
    samples = np.full((64, 64, 3), round(code * levels), np.uint8 if bits == 8 else np.uint16)
    told = {"primaries": 9, "transfer": transfer, "matrix": 9}
    data = imagecodecs.avif_encode(samples, level=100, bitspersample=bits, **told)
    (tmp_path / "a.avif").write_bytes(data)
    np.testing.assert_allclose(read_ldr(tmp_path / "a.avif")[0], light, rtol=0.04)


def test_a_gain_map_in_avif_is_said_to_be_left_aside(tmp_path):
    path = tmp_path / "a.avif"
    white = np.full((64, 64, 3), 255, np.uint8)
    write_avif_with_gain_map(path, white, white // 2, iso_metadata([(0.0, 3.0, 1.0, 0.0, 0.0)]))
    with pytest.warns(LightprobeWarning, match=r"a\.avif has a gain map that is not read \(in AVIF\)"):
        assert read_photo(path)[2].all()


def test_inks_without_a_profile(tmp_path):
    """Paper under ideal inks; the name says that this is a guess. Adobe's files hold what is left of white."""
    samples = np.full((16, 16, 4), (51, 102, 153, 0), np.uint8)
    Image.fromarray(samples, "CMYK").save(tmp_path / "a.jpg", quality=100)
    expected = srgb_decode(1 - np.array([51, 102, 153]) / 255)
    np.testing.assert_allclose(
        read_ldr(tmp_path / "a.jpg")[0], np.broadcast_to(expected, (16, 16, 3)), atol=0.01
    )
    assert foreign_encoding(tmp_path / "a.jpg") == "CMYK without a profile"


def test_deep_grey_and_palettes(tmp_path):
    grey = np.full((8, 8, 1), 30000, np.uint16)
    (tmp_path / "grey.png").write_bytes(png16.encode(grey))
    np.testing.assert_allclose(
        read_ldr(tmp_path / "grey.png")[0], srgb_decode(np.array(30000 / 65535)), atol=1e-5
    )
    palette = Image.fromarray(patches(255)).quantize(4)
    palette.save(tmp_path / "a.png")
    expected = srgb_decode(np.asarray(palette.convert("RGB")) / 255)
    np.testing.assert_allclose(read_ldr(tmp_path / "a.png")[0], expected, atol=1e-6)


@pytest.mark.parametrize("suffix", ["webp", "png", "avif", "mpo"])
def test_the_first_of_several_pictures(tmp_path, suffix):
    first, second = Image.new("RGB", (32, 32), (200, 120, 60)), Image.new("RGB", (32, 32), (0, 0, 255))
    path = tmp_path / f"a.{suffix}"
    options = {"webp": {"lossless": True}, "png": {}}.get(suffix, {"quality": 100})
    first.save(path, save_all=True, append_images=[second], **options)
    expected = srgb_decode(np.array([200, 120, 60]) / 255)
    np.testing.assert_allclose(read_ldr(path)[0], np.broadcast_to(expected, (32, 32, 3)), atol=0.012)


def test_a_jpeg_with_something_behind_it_and_one_without_its_end(tmp_path):
    """Behind a motion photo lies its video; a card that was pulled out too early leaves a stump."""
    samples = RNG.integers(0, 256, (64, 64, 3), dtype=np.uint8)
    data, path = jpeg(samples), tmp_path / "a.jpg"
    path.write_bytes(data)
    whole = read_ldr(path)[0]
    path.write_bytes(data + b"\0\0\0\x18ftypmp42" + bytes(400))
    np.testing.assert_array_equal(read_ldr(path)[0], whole)
    for length in (len(data) - 2, len(data) * 9 // 10, len(data) // 2):
        path.write_bytes(data[:length])
        with pytest.raises(InputError, match=r"a\.jpg cannot be decoded .* cut short: copy it again\.$"):
            read_ldr(path)


@pytest.mark.parametrize("kind", ["equirectangular", "cylindrical"])
@pytest.mark.parametrize(
    "form", ['GPano:ProjectionType="{}"', "<GPano:ProjectionType>{}</GPano:ProjectionType>"]
)
def test_panoramas_are_refused(tmp_path, kind, form):
    xmp = form.format(kind).encode()
    path = tmp_path / "a.jpg"
    path.write_bytes(jpeg(np.zeros((32, 64, 3), np.uint8), segment(1, XMP + xmp)))
    text = rf"a\.jpg is a panorama \({kind}\), which no camera model fits; use ordinary photos"
    for read in (read_ldr, image_size, foreign_encoding):
        with pytest.raises(InputError, match=text):
            read(path)
    path.write_bytes(
        jpeg(np.zeros((32, 64, 3), np.uint8), segment(1, XMP + b'GPano:ProjectionType="perspective"'))
    )
    assert image_size(path) == (64, 32)


@pytest.mark.parametrize(("value", "is_refused"), [(6, True), (0, False), (2, False), (8, False)])
def test_panoramas_of_apples_telephones(tmp_path, value, is_refused):
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA401] = value
    Image.new("RGB", (64, 16)).save(tmp_path / "a.jpg", exif=exif)
    write_heif(tmp_path / "a.heic", np.zeros((64, 128, 3), np.uint8), exif=exif.tobytes())
    for name in ("a.jpg", "a.heic"):
        if not is_refused:
            assert image_size(tmp_path / name)[0] in (64, 128)
            continue
        with pytest.raises(InputError, match=rf"{name} is a panorama \(stitched\)"):
            image_size(tmp_path / name)


def test_straight_alpha_of_every_kind_is_not_divided(tmp_path):
    samples = np.dstack([patches(255), np.full((64, 64), 128, np.uint8)])
    for suffix, options in (("png", {}), ("webp", {"lossless": True}), ("tif", {})):
        path = tmp_path / f"a.{suffix}"
        Image.fromarray(samples).save(path, **options)
        color, alpha, clipped = read_photo(path)
        np.testing.assert_allclose(color, srgb_decode(samples[..., :3] / 255), atol=1e-5)
        np.testing.assert_allclose(alpha, 128 / 255, atol=1e-6)
        assert not clipped.any()
