"""ICC profiles, for photos in encodings other than sRGB."""

import struct

from PIL import ImageCms

SRGB_PRIMARIES = ((0.4360, 0.2225, 0.0139), (0.3851, 0.7169, 0.0971), (0.1431, 0.0606, 0.7141))
P3_PRIMARIES = ((0.5151, 0.2412, -0.0011), (0.2920, 0.6922, 0.0419), (0.1571, 0.0666, 0.7841))


def fixed(*values):
    return b"".join(struct.pack(">i", round(value * 65536)) for value in values)


def gamma_curve(gamma):
    return b"curv" + bytes(4) + struct.pack(">IH", 1, round(gamma * 256)) + bytes(2)


def profile_of(name, space, tags):
    """A profile of version 2 (ICC.1:2001-04) with the given tags, written from the format's description."""
    text = name.encode() + b"\0"
    tags = {
        b"desc": b"desc" + bytes(4) + struct.pack(">I", len(text)) + text + bytes(78),
        b"wtpt": b"XYZ " + bytes(4) + fixed(0.9642, 1.0, 0.8249),
        **tags,
    }
    table, body, start = struct.pack(">I", len(tags)), b"", 128 + 4 + 12 * len(tags)
    for kind, content in tags.items():
        table += kind + struct.pack(">II", start + len(body), len(content))
        body += content + bytes(-len(content) % 4)
    head = struct.pack(
        ">I4sI4s4s4s12s4s",
        start + len(body),
        bytes(4),
        0x02100000,
        b"mntr",
        space,
        b"XYZ ",
        struct.pack(">6H", 2026, 1, 1, 0, 0, 0),
        b"acsp",
    )
    return head.ljust(68, b"\0") + fixed(0.9642, 1.0, 0.8249).ljust(60, b"\0") + table + body


def icc(name, primaries, gamma, curve=None):
    """A matrix profile; `curve` is the content of its curves' tags where they are no plain gamma."""
    colorants = {
        c + b"XYZ": b"XYZ " + bytes(4) + fixed(*p) for c, p in zip((b"r", b"g", b"b"), primaries, strict=True)
    }
    curves = {c + b"TRC": curve or gamma_curve(gamma) for c in (b"r", b"g", b"b")}
    return profile_of(name, b"RGB ", {**colorants, **curves})


def grey_icc(name, gamma):
    """A profile for grey."""
    return profile_of(name, b"GRAY", {b"kTRC": gamma_curve(gamma)})


def own_srgb():
    return ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
