"""HEIF files that no library at hand writes: pictures that are turned by the format, and auxiliary pictures.

Coded pictures come from pillow-heif; the boxes around them are written anew (ISO 14496-12, ISO/IEC 23008-12).
"""

import io
import struct

import pillow_heif
from PIL import Image

APPLE_GAIN_MAP = "urn:com:apple:photo:2020:aux:hdrgainmap"


def box(kind, *content):
    data = b"".join(content)
    return struct.pack(">I4s", 8 + len(data), kind) + data


def full(kind, *content, version=0, flags=0):
    return box(kind, struct.pack(">I", version << 24 | flags), *content)


def boxes(data):
    """The boxes in `data` by kind; of several of one kind the last."""
    found, at = {}, 0
    while at + 8 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        found[kind] = data[at + 8 : at + length]
        at += length
    return found


def coded(samples):
    """The configuration (hvcC) and the coded bytes of a picture (H, W) or (H, W, 3) uint8."""
    buffer = io.BytesIO()
    pillow_heif.from_pillow(Image.fromarray(samples)).save(buffer, quality=100, chroma=444)
    data = buffer.getvalue()
    top = boxes(data)
    properties = boxes(boxes(boxes(top[b"meta"][4:])[b"iprp"])[b"ipco"])
    return properties[b"hvcC"], top[b"mdat"]


def write_heif(
    path, picture, *, auxiliary=None, kind=APPLE_GAIN_MAP, turns=(), exif=None, brands=b"mif1heic"
):
    """Write `picture` (H, W, 3) uint8, with an `auxiliary` (h, w) one of a kind, turned by boxes of `turns`.

    turns: property boxes of the picture, `irot` and `imir`, in the order in which they are followed.
    """
    pictures = [picture] if auxiliary is None else [picture, auxiliary]
    properties, items, payloads, used = [], [], [], []
    for number, samples in enumerate(pictures, 1):
        configuration, data = coded(samples)
        own = [
            box(b"hvcC", configuration),
            full(b"ispe", struct.pack(">II", samples.shape[1], samples.shape[0])),
            *(turns if number == 1 else [full(b"auxC", kind.encode() + b"\0")]),
        ]
        used.append([len(properties) + k for k in range(1, 1 + len(own))])
        properties += own
        items.append((number, b"hvc1", 0 if number == 1 else 1))
        payloads.append(data)
    links = []
    if auxiliary is not None:
        links.append(box(b"auxl", struct.pack(">HHH", 2, 1, 1)))
    if exif is not None:
        items.append((3, b"Exif", 1))
        payloads.append(struct.pack(">I", 6) + exif)
        links.append(box(b"cdsc", struct.pack(">HHH", 3, 1, 1)))
    _write(path, brands, items, payloads, properties, used, links)
    return path


def write_avif_with_gain_map(path, picture, second, metadata):
    """Write an AVIF of `picture` (H, W, 3) with `second` (H, W, 3) as its gain map, by a `tmap` item.

    metadata: those of ISO 21496-1.
    """
    properties, used, payloads = [], [], []
    for samples in (picture, second):
        buffer = io.BytesIO()
        Image.fromarray(samples).save(buffer, "AVIF", quality=100)
        top = boxes(buffer.getvalue())
        configuration = boxes(boxes(boxes(top[b"meta"][4:])[b"iprp"])[b"ipco"])[b"av1C"]
        size = full(b"ispe", struct.pack(">II", samples.shape[1], samples.shape[0]))
        own = [box(b"av1C", configuration), size, full(b"pixi", b"\3\x08\x08\x08")]
        used.append([len(properties) + k for k in range(1, 1 + len(own))])
        properties += own
        payloads.append(top[b"mdat"])
    used.append([2, 3, len(properties) + 1])  # as large and deep as the picture, in its colours
    properties.append(box(b"colr", b"nclx" + struct.pack(">HHHB", 12, 16, 0, 0x80)))
    items = [(1, b"av01", 0), (2, b"av01", 1), (3, b"tmap", 0)]
    links = [box(b"dimg", struct.pack(">HHHH", 3, 2, 1, 2))]
    group = box(b"grpl", full(b"altr", struct.pack(">IIII", 9, 2, 3, 1)))
    brands = b"avifmif1miaftmap"
    _write(path, brands, items, [*payloads, b"\0" + metadata], properties, used, links, group)
    return path


def _write(path, brands, items, payloads, properties, used, links, *groups):
    infos = [
        full(b"infe", struct.pack(">HH4s", number, 0, kind) + b"\0", version=2, flags=hidden)
        for number, kind, hidden in items
    ]
    associations = b"".join(
        struct.pack(">HB", number, len(own)) + bytes(0x80 | k for k in own)
        for number, own in enumerate(used, 1)
    )

    def meta(start):
        places, at = b"", start
        for (number, _, _), data in zip(items, payloads, strict=True):
            places += struct.pack(">HHHII", number, 0, 1, at, len(data))
            at += len(data)
        return full(
            b"meta",
            full(b"hdlr", bytes(4) + b"pict" + bytes(13)),
            full(b"pitm", struct.pack(">H", 1)),
            full(b"iloc", bytes([0x44, 0]) + struct.pack(">H", len(items)) + places),
            full(b"iinf", struct.pack(">H", len(items)), *infos),
            box(
                b"iprp",
                box(b"ipco", *properties),
                full(b"ipma", struct.pack(">I", len(used)) + associations),
            ),
            *([full(b"iref", *links)] if links else []),
            *groups,
        )

    head = box(b"ftyp", brands[:4], bytes(4), brands)
    start = len(head) + len(meta(0)) + 8
    path.write_bytes(head + meta(start) + box(b"mdat", *payloads))
