"""Files of other programs whose cameras are not read: what to export from these programs instead.

docs/photos.md has the same as a table, with the programs whose exports are read.
"""

from pathlib import Path

from lightprobe.core.errors import InputError, printable
from lightprobe.core.files import resolved

_START = 4096  # bytes of a file that tell whose it is
_METASHAPE = (
    "in Metashape 2.2 or later choose File > Export > Export Cameras and there Colmap, or use nerfstudio's "
    "`ns-process-data metashape`"
)
_REALITY = (
    "in RealityScan export the registration as COLMAP, with the photos, or use nerfstudio's `ns-process-data "
    "realitycapture`"
)
_ALICE = "run `aliceVision_exportColmap -i cameras.sfm -o FOLDER`, and name FOLDER"
_OPENMVG = "run `openMVG_main_openMVG2Colmap -i sfm_data.json -o FOLDER`, put the photos into FOLDER/images, and name FOLDER"
_COLMAP = "run `colmap mapper` on it, which makes a model in sparse/0 beside images/"
_OTHERS = "export cameras and photos as a COLMAP model or with a transforms.json"
_SPLATS = "name the scene that these Gaussians were trained on"
# Files of cameras by their ending and what stands at their beginning, and what to do instead
_CAMERAS = (
    (".xml", b"<chunk", _METASHAPE),
    (".xml", b"<BlocksExchange", _OTHERS),
    (".psx", b"", _METASHAPE),
    (".psz", b"", _METASHAPE),
    (".csv", b"heading", _REALITY),
    (".xmp", b"xcr:", _REALITY),
    (".rcproj", b"", _REALITY),
    (".rsproj", b"", _REALITY),
    (".sfm", b"", _ALICE),
    (".mg", b"", _ALICE),
    (".json", b"sfm_data_version", _OPENMVG),
    (".json", b'"viewId"', _ALICE),
    (".json", b'"img_name"', _SPLATS),
    (".out", b"# Bundle file", _OTHERS),
    (".nvm", b"NVM_V3", _OTHERS),
    (".db", b"SQLite format 3", _COLMAP),
    (".abc", b"", _OTHERS),
    (".fbx", b"", _OTHERS),
)
_SHAPES = frozenset(
    {".ply", ".splat", ".spz", ".obj", ".glb", ".gltf", ".usdz", ".usd", ".stl", ".las", ".e57"}
)
_ARCHIVES = frozenset({".zip", ".7z", ".rar", ".tar", ".gz", ".tgz"})
_OURS = frozenset({"transforms", "transforms_train", "transforms_test", "transforms_val", "poses_bounds"})
_MODEL = frozenset({"cameras.txt", "cameras.bin", "images.txt", "images.bin", "points3d.txt", "points3d.bin"})


def instead_of(path: Path) -> str | None:
    """Return a sentence about a file named in place of a scene, None where nothing is known of its kind."""
    suffix = path.suffix.lower()
    if path.stem.lower() in _OURS or path.name.lower() in _MODEL:
        return f"{path} is one file of a scene; name the folder that holds it and the photos."
    if suffix in _SHAPES:
        return f"{path} holds a shape and no cameras; {_OTHERS}."
    if suffix in _ARCHIVES:
        return f"{path} is an archive; unpack it, and name the folder of the scene."
    known = any(suffix == ending for ending, _, _ in _CAMERAS)
    advice = _advice(path) or (_OTHERS if known else None)
    return None if advice is None else f"{path} is no scene that is read; {advice}."


def beside(folder: Path) -> str | None:
    """Return a sentence about files of cameras that are not read in a folder without others, None without any."""
    found = [path for path in sorted(folder.iterdir()) if path.is_file() and _advice(path) is not None]
    if not found:
        return None
    files = found[0].name + (f" and {len(found) - 1} more files are" if len(found) > 1 else " is")
    return printable(f"{files} of cameras in a form that is not read; {_advice(found[0])}.")


def check_folder(path: Path) -> None:
    """Raise `InputError` unless `path` is a folder, with what to name or to export instead where that is known."""
    if path.is_dir():
        return
    if resolved(path) is None or not path.exists():
        raise InputError(f"{path} does not exist.")
    raise InputError(instead_of(path) or f"{path} is not a folder.")


def _advice(path: Path) -> str | None:
    """Return what to do instead of naming a file of cameras; None where the file is none that is known."""
    suffix = path.suffix.lower()
    kinds = [(mark, advice) for ending, mark, advice in _CAMERAS if ending == suffix]
    start = _start(path) if kinds else b""
    return next((advice for mark, advice in kinds if mark in start), None)


def _start(path: Path) -> bytes:
    try:
        with open(path, "rb") as file:
            return file.read(_START)
    except OSError:
        return b""
