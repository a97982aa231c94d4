"""Colour encodings other than sRGB are named; sRGB under any name is not."""

import io
import struct

import numpy as np
import pytest
from PIL import Image, ImageCms

from lightprobe.imaging import foreign_encoding

SRGB_PRIMARIES = ((0.4360, 0.2225, 0.0139), (0.3851, 0.7169, 0.0971), (0.1431, 0.0606, 0.7141))
P3_PRIMARIES = ((0.5151, 0.2412, -0.0011), (0.2920, 0.6922, 0.0419), (0.1571, 0.0666, 0.7841))


def icc(name, primaries, gamma):
    """A matrix profile of version 2 (ICC.1:2001-04), written from the format's description."""

    def fixed(*values):
        return b"".join(struct.pack(">i", round(value * 65536)) for value in values)

    text = name.encode() + b"\0"
    curve = b"curv" + bytes(4) + struct.pack(">IH", 1, round(gamma * 256)) + bytes(2)
    tags = {b"desc": b"desc" + bytes(4) + struct.pack(">I", len(text)) + text + bytes(78),
            b"wtpt": b"XYZ " + bytes(4) + fixed(0.9642, 1.0, 0.8249),
            **{c + b"XYZ": b"XYZ " + bytes(4) + fixed(*p) for c, p in zip((b"r", b"g", b"b"), primaries, strict=True)},
            **{c + b"TRC": curve for c in (b"r", b"g", b"b")}}  # fmt: skip
    table, body, start = struct.pack(">I", len(tags)), b"", 128 + 4 + 12 * len(tags)
    for kind, content in tags.items():
        table += kind + struct.pack(">II", start + len(body), len(content))
        body += content + bytes(-len(content) % 4)
    head = struct.pack(">I4sI4s4s4s12s4s", start + len(body), bytes(4), 0x02100000, b"mntr", b"RGB ", b"XYZ ",
                       struct.pack(">6H", 2026, 1, 1, 0, 0, 0), b"acsp")  # fmt: skip
    return head.ljust(68, b"\0") + fixed(0.9642, 1.0, 0.8249).ljust(60, b"\0") + table + body


def own_srgb():
    return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


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
    [(45455, False, None), (100000, False, "PNG gamma 1"), (55556, False, "PNG gamma 0.5556"), (100000, True, None)],
)
def test_png_gamma(tmp_path, image, gamma, srgb, expected):
    """The standard's own value means sRGB, and an sRGB chunk overrides any."""
    import zlib

    buffer = io.BytesIO()
    image.save(buffer, "PNG")
    data = buffer.getvalue()
    for kind, content in ((b"sRGB", b"\0"), (b"gAMA", struct.pack(">I", gamma)))[not srgb :]:
        chunk = struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
        data = data[:33] + chunk + data[33:]
    (tmp_path / "a.png").write_bytes(data)
    assert foreign_encoding(tmp_path / "a.png") == expected
