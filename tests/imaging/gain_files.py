"""JPEGs with a gain map behind the picture, written from the formats' descriptions."""

import io
import struct

from PIL import Image

ISO = b"urn:iso:std:iso:ts:21496:-1\0"
XMP = b"http://ns.adobe.com/xap/1.0/\0"
HDRGM = "http://ns.adobe.com/hdr-gain-map/1.0/"
RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"


def segment(number, content):
    return b"\xff" + bytes([0xE0 + number]) + struct.pack(">H", 2 + len(content)) + content


def jpeg(samples, *segments, **options):
    """A JPEG of samples (H, W) or (H, W, 3) uint8 with segments behind its start."""
    buffer = io.BytesIO()
    Image.fromarray(samples).save(buffer, "JPEG", quality=100, subsampling=0, **options)
    data = buffer.getvalue()
    return data[:2] + b"".join(segments) + data[2:]


def iso_metadata(channels, headrooms=(0.0, 3.0), *, base_colors=True, common=False, version=0):
    """ISO 21496-1's metadata; channels: (min, max, gamma, base offset, offset) of each."""
    flags = 0x80 * (len(channels) == 3) | 0x40 * base_colors | 0x08 * common
    data = struct.pack(">HHB", version, 0, flags)
    kinds, values = "II" + "iiIii" * len(channels), [*headrooms, *(v for row in channels for v in row)]
    if common:
        return data + struct.pack(">I" + kinds, 2**16, *(round(v * 2**16) for v in values))
    pairs = [struct.pack(f">{kind}I", round(v * 2**16), 2**16) for kind, v in zip(kinds, values, strict=True)]
    return data + b"".join(pairs)


def xmp_metadata(attributes="", elements=""):
    """XMP of a gain map, its numbers as attributes (`hdrgm:GainMapMax="2"`) or as elements."""
    return (
        f'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="{RDF}"><rdf:Description rdf:about="" '
        f'xmlns:hdrgm="{HDRGM}" hdrgm:Version="1.0" {attributes}>{elements}</rdf:Description></rdf:RDF></x:xmpmeta>'
    ).encode()


def write_gain_jpeg(path, picture, second, *, iso=None, xmp=None, icc=None, indexed=True, **options):
    """Write a JPEG of `picture` and behind it `second`, both uint8, with the metadata in the latter.

    icc: profile of the second one; options: Pillow's of the first one, as `exif`; indexed: with an index.
    """
    told = [segment(2, ISO + iso)] if iso is not None else []
    told += [segment(1, XMP + xmp)] if xmp is not None else []
    behind = jpeg(second, *told, **({} if icc is None else {"icc_profile": icc}))
    first = [segment(2, ISO + bytes(4))] if iso is not None else []
    first += [segment(1, XMP + xmp_metadata())] if xmp is not None else []

    def index(size, start):
        entries = struct.pack(">IIIHH", 0x30000, size, 0, 0, 0)
        entries += struct.pack(">IIIHH", 0, len(behind), start, 0, 0)
        tags = struct.pack(">HHI4s", 0xB000, 7, 4, b"0100") + struct.pack(">HHII", 0xB001, 4, 1, 2)
        tags += struct.pack(">HHII", 0xB002, 7, 32, 50)
        return segment(2, b"MPF\0MM\0*" + struct.pack(">IH", 8, 3) + tags + bytes(4) + entries)

    if not indexed:
        path.write_bytes(jpeg(picture, *first, **options) + behind)
        return path
    whole = len(jpeg(picture, index(0, 0), *first, **options))
    # Offsets count from the index' own byte order mark: behind the start, the segment's head and its name
    path.write_bytes(jpeg(picture, index(whole, whole - 10), *first, **options) + behind)
    return path
