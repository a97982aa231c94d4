import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.imaging import (
    PhotoFile,
    image_size,
    read_alpha,
    read_ldr,
    read_mask,
    srgb_decode,
    srgb_encode,
    write_png,
)

RNG = np.random.default_rng(3)


def png(width, height, *chunks, bits=8, color_type=2, interlace=0):
    """A PNG file from its header values and (kind, content) chunks."""
    header = struct.pack(">IIBBBBB", width, height, bits, color_type, 0, 0, interlace)
    parts = [(b"IHDR", header), *chunks, (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in parts
    )


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("with_alpha", [False, True])
def test_png_round_trip_is_within_half_a_step(tmp_path, bits, with_alpha):
    color = RNG.random((21, 34, 3))
    alpha = RNG.random((21, 34)) if with_alpha else None
    write_png(tmp_path / "a.png", color, alpha, bits=bits)
    read, read_alpha_channel = read_ldr(tmp_path / "a.png")
    half_step = 0.51 / (2**bits - 1)
    assert read.dtype == np.float32
    assert np.abs(srgb_encode(read) - srgb_encode(color)).max() < half_step
    if with_alpha:
        assert np.abs(read_alpha_channel - alpha).max() < half_step
    else:
        assert read_alpha_channel is None


def test_linear_maps_are_neither_encoded_nor_decoded(tmp_path):
    color = np.full((4, 5, 3), 0.25)
    write_png(tmp_path / "a.png", color, srgb=False)
    assert np.asarray(Image.open(tmp_path / "a.png")).max() == 64
    np.testing.assert_allclose(read_ldr(tmp_path / "a.png", srgb=False)[0], 64 / 255, rtol=1e-6)


def test_clipping_and_nan(tmp_path):
    color = np.array([[[-1, 0.5, 3], [np.nan, 0, 1]]])
    write_png(tmp_path / "a.png", color)
    read, _ = read_ldr(tmp_path / "a.png")
    np.testing.assert_allclose(read, [[[0, srgb_decode(188 / 255), 1], [0, 0, 1]]], rtol=1e-6)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
@pytest.mark.parametrize("interlace", [0, 1])
def test_sixteen_bit_png_with_every_filter(tmp_path, channels, interlace):
    """Each row of each pass uses another of the five filters; the reader must give back the very samples."""
    pixels = RNG.integers(0, 65536, (13, 11, channels), dtype=np.uint16)
    pixels[:, :7] = (
        RNG.integers(0, 4, (13, 7, channels)) * 257
    )  # few levels: ties between the Paeth filter's choices
    adam7 = [(0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2)]
    passes = [pixels[y::dy, x::dx] for x, y, dx, dy in adam7] if interlace else [pixels]
    raw = b"".join(filter_rows(part) for part in passes if part.size)
    color_type = {1: 0, 2: 4, 3: 2, 4: 6}[channels]
    data = png(11, 13, (b"IDAT", zlib.compress(raw)), bits=16, color_type=color_type, interlace=interlace)
    (tmp_path / "a.png").write_bytes(data)
    color, alpha = read_ldr(tmp_path / "a.png", srgb=False)
    expected = pixels / np.float32(65535)
    colors = expected[..., : channels - 1] if channels in (2, 4) else expected
    np.testing.assert_allclose(color, np.broadcast_to(colors, color.shape), atol=1e-7)
    if channels in (2, 4):
        np.testing.assert_allclose(alpha, expected[..., -1], atol=1e-7)


def filter_rows(part):
    """Filter the rows of (h, w, C) uint16 with types 0, 1, 2, 3, 4 in turn, straight from the PNG
    specification.
    """
    rows = part.astype(">u2").view(np.uint8).reshape(part.shape[0], -1).astype(int)
    step, out = part.shape[2] * 2, b""
    for y, row in enumerate(rows):
        left = np.concatenate([np.zeros(step, int), row[:-step]])
        up = rows[y - 1] if y else np.zeros_like(row)
        corner = np.concatenate([np.zeros(step, int), up[:-step]])
        p = left + up - corner
        paeth = np.where(
            (abs(p - left) <= abs(p - up)) & (abs(p - left) <= abs(p - corner)),
            left,
            np.where(abs(p - up) <= abs(p - corner), up, corner),
        )
        predicted = [0 * row, left, up, (left + up) // 2, paeth][y % 5]
        out += bytes([y % 5]) + ((row - predicted) % 256).astype(np.uint8).tobytes()
    return out


def test_sixteen_bit_transparent_colour(tmp_path):
    pixels = np.array([[[1, 2, 3], [4, 5, 6]]], np.uint16)
    raw = b"\0" + pixels.astype(">u2").tobytes()
    key = np.array([4, 5, 6], ">u2").tobytes()
    (tmp_path / "a.png").write_bytes(png(2, 1, (b"tRNS", key), (b"IDAT", zlib.compress(raw)), bits=16))
    np.testing.assert_array_equal(read_ldr(tmp_path / "a.png")[1], [[1, 0]])


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA", "CMYK"])
def test_every_mode_becomes_rgb(tmp_path, mode):
    image = Image.new("RGB", (8, 8), (255, 255, 255)).convert(mode)
    path = tmp_path / ("a.jpg" if mode == "CMYK" else "a.png")
    image.save(path)
    color, alpha = read_ldr(path)
    np.testing.assert_allclose(color, np.ones((8, 8, 3)), atol=1e-6)
    assert (alpha is not None) == (mode in ("LA", "RGBA"))


def test_palette_transparency_is_alpha(tmp_path):
    image = Image.new("P", (4, 4), 0)
    image.putpalette([255, 0, 0, 0, 255, 0])
    image.putpixel((1, 2), 1)
    image.save(tmp_path / "a.png", transparency=0)
    alpha = read_alpha(tmp_path / "a.png")
    assert alpha.sum() == 1
    assert alpha[2, 1] == 1


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("bits", [8, 16])
def test_exif_orientation(tmp_path, orientation, bits):
    """The stored picture is made from the upright one by Pillow's own inverse transposition."""
    upright = np.zeros((6, 9, 3), np.uint8)
    upright[0, 0], upright[0, -1], upright[-1, 0] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    inverse = {2: 0, 3: 3, 4: 1, 5: 5, 6: 2, 7: 6, 8: 4}  # FLIP_LEFT_RIGHT, ROTATE_180, ..., by EXIF value
    image = Image.fromarray(upright)
    if orientation > 1:
        image = image.transpose(Image.Transpose(inverse[orientation]))
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / "a.png"
    if bits == 8:
        image.save(path, exif=exif)
    else:
        raw = b"".join(b"\0" + (row.astype(">u2") * 257).tobytes() for row in np.asarray(image))
        data = zlib.compress(raw)
        # EXIF behind the pixels is allowed too.
        path.write_bytes(png(*image.size, (b"IDAT", data), (b"eXIf", exif.tobytes()[6:]), bits=16))
    np.testing.assert_array_equal(read_ldr(path)[0], upright / 255)
    assert image_size(path) == (9, 6)
    assert image_size(path, orient=False) == image.size
    assert read_ldr(path, orient=False)[0].shape[1::-1] == image.size


def test_masks(tmp_path):
    mask = np.zeros((6, 7), np.uint8)
    mask[2:4, 3:5] = (128, 255)
    Image.fromarray(mask).save(tmp_path / "grey.png")
    Image.fromarray(np.dstack([mask] * 3)).save(tmp_path / "rgb.png")
    Image.fromarray(np.dstack([np.full_like(mask, 255)] * 3 + [mask])).save(tmp_path / "cutout.png")
    Image.fromarray(np.dstack([mask] * 3 + [np.full_like(mask, 255)])).save(tmp_path / "opaque.png")
    Image.fromarray(mask.astype(np.uint16) * 257).save(tmp_path / "deep.png")
    for name in ("grey", "rgb", "cutout", "opaque", "deep"):
        np.testing.assert_allclose(read_mask(tmp_path / f"{name}.png"), mask / 255, atol=1e-7, err_msg=name)


def test_huge_header_is_refused_before_decoding(tmp_path):
    (tmp_path / "huge.png").write_bytes(png(60000, 60000, (b"IDAT", zlib.compress(b"\0" * 100))))
    for read in (read_ldr, read_mask, read_alpha, image_size):
        with pytest.raises(InputError, match=r"huge\.png announces 60000 x 60000 pixels"):
            read(tmp_path / "huge.png")


def webp(kind, width, height):
    """The start of a WebP file, by RFC 9649; what follows does not matter to who looks at the size."""
    body = {
        b"VP8X": bytes(4) + (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little"),
        b"VP8L": b"\x2f" + (width - 1 | height - 1 << 14).to_bytes(4, "little") + bytes(20),
        b"VP8 ": bytes(3) + b"\x9d\x01\x2a" + struct.pack("<HH", width, height) + bytes(20),
    }[kind]
    content = b"WEBP" + kind + struct.pack("<I", len(body)) + body
    return b"RIFF" + struct.pack("<I", len(content)) + content


@pytest.mark.parametrize("kind", [b"VP8X", b"VP8L", b"VP8 "])
@pytest.mark.parametrize("size", [(13400, 13400), (12000, 12000)])
def test_large_webp_is_refused_before_decoding(tmp_path, kind, size):
    (tmp_path / "large.webp").write_bytes(webp(kind, *size))
    for read in (read_ldr, read_mask, image_size):
        with pytest.raises(InputError, match=rf"large\.webp announces {size[0]} x {size[1]} pixels"):
            read(tmp_path / "large.webp")


@pytest.mark.parametrize(
    "options", [{"lossless": True}, {"quality": 80}, {"quality": 80, "exif": b"Exif\0\0"}]
)
def test_webp_of_every_kind_is_read(tmp_path, options):
    Image.new("RGB", (30, 20), (255, 0, 0)).save(tmp_path / "a.webp", **options)
    assert image_size(tmp_path / "a.webp") == (30, 20)
    assert read_ldr(tmp_path / "a.webp")[0].shape == (20, 30, 3)


@pytest.mark.parametrize("mode", ["L", "LA", "RGB", "RGBA", "deep"])
def test_rows_are_those_of_the_whole(tmp_path, mode):
    path = tmp_path / "a.png"
    if mode == "deep":
        write_png(path, RNG.random((23, 9, 3)), RNG.random((23, 9)), bits=16)
    else:
        channels = len(mode)
        samples = RNG.integers(0, 256, (23, 9, channels), dtype=np.uint8)
        Image.fromarray(samples.squeeze(), mode).save(path)
    color, alpha = read_ldr(path)
    image = PhotoFile(path)
    parts = [image.rows(first, min(first + 5, 23)) for first in range(0, 23, 5)]
    np.testing.assert_array_equal(np.concatenate([part for part, _ in parts]), color)
    assert image.has_alpha == (alpha is not None)
    if alpha is not None:
        np.testing.assert_array_equal(np.concatenate([part for _, part in parts]), alpha)
    np.testing.assert_array_equal(image.mask_rows(3, 11), read_mask(path)[3:11])


def test_damaged_sixteen_bit_pixels(tmp_path):
    for raw, word in ((b"\x07" + bytes(12), "row filter"), (bytes(7), "bytes of pixels")):
        (tmp_path / "a.png").write_bytes(png(2, 1, (b"IDAT", zlib.compress(raw)), bits=16))
        with pytest.raises(InputError, match=word):
            read_ldr(tmp_path / "a.png")


def test_wrong_kind_and_missing(tmp_path):
    (tmp_path / "a.png").write_bytes(b"GIF89a" + bytes(20))
    with pytest.raises(InputError, match=r"a\.png is a GIF image, which is not read"):
        read_ldr(tmp_path / "a.png")
    with pytest.raises(InputError, match=r"none\.png does not exist"):
        read_ldr(tmp_path / "none.png")
    with pytest.raises(InputError, match="cannot be read"):
        read_ldr(tmp_path)


def test_content_decides_not_the_suffix(tmp_path):
    buffer = io.BytesIO()
    Image.new("RGB", (8, 4), (255, 0, 0)).save(buffer, "JPEG")
    (tmp_path / "a.png").write_bytes(buffer.getvalue())
    assert read_ldr(tmp_path / "a.png")[0].shape == (4, 8, 3)
