"""Maps from anywhere, as a light to render or to export with: their suns and lamps inside or apart."""

import math
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from lightprobe.core.config.prediction import Sun
from lightprobe.core.errors import LightprobeWarning
from lightprobe.export import SceneLight
from lightprobe.export.light_file import is_calibrated, read_sources
from lightprobe.imaging import resize_area
from lightprobe.light.environment import Environment, read_map
from lightprobe.light.files import panorama
from lightprobe.light.sources import LightSource, split_light
from lightprobe.models.calibration import Calibration

_RESOLUTION = 64  # texels along a cubemap edge at which sources are told from the rest
_ROUNDING = 1e-4  # of a texel's radiance: less is no part of a source
_SAME = math.cos(math.radians(10))  # sources nearer to each other are the same one


def whole_light(path: Path, device: torch.device | None = None) -> Environment:
    """Return a map's light with its suns and lamps, onto the CPU without `device`.

    A map that was written without them has them in its .light.json, from which they are put back.
    Raises `InputError` for a map or .light.json that cannot be used.
    """
    light, known = Environment.load(path, device), read_sources(path)
    if known is None or known[1] is Sun.INSIDE:
        return light
    texels = light.texels.clone()
    for source in known[0]:
        texels += source.texels(light.resolution, light.device)
    return Environment(texels)


def tell_of_scale(path: Path, calibration: Calibration | None) -> None:
    """Warn where a map was predicted before a calibration and is used after one, or the other way."""
    predicted = is_calibrated(path)
    if predicted is None or predicted is (calibration is not None):
        return
    known = (
        "without a calibration, and this run has one"
        if calibration
        else "with a calibration, and this run has none"
    )
    warnings.warn(
        f"{path} was predicted {known}: the light and the object are not of one brightness. Predict the map anew.",
        LightprobeWarning,
        stacklevel=3,
    )


def scene_light(path: Path, sun: Sun) -> SceneLight:
    """Return a map's light; its lamps are those that are found in it, as bright as its .light.json says if it
    has them.

    sun: with `Sun.INSIDE` the map keeps them, they are only listed, and there are no lamps. A map that was
    written without its lamps stays so, and they come from its .light.json either way. Raises `InputError` for
    a map or .light.json that cannot be used.
    """
    image = read_map(path)
    known = read_sources(path)
    if known is not None and known[1] is Sun.SEPARATE:
        return SceneLight(image, known[0])
    if sun is Sun.INSIDE and known is not None:
        return SceneLight(image, (), known[0])
    environment = Environment.from_panorama(image, _RESOLUTION)
    split = split_light(environment)
    if sun is Sun.INSIDE or not split.sources:
        return SceneLight(image, (), tuple(split.sources))
    lamps = _as_known(split.sources, () if known is None else known[0])
    return SceneLight(_without_sources(image, environment, split.rest), lamps)


def _as_known(found: Sequence[LightSource], known: Sequence[LightSource]) -> tuple[LightSource, ...]:
    """Return the sources of a .light.json that were found in its map, and those that it does not know.

    What a photo told of a source is nearer to the truth. One that was found as two, or two as one, come as it
    has them.
    """

    def same(one: LightSource, others: Sequence[LightSource]) -> bool:
        return any(float(np.dot(one.direction, other.direction)) > _SAME for other in others)

    return (*(one for one in known if same(one, found)), *(one for one in found if not same(one, known)))


def _without_sources(image: np.ndarray, environment: Environment, rest: Environment) -> np.ndarray:
    """Return a map (H, 2H, 3) that has the colours of `rest` wherever that differs from the whole
    `environment`.

    A source may be a single pixel of the map, far smaller than a texel of either: only replacing all that
    lies in such texels takes all of it out, and what remains there is as smooth as they are.
    """
    size = image.shape[:2]
    taken = (rest.texels < (1 - _ROUNDING) * environment.texels).any(-1, keepdim=True)
    within = resize_area(panorama(taken.float()), *size) > 0
    return np.where(within, resize_area(panorama(rest.texels), *size), image)
