"""The colours of an AVIF file that has no ICC profile: code points in its boxes (ISO/IEC 23008-12, 6.5.5)."""

import struct
from collections.abc import Iterator
from pathlib import Path

from lightprobe.core.reading import BoundedFile
from lightprobe.imaging.encodings import SRGB, Encoding, coded

_PATH = (b"meta", b"iprp", b"ipco")  # boxes within each other that hold what is said of pictures
_FULL = {b"meta"}  # boxes whose content begins with a version and flags
_MOST = 2**20  # bytes of boxes that say something: headers are a few hundred


def avif_encoding(path: Path) -> Encoding:
    """Return the encoding that the first code points of a file name, sRGB where there are none."""
    with BoundedFile(path) as file:
        head = file.read(_MOST)
    content = memoryview(head)
    for wanted in _PATH:
        found = next((box for kind, box in _boxes(content) if kind == wanted), None)
        if found is None:
            return SRGB
        content = found[4:] if wanted in _FULL else found
    for kind, box in _boxes(content):
        if kind == b"colr" and bytes(box[:4]) == b"nclx" and len(box) >= 8:
            return coded(*struct.unpack(">HH", box[4:8]))
    return SRGB


def _boxes(content: memoryview) -> Iterator[tuple[bytes, memoryview]]:
    """Yield kind and content of each box in turn; one that is cut off or says what cannot be ends it."""
    at = 0
    while at + 8 <= len(content):
        size, begin = int.from_bytes(content[at : at + 4], "big"), at + 8
        if size == 1:
            size, begin = int.from_bytes(content[begin : begin + 8], "big"), begin + 8
        end = len(content) if size == 0 else at + size
        if end < begin:
            return
        yield bytes(content[at + 4 : at + 8]), content[begin:end]
        at = end
