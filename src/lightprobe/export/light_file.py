"""NAME.light.json beside a map: all that other programs may want to know of a light, in words and numbers.

docs/light-files.md explains it field by field.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.config.prediction import Sun
from lightprobe.core.errors import InputError, shown
from lightprobe.core.files import read_json, write_json
from lightprobe.export.gltf_mesh import Y_UP, to_y_up
from lightprobe.imaging import LUMA
from lightprobe.light import cubemap
from lightprobe.light.environment import Environment
from lightprobe.light.files import FORMAT, describes, light_file
from lightprobe.light.sources import MOST, LightSource
from lightprobe.light.spherical_harmonics import BASIS, WINDOW, harmonics, plain_harmonics
from lightprobe.models.calibration import Calibration
from lightprobe.prediction import Prediction
from lightprobe.scene.camera import Camera

VERSION = 1  # of the format
_SATURATION = 1.2  # luminance that makes white, in cd/m^2 at EV100 = 0: 78 / (100 * .65) of ISO 12232
# CIE XYZ of linear sRGB's primaries (IEC 61966-2-1), rows X, Y, Z
_TO_XYZ = ((0.4124, 0.3576, 0.1805), (0.2126, 0.7152, 0.0722), (0.0193, 0.1192, 0.9505))


@dataclass(frozen=True)
class PhotoFacts:
    """What is known of the photo that a light was predicted from."""

    name: str  # of its file
    camera: Camera  # input frame
    ev100: float | None  # from EXIF, if complete


def write_light_file(
    map_path: Path,
    prediction: Prediction,
    photo: PhotoFacts,
    sun: Sun,
    map_height: int | None = None,
    copies: Sequence[str] = (),
) -> None:
    """Write the JSON beside the map at `map_path`, which has `map_height` rows or its own, atomically.

    copies: names of files beside it that hold the same map in another format.
    """
    light, calibration = prediction.environment, prediction.calibration
    sources = () if prediction.split is None else prediction.split.sources
    write_json(
        light_file(map_path),
        {
            **_map_and_sources(map_path, map_height or 2 * light.resolution, sources, sun, copies),
            "sources_sought": prediction.split is not None,
            "spherical_harmonics": _harmonics(light),
            "webxr": webxr_estimate(light if prediction.split is None else prediction.split.rest, sources),
            "white_balance": _white_balance(light),
            "exposure": {"ev100": photo.ev100, "source": None if photo.ev100 is None else "EXIF"},
            "photometry": _photometry(photo.ev100, calibration),
            "calibration": None if calibration is None else calibration.to_json(),
            "confidence": _confidence(prediction),
            "photo": {"file": photo.name, "camera": photo.camera.to_json()},
            "verdict": prediction.verdict.to_json(),
            "background": prediction.background.value,
        },
    )


def write_sources(
    map_path: Path, map_height: int, sources: Sequence[LightSource], sun: Sun, copies: Sequence[str] = ()
) -> None:
    """Write the JSON beside a map of `map_height` rows of which only the sources are known, atomically.

    copies: names of files beside it that hold the same map in another format.
    """
    write_json(light_file(map_path), _map_and_sources(map_path, map_height, sources, sun, copies))


def _map_and_sources(
    map_path: Path, rows: int, sources: Sequence[LightSource], sun: Sun, copies: Sequence[str] = ()
) -> dict[str, Any]:
    size = {"width": 2 * rows, "height": rows}
    return {
        "format": FORMAT,
        "version": VERSION,
        "map": {"file": map_path.name, "copies": [*copies], **size, "sun": sun.value},
        "units": "linear radiance; 1 is the white of the photo; irradiance is radiance times steradian",
        "color_space": "linear, primaries of sRGB (Rec. 709), white D65",
        "axes": "right-handed, z up, those of the user's cameras; u = 0.5 - atan2(y, x) / 2 pi, v = acos(z) / pi",
        "up": [0.0, 0.0, 1.0],
        "sources": [source.to_json() for source in sources],
    }


def read_sources(map_path: Path) -> tuple[tuple[LightSource, ...], Sun] | None:
    """Return the sources in the JSON beside a map and whether the map has them; None without such a file.

    None also where the JSON belongs to the other format's map of the same name. Raises `InputError` for a file that
    is not of this format and version, or says what no source can be.
    """
    path = light_file(map_path)
    if not path.is_file():
        return None
    value = read_json(path)
    if not isinstance(value, dict) or value.get("format") != FORMAT or value.get("version") != VERSION:
        words = f"{path} is no light file of version {VERSION}"
        raise InputError(f"{words}; remove it, and sources are found in the map.")
    try:
        given = value["sources"]
        if not isinstance(given, list) or len(given) > MOST:
            raise ValueError(f"not a list of at most {MOST}")
        if not describes(value["map"], map_path):
            return None
        return tuple(LightSource.from_json(one) for one in given), Sun(value["map"]["sun"])
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(
            f"{path} says what no light source can be ({shown(str(error))}); remove it, and they are found in the map."
        ) from error


def is_calibrated(map_path: Path) -> bool | None:
    """Return whether a predicted map is calibrated; None where no JSON tells of a prediction.

    An unreadable JSON counts as none; `read_sources` refuses it.
    """
    try:
        value = read_json(light_file(map_path))
        return value["calibration"] is not None if describes(value["map"], map_path) else None
    except (InputError, KeyError, TypeError, ValueError, AttributeError):
        return None


def _harmonics(light: Environment) -> dict[str, Any]:
    return {
        "of": "radiance of the whole light, sources included",
        "basis": "real, orthonormal, no Condon-Shortley phase; x, y, z as in 'axes'",
        "order": list(BASIS),
        "window": {"name": "Hann", "width": 3, "factors": list(WINDOW), "applied": True},
        "coefficients_rgb": harmonics(light.texels.cpu()).tolist(),
    }


def webxr_estimate(rest: Environment, sources: Sequence[LightSource]) -> dict[str, Any]:
    """Return a light as the three fields of WebXR's XRLightEstimate, in its y-up frame.

    rest: the light without its `sources`, of which the strongest, the first, is the primary light; all the rest is
    in the spherical harmonics, since a page that shows both adds them. Without sources the primary light is black
    and overhead, as the specification asks for. As three.js reads them, the harmonics are of radiance, not windowed,
    red, green and blue of each together, and the intensity is an irradiance.
    """
    ambient = rest.texels.cpu().clone()
    for source in sources[1:]:
        ambient += source.texels(rest.resolution)
    towards, irradiance = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    if sources:
        towards, irradiance = sources[0].direction, sources[0].irradiance
    direction = to_y_up(np.array(towards)) + 0.0  # of -0 and 0 one
    return {
        "sphericalHarmonicsCoefficients": plain_harmonics(ambient, Y_UP).ravel().tolist(),
        "primaryLightDirection": dict(zip("xyzw", [*direction.tolist(), 0.0], strict=True)),
        "primaryLightIntensity": dict(zip("xyzw", [*irradiance, 1.0], strict=True)),
    }


def _white_balance(light: Environment) -> dict[str, Any]:
    """Return the light's mean colour, and the factors and colour temperature that make it grey."""
    mean = light.mean().double().cpu()
    luma = float(mean @ mean.new_tensor(LUMA.tolist()))
    if luma <= 0 or float(mean.min()) <= 0:
        return {"mean_rgb": mean.tolist(), "gains_rgb": None, "temperature_kelvin": None}
    gains, kelvin = (luma / mean).tolist(), _temperature(mean.tolist())
    return {"mean_rgb": mean.tolist(), "gains_rgb": gains, "temperature_kelvin": kelvin}


def _temperature(color: list[float]) -> float | None:
    """Return the correlated colour temperature of linear sRGB (McCamy 1992), None beyond 2000 to 25000 K."""
    x, y, z = (sum(weight * value for weight, value in zip(row, color, strict=True)) for row in _TO_XYZ)
    total = x + y + z
    n = (x / total - 0.3320) / (0.1858 - y / total)
    kelvin = 449 * n**3 + 3525 * n**2 + 6823.3 * n + 5520.33
    return kelvin if 2000 <= kelvin <= 25_000 else None


def _photometry(ev100: float | None, calibration: Calibration | None) -> dict[str, Any]:
    """Return how many cd/m^2 a unit of radiance is; includes the scale's uncertainty unless calibrated."""
    return {
        "cd_per_m2_per_unit": candela_per_unit(ev100),
        "source": None if ev100 is None else "EXIF: saturation-based, 1.2 * 2^EV100",
        "calibrated": calibration is not None,
    }


def candela_per_unit(ev100: float | None) -> float | None:
    """Return the luminance in cd/m^2 of a photo's linear white, or None without an exposure value.

    Saturation-based speed (ISO 12232): 1.2 times 2^EV100. Cameras differ by up to a stop, by their tone
    curves.
    """
    return None if ev100 is None else _SATURATION * 2.0**ev100


def _confidence(prediction: Prediction) -> dict[str, float]:
    trust = prediction.confidence
    angle = cubemap.solid_angles(trust.shape[1], trust.device)
    share = float((angle * (trust >= 0.5)).sum() / (4 * math.pi))
    bounds = {"least": float(trust.min()), "most": float(trust.max())}
    return {"mean": float(cubemap.sphere_mean(trust)), **bounds, "share_within_factor_two": share}
