"""Scenes described by `transforms*.json`: Blender's (`camera_angle_x`), nerfstudio's, instant-ngp's (`fl_x`,
...).

`transform_matrix` is camera-to-world with OpenGL axes. Intrinsics may stand in the frame or beside `frames`.
Photos are split by file (`transforms_train.json`, `_test`, `_val` when there is no `_test`, `_relight`), else
by nerfstudio's `train_filenames` and `test_filenames`, or `val_filenames` when there is no `test_filenames`.
Where there is a list of training photos, nothing else is trained on. Frames with one `light_group`, a name or a number,
were taken under one light.
"""

import math
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.errors import InputError, shown
from lightprobe.core.files import inside, read_json
from lightprobe.imaging import IMAGE_SUFFIXES
from lightprobe.scene.camera import Camera
from lightprobe.scene.distortion import ADVICE, with_lens
from lightprobe.scene.frame import Frame, Problems, Split
from lightprobe.scene.lens import Lens
from lightprobe.scene.photo import Truth

TRAIN, SINGLE, RELIGHT = "transforms_train.json", "transforms.json", "transforms_relight.json"
_COMMON_SUFFIXES = ("", ".png", ".jpg", ".jpeg", ".webp", ".PNG", ".JPG", ".JPEG")
_GUESSED_SUFFIXES = (
    *_COMMON_SUFFIXES,
    *(s for low in sorted(IMAGE_SUFFIXES - {*_COMMON_SUFFIXES}) for s in (low, low.upper())),
)
_PINHOLE_MODELS = frozenset({"OPENCV", "FULL_OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL"})
_FISHEYE_MODELS = frozenset({"OPENCV_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE"})
_TRUTH_KEYS = {"environment": "env_path", "linear": "hdr_path"}
_TRUTH_KEYS |= {"base_color": "basecolor_path", "orm": "orm_path", "normal": "normal_path"}


def read_transforms(root: Path, problems: Problems) -> list[Frame]:
    """Return the frames of all `transforms*.json` that apply; bad frames go to `problems`."""
    frames: list[Frame] = []
    for name, split in _files(root):
        with problems.guard():
            frames += _read_file(root, root / name, split, problems)
    return frames


def _files(root: Path) -> list[tuple[str, Split | None]]:
    """Return the camera files that apply, each with the split of its frames; None where none is given."""
    if not (root / TRAIN).is_file():
        return [(SINGLE, None)]
    names = ("transforms_test.json", "transforms_val.json")
    test = next((name for name in names if (root / name).is_file()), None)
    files: list[tuple[str, Split | None]] = [(TRAIN, Split.TRAIN if test else None)]
    files += [(test, Split.TEST)] if test else []
    return files + ([(RELIGHT, Split.RELIGHT)] if (root / RELIGHT).is_file() else [])


def _read_file(root: Path, path: Path, split: Split | None, problems: Problems) -> list[Frame]:
    data = read_json(path)
    if not isinstance(data, dict) or not isinstance(data.get("frames"), list) or not data["frames"]:
        raise InputError(f"{path} has no list of 'frames'.")
    train, test = set[str](), set[str]()
    if split is None:
        train = _names(data, "train_filenames", path)
        test = _names(data, "test_filenames", path) or _names(data, "val_filenames", path)
    named = train | test
    common = {key: value for key, value in data.items() if key != "frames"}
    found = []
    for index, entry in enumerate(data["frames"]):
        with problems.guard():
            if not isinstance(entry, dict) or not isinstance(entry.get("file_path"), str):
                raise InputError(f"{path} frame {index} has no 'file_path'.")
            file = Path(entry["file_path"]).as_posix()
            if train and test and file not in named:
                continue
            listed = Split.TEST if file in test or (train and file not in train) else Split.TRAIN
            found.append(_frame(root, path, {**common, **entry}, listed if named else split))
    return found


def _names(data: dict[str, Any], key: str, path: Path) -> set[str]:
    names = data.get(key) or []
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(f"{path}: '{key}' must be a list of file names.")
    return {Path(name).as_posix() for name in names}


def _frame(root: Path, path: Path, settings: dict[str, Any], split: Split | None) -> Frame:
    """Return the frame of one entry merged over the settings of its file."""
    source = f"{path} ({shown(settings['file_path'])})"
    mask = None
    if settings.get("mask_path"):
        mask = _inside(root, settings, "mask_path", path)
        if not mask.is_file():
            raise InputError(
                f"{source} names the mask '{shown(settings['mask_path'])}', which does not exist."
            )

    image, truth = _image(root, path, settings), _truth(root, path, settings)
    group = _light_group(settings, source)
    return Frame(
        image, source, lambda *size: frame_camera(settings, source, *size), mask, split, truth, group
    )


def _light_group(settings: dict[str, Any], source: str) -> str | None:
    """Return the name of the light that the photo shares with others, None where none is given."""
    group = settings.get("light_group")
    if group is None:
        return None
    if isinstance(group, bool) or not isinstance(group, str | int):
        raise InputError(f"{source}: 'light_group' must be a name or a whole number, not {shown(group)}.")
    return str(group)


def _image(root: Path, path: Path, settings: dict[str, Any]) -> Path:
    """Return the image file; the extension may be missing, as Blender's exporters leave it."""
    written = _text(settings, "file_path", path)
    for suffix in _GUESSED_SUFFIXES:
        guess = inside(root, written + suffix, source=path)
        if guess.is_file():
            return guess
    raise InputError(f"{path} names the photo '{shown(settings['file_path'])}', which does not exist.")


def _truth(root: Path, path: Path, settings: dict[str, Any]) -> Truth:
    """Return the ground-truth files that are named and exist, and the name of the light."""
    files = {}
    for name, key in _TRUTH_KEYS.items():
        if settings.get(key):
            file = _inside(root, settings, key, path)
            files[name] = file if file.is_file() else None
    light = settings.get("hdri")
    return Truth(**files, light=light if isinstance(light, str) else None)


def _inside(root: Path, settings: dict[str, Any], key: str, path: Path) -> Path:
    return inside(root, _text(settings, key, path), source=path)


def _text(settings: dict[str, Any], key: str, path: Path) -> str:
    value = settings[key]
    if not isinstance(value, str):
        raise InputError(f"{path}: '{key}' must be text, not {shown(value)}.")
    return value.replace("\\", "/")


def frame_camera(settings: dict[str, Any], source: str, image_width: int, image_height: int) -> Camera:
    """Return the camera of one frame merged over the settings of its file; `source` names it in errors.

    Size and principal point that are not given follow from the image. Raises `InputError` for a camera model
    that is not read, for values that are no numbers and for a pose that is no rigid motion.
    """
    model = settings.get("camera_model") or "OPENCV"
    if not isinstance(model, str) or model not in _PINHOLE_MODELS | _FISHEYE_MODELS:
        raise InputError(f"{source} has the camera model {shown(model)}, which is not read; {ADVICE}.")
    keys = ("w", "h", "fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y")
    w, h, fx, fy, cx, cy, angle_x, angle_y = (_number(settings, key, source) for key in keys)
    width, height = w or image_width, h or image_height
    fx = fx or _focal(angle_x, width)
    fy = fy or _focal(angle_y, height) or fx
    if fx is None or fy is None:
        raise InputError(f"{source} has no focal length: 'camera_angle_x' or 'fl_x' is needed.")
    center = (width / 2 if cx is None else cx, height / 2 if cy is None else cy)
    camera = Camera(_pose(settings, source), fx, fy, *center, round(width), round(height))
    camera.check(source)
    fisheye = model in _FISHEYE_MODELS or bool(settings.get("is_fisheye"))
    lens = _lens(settings, source, fisheye=fisheye, full=model == "FULL_OPENCV")
    return with_lens(camera, lens, source=source)


def _lens(settings: dict[str, Any], source: str, *, fisheye: bool, full: bool) -> Lens:
    """Return the lens of k1..k4, p1, p2; the full model has k4..k6 below the fraction, and s1..s4."""
    keys = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "s1", "s2", "s3", "s4")
    k1, k2, k3, k4, k5, k6, p1, p2, s1, s2, s3, s4 = (_number(settings, key, source) or 0.0 for key in keys)
    if fisheye:
        return Lens((k1, k2, k3, k4), fisheye=True)
    prism, fourth = (s1, s3), (s2, s4)  # OpenCV counts x's two, then y's
    if full:
        return Lens((k1, k2, k3), (p1, p2), (k4, k5, k6), prism, fourth)
    return Lens((k1, k2, k3, k4), (p1, p2), (), prism, fourth)


def _number(settings: dict[str, Any], key: str, source: str) -> float | None:
    """Return a setting as a finite float, or None where it is not given."""
    value = settings.get(key)
    if value is None:
        return None
    try:
        number = math.nan if isinstance(value, bool) or not isinstance(value, int | float) else float(value)
    except OverflowError:  # JSON's integers have no end
        number = math.inf
    if not math.isfinite(number):
        quoted = repr(shown(value)) if isinstance(value, str) else shown(value)
        raise InputError(f"{source}: '{key}' must be a finite number, not {quoted}.")
    return number


def _focal(angle: float | None, extent: float) -> float | None:
    """Return the focal length in pixels for a field of view of `angle` over `extent` pixels; -1 for none."""
    return None if angle is None else 0.5 * extent / math.tan(0.5 * angle) if 1e-9 < angle < math.pi else -1.0


def _pose(settings: dict[str, Any], source: str) -> np.ndarray:
    """Return the 4x4 camera-to-world matrix; the last row may be missing."""
    try:
        matrix = np.asarray(settings.get("transform_matrix"), np.float64)
    except (TypeError, ValueError, OverflowError):
        matrix = np.zeros(0)
    if matrix.shape not in ((4, 4), (3, 4)):
        raise InputError(f"{source}: 'transform_matrix' must be a 4x4 matrix of numbers.")
    return np.concatenate([matrix[:3], [[0.0, 0.0, 0.0, 1.0]]])
