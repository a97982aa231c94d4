"""Which objects there are to photograph, and what each is: its parts and what they are painted with."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from . import dark_shapes
from .dark_paints import CAMERA_PAINTERS, CAR_PAINTERS, LANTERN_PAINTERS
from .geometry import Part, coffee_pot
from .mug import MUG_PAINTERS, mug
from .pebble import PEBBLE_PAINTERS, pebble
from .textures import POT_PAINTERS, POT_TILES, Material, Painters, Tiles, equal_tiles, paint


class Subject(StrEnum):
    """The object of a scene."""

    COFFEE_POT = "coffee-pot"
    TOY_CAR = "toy-car"
    CAMERA = "camera"
    LANTERN = "lantern"
    MUG = "mug"
    PEBBLE = "pebble"


@dataclass(frozen=True)
class Model:
    """An object ready to be photographed."""

    parts: list[Part]
    tiles: Tiles  # where each part's texture square lies in the atlas
    material: Material  # the atlas


_MAKERS: dict[Subject, tuple[Callable[[], list[Part]], Painters]] = {
    Subject.COFFEE_POT: (coffee_pot, POT_PAINTERS),
    Subject.TOY_CAR: (dark_shapes.toy_car, CAR_PAINTERS),
    Subject.CAMERA: (dark_shapes.camera, CAMERA_PAINTERS),
    Subject.LANTERN: (dark_shapes.lantern, LANTERN_PAINTERS),
    Subject.MUG: (mug, MUG_PAINTERS),
    Subject.PEBBLE: (pebble, PEBBLE_PAINTERS),
}

DESCRIPTIONS: dict[Subject, str] = {
    Subject.COFFEE_POT: "A painted coffee pot (glazed and bare ceramic, polished and dull brass, walnut)",
    Subject.TOY_CAR: "A toy car in near-black metallic paint (metallic 0.72 to 0.85, base colours 0.02 to 0.08)",
    Subject.CAMERA: "A camera of near-black matte plastic and leather (dielectric, base colours 0.02 to 0.05)",
    Subject.LANTERN: "A lantern of glossy black (base colours 0.02 to 0.04) beside bright porcelain (0.4 to 0.8)",
    Subject.MUG: "An open mug (green and cream glaze, bare clay)",
    Subject.PEBBLE: "A smooth pebble of one even material (celadon glaze, roughness 0.3)",
}


def make_model(subject: Subject, seed: int) -> Model:
    """Return the object, its textures drawn from `seed`."""
    shape, painters = _MAKERS[subject]
    parts = shape()
    tiles = POT_TILES if subject is Subject.COFFEE_POT else equal_tiles(parts)
    return Model(parts, tiles, paint(parts, tiles, painters, seed))
