"""Maps from anywhere, as a light to render or to export with: their suns and lamps inside or apart."""

from pathlib import Path

import numpy as np
import torch

from lightprobe.core.config.prediction import Sun
from lightprobe.export import SceneLight
from lightprobe.export.light_file import read_sources
from lightprobe.imaging import resize_area
from lightprobe.light.environment import Environment, read_map
from lightprobe.light.files import panorama
from lightprobe.light.sources import split_light

_RESOLUTION = 64  # texels along a cubemap edge at which sources are told from the rest
_TINY = 1e-12  # of radiance: black is black without its sources


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


def scene_light(path: Path, sun: Sun) -> SceneLight:
    """Return a map's light; its lamps are those of its .light.json, or else are found in it.

    sun: with `Sun.INSIDE` the map keeps them and there are no lamps. A map that was written without its lamps stays so,
    and they come from its .light.json either way. Raises `InputError` for a map or .light.json that cannot be used.
    """
    image = read_map(path)
    known = read_sources(path)
    if known is not None and known[1] is Sun.SEPARATE:
        return SceneLight(image, known[0])
    if sun is Sun.INSIDE:
        return SceneLight(image, ())
    environment = Environment.from_panorama(image, _RESOLUTION)
    split = split_light(environment)
    if not split.sources:
        return SceneLight(image, ())
    share = split.rest.texels / environment.texels.clamp(min=_TINY)
    return SceneLight(_dimmed(image, share), known[0] if known is not None and known[0] else split.sources)


def _dimmed(image: np.ndarray, share: torch.Tensor) -> np.ndarray:
    """Return a map (H, 2H, 3) times `share` (6, R, R, 3) in [0, 1] of every direction."""
    kept = resize_area(panorama(share), *image.shape[:2])
    return image * np.clip(kept, 0, 1)
