"""Names of environment files, and equirectangular maps written to them; `light.environment` reads them."""

from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor

from lightprobe.core.config.export import ColorSpace
from lightprobe.core.errors import ConfigError, ConvergenceError, InputError
from lightprobe.core.files import read_json, remove, write_json
from lightprobe.imaging import write_exr, write_radiance
from lightprobe.light import equirect

_SUFFIXES = (".exr", ".hdr")
_SUFFIX = ".light.json"
FORMAT = "lightprobe light"  # of a .light.json


def environment_files(folder: Path) -> list[Path]:
    """Return every .exr and .hdr file of a folder, sorted by name; raise `InputError` when there is none."""
    if not folder.is_dir():
        raise InputError(f"{folder} is not a folder of environment maps.")
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in _SUFFIXES)
    if not paths:
        raise InputError(f"{folder} has no .exr or .hdr environment map.")
    return paths


def light_file(map_path: Path) -> Path:
    """Return where the JSON of a map is, which tells of its sources and whether they are in it."""
    return map_path.with_name(map_path.stem + _SUFFIX)


def other_map(map_path: Path) -> Path | None:
    """Return the map in another format that the JSON beside `map_path` describes, None where there is none."""
    try:
        record = read_json(light_file(map_path))["map"]
        other = map_path.with_name(Path(record["file"]).name)
        return None if describes(record, map_path) or not other.is_file() else other
    except (InputError, KeyError, TypeError, ValueError, AttributeError):
        return None


def describes(record: dict[str, Any], map_path: Path) -> bool:
    """Return whether a JSON's "map", which may have been renamed, is at `map_path`: .exr and .hdr share a JSON."""
    name = str(record.get("file", map_path.name))
    return Path(name).stem != map_path.stem or map_path.name in (name, *record.get("copies", []))


def _forget_record(map_path: Path) -> None:
    """Take a map out of the JSON beside it; remove the JSON where it describes no other map."""
    path = light_file(map_path)
    try:
        value = read_json(path)
        record = value["map"]
        if value["format"] != FORMAT or not describes(record, map_path):
            return
        names = [Path(name).name for name in (record["file"], *record.get("copies", []))]
    except (
        InputError,
        KeyError,
        TypeError,
        ValueError,
        AttributeError,
    ):  # no such file, or another program's
        return
    same = [name for name in names if Path(name).stem == map_path.stem and name != map_path.name]
    left = [name for name in same if map_path.with_name(name).is_file()]
    if left:
        write_json(path, {**value, "map": {**record, "file": left[0], "copies": left[1:]}})
    else:
        remove(path)


def panorama(cube: Tensor) -> np.ndarray:
    """Return a cubemap (6, R, R, C) as an equirectangular array (2R, 4R, C) float32, as files have it."""
    return equirect.from_cubemap(cube, 2 * cube.shape[1]).detach().cpu().numpy()


def write_map(path: Path, image: np.ndarray, color_space: ColorSpace = ColorSpace.SRGB) -> None:
    """Write an equirectangular map (H, 2H, C); the suffix chooses OpenEXR or Radiance HDR.

    color_space: of the OpenEXR file, which names it. Radiance has no name for it and is always linear sRGB.

    The .light.json of an older map is dropped first, as its suns are not the new map's. Raises `ConfigError` for
    any other suffix, `ConvergenceError` for NaN or infinity, which no other program reads.
    """
    check_map_name(path)
    if not np.isfinite(image).all():
        raise ConvergenceError(f"The light for {path} holds NaN or infinity; it is not written. Train anew.")
    _forget_record(path)
    if path.suffix.lower() == ".exr":
        write_exr(path, image, color_space=color_space)
    else:
        write_radiance(path, image)


def plane(values: Tensor) -> np.ndarray:
    """Return one number for each direction (6, R, R) as an equirectangular array (2R, 4R) float32."""
    return panorama(values[..., None])[..., 0]


def write_plane(path: Path, values: Tensor) -> None:
    """Write one number for each direction (6, R, R) as a one-channel equirectangular EXR."""
    write_exr(path, plane(values))


def check_map_name(path: Path) -> None:
    """Raise `ConfigError` when no environment can be written under this name."""
    if path.suffix.lower() not in _SUFFIXES:
        raise ConfigError(f"Cannot write an environment as '{path.name}': name it .exr or .hdr.")
