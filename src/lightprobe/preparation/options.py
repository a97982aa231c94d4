"""What may be told to the preparation of plain photos."""

from dataclasses import dataclass
from enum import StrEnum


class Masker(StrEnum):
    """Where masks come from that the user does not give."""

    GRAPH_CUT = "graph-cut"
    """Colours of each photo and the visual hull of all: needs nothing but the photos."""
    REMBG = "rembg"
    """The package rembg with a model of its own, both installed by you; the hull checks its masks."""


@dataclass(frozen=True)
class PrepareOptions:
    """Options of `lightprobe prepare`."""

    hint: str | None = None
    """The object in one photo: PHOTO=MASK.png, or PHOTO=x0,y0,x1,y1 with a box in its pixels."""
    up: str | None = None
    """Which way is up, x,y,z in the axes of the photo named by --up-photo (x right, y up, z to the viewer)."""
    up_photo: str | None = None
    """A photo that was taken level: its vertical axis is up, or --up is given in its axes."""
    height: float | None = None
    """The object's height, in the unit that the scene is to have."""
    masker: Masker = Masker.GRAPH_CUT
    """What cuts the object out of photos without masks."""
    seed: int = 0
    """Equal seeds give equal scenes."""
