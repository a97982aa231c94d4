"""Objects to photograph, by name: nine designs, and random ones, another for every seed."""

from collections.abc import Callable

import numpy as np

from .designs import can, duck, engine, helmet, radio, statuette, tankard, trolley, urn
from .models import Part, normalised
from .random_object import random_object

OBJECTS: dict[str, Callable[[np.random.Generator], list[Part]]] = {
    "radio": radio,
    "urn": urn,
    "trolley": trolley,
    "random": random_object,
    "statuette": statuette,
    "engine": engine,
    "tankard": tankard,
    "helmet": helmet,
    "can": can,
    "duck": duck,
}


def make_object(name: str, seed: int) -> list[Part]:
    """Return the parts of an object of `OBJECTS`, radius 1 about the origin, its materials drawn from a seed."""
    return normalised(OBJECTS[name](np.random.default_rng([seed, 1, list(OBJECTS).index(name)])))
