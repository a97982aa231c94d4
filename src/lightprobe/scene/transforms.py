"""Scenes described by `transforms*.json`: Blender's (`camera_angle_x`), nerfstudio's, instant-ngp's (`fl_x`,
...).

`transform_matrix` is camera-to-world with OpenGL axes. Intrinsics may stand in the frame or beside `frames`; the frame's
own go first. What nerfstudio calls `applied_transform` and `applied_scale` is in the poses already, and instant-ngp's
`scale`, `offset` and `aabb_scale` are for its own box: none of them is read.
Photos are split by file (`transforms_train.json`, `_test`, `_val` when there is no `_test`, `_relight`), else
by nerfstudio's `train_filenames` and `test_filenames`, or `val_filenames` when there is no `test_filenames`.
Where there is a list of training photos, nothing else is trained on. Frames with one `light_group`, a name or a number,
were taken under one light; beside `frames`, `supports` has for a group the plane that the object stands on there.
"""

import contextlib
import math
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.errors import InputError, LightprobeWarning, shown
from lightprobe.core.files import read_json
from lightprobe.imaging import IMAGE_SUFFIXES, image_size
from lightprobe.scene.camera import Camera
from lightprobe.scene.distortion import ADVICE, with_lens
from lightprobe.scene.file_names import SceneFiles, slashed
from lightprobe.scene.frame import Frame, Problems, Split
from lightprobe.scene.lens import Lens
from lightprobe.scene.photo import Truth
from lightprobe.scene.support import SupportPlane

TRAIN, SINGLE, RELIGHT = "transforms_train.json", "transforms.json", "transforms_relight.json"
_COMMON_SUFFIXES = ("", ".png", ".jpg", ".jpeg", ".webp", ".PNG", ".JPG", ".JPEG")
_GUESSED_SUFFIXES = (
    *_COMMON_SUFFIXES,
    *(s for low in sorted(IMAGE_SUFFIXES - {*_COMMON_SUFFIXES}) for s in (low, low.upper())),
)
_ACROSS, _DOWN = ((f"fl_{axis}", f"{axis}_fov", f"camera_angle_{axis}") for axis in "xy")
_OTHER_LENSES = ("ftheta_p0", "latlong", "equirectangular", "orthographic")  # of instant-ngp
_SAME_FOCAL = 1.02  # ratio of two focal lengths from which they are those of two cameras
_NO_TRANSLATION = 1e-6  # of the last row of a pose
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
    files = SceneFiles(root, path)
    common = {key: value for key, value in data.items() if key != "frames"}
    written = [_written(entry) for entry in data["frames"]]
    _refuse_without_photos(files, path, [name for name in written if name is not None])
    lists = _Lists.of(files, common, written, path) if split is None else _Lists()
    found = []
    for index, (entry, name) in enumerate(zip(data["frames"], written, strict=True)):
        with problems.guard():
            if name is None:
                raise InputError(f"{path} frame {index} has no 'file_path'.")
            if lists.holds(name):
                found.append(_frame(files, path, frame_settings(common, entry), lists.split(name) or split))
    files.warn_of_moved()
    if found:
        _warn_of_two_focals(found[0], common, path)
    return found


def _written(entry: Any) -> str | None:
    """Return the path of the photo of one entry of `frames`, None where there is none."""
    file = entry.get("file_path") if isinstance(entry, dict) else None
    return file if isinstance(file, str) else None


def _refuse_without_photos(files: SceneFiles, path: Path, written: list[str]) -> None:
    """Raise `InputError` when none of the photos is there: one sentence instead of one for each."""
    for name in written:
        try:
            if files.find(name, _GUESSED_SUFFIXES) is not None:
                return
        except InputError:  # told with its frame
            return
    if len(written) > 1:
        raise InputError(
            f"{path} names {len(written)} photos, none of which exists, such as '{shown(written[0])}'"
            f"{files.missing(written[0])}; put the photos there, or remove this file if it is not needed."
        )


@dataclass(frozen=True)
class _Lists:
    """What `train_filenames` and `test_filenames` say, by the photos' keys; nothing where both are empty."""

    train: frozenset[str] = frozenset()
    test: frozenset[str] = frozenset()
    keys: dict[str, str] = field(default_factory=dict)  # by what frames write

    @staticmethod
    def of(files: SceneFiles, data: dict[str, Any], written: list[str | None], path: Path) -> "_Lists":
        """Return the lists of a file; raise `InputError` for one that names none of its frames."""
        train = _names(data, "train_filenames", path)
        key = "test_filenames" if _names(data, "test_filenames", path) else "val_filenames"
        test = _names(data, key, path)
        if not train and not test:
            return _Lists()
        keys = {name: files.key(name, _GUESSED_SUFFIXES) for name in written if name is not None}
        frames = frozenset(keys.values())

        def chosen(names: list[str], title: str) -> frozenset[str]:
            found = {files.key(name, _GUESSED_SUFFIXES): name for name in names}
            unknown = [name for file, name in found.items() if file not in frames]
            if unknown and len(unknown) == len(found):
                raise InputError(
                    f"{path}: no name in '{title}', such as '{shown(unknown[0])}', is the 'file_path' of a frame; correct "
                    "the list, or remove it."
                )
            if unknown:
                warnings.warn(
                    f"{path}: {len(unknown)} of {len(found)} names in '{title}' are the 'file_path' of no frame, such as "
                    f"'{shown(unknown[0])}'.",
                    LightprobeWarning,
                    stacklevel=3,
                )
            return frozenset(found)

        return _Lists(chosen(train, "train_filenames"), chosen(test, key), keys)

    def holds(self, name: str) -> bool:
        """Return whether the photo that a frame names is used at all."""
        return not (self.train and self.test) or self.keys[name] in self.train | self.test

    def split(self, name: str) -> Split | None:
        """Return the split of the photo that a frame names, None where there are no lists."""
        if not self.train and not self.test:
            return None
        file = self.keys[name]
        return Split.TEST if file in self.test or (self.train and file not in self.train) else Split.TRAIN


def _names(data: dict[str, Any], key: str, path: Path) -> list[str]:
    names = data.get(key) or []
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(f"{path}: '{key}' must be a list of file names.")
    return names


def frame_settings(common: dict[str, Any], entry: dict[str, Any]) -> dict[str, Any]:
    """Return the settings of a frame: its `entry` over what its file says for all frames; null says nothing.

    A field of view of the frame goes before a focal length of the file, and the other way round. The file's two focal
    lengths are those of one camera: a frame with another across has the same down, unless it says more.
    """
    replaced = {key for axis in (_ACROSS, _DOWN) if _gives(entry, axis) for key in axis}
    if _gives(entry, _ACROSS) and _gives(common, _ACROSS):
        replaced |= set(_DOWN)
    kept = {key: value for key, value in common.items() if key not in replaced}
    return {**kept, **{key: value for key, value in entry.items() if value is not None}}


def _gives(settings: dict[str, Any], keys: tuple[str, ...]) -> bool:
    return any(settings.get(key) is not None for key in keys)


def _warn_of_two_focals(frame: Frame, common: dict[str, Any], path: Path) -> None:
    """Warn of a file whose field of view and focal length are of different cameras."""
    if not (_gives(common, _ACROSS[:1]) and _gives(common, _ACROSS[1:])) or common.get("is_fisheye"):
        return
    with contextlib.suppress(InputError):  # what is wrong is told of each frame
        width = _number(common, "w", str(path)) or image_size(frame.image)[0]
        focal = _number(common, "fl_x", str(path)) or 0.0
        other = _focal({**common, "fl_x": None}, "x", width, str(path)) or 0.0
        if min(focal, other) > 0 and max(focal, other) > _SAME_FOCAL * min(focal, other):
            warnings.warn(
                f"{path}: 'fl_x' is {focal:.5g} pixels, but 'camera_angle_x' means {other:.5g} of a width of {width:g}; "
                "'fl_x' is taken: remove the wrong one, or give 'w'.",
                LightprobeWarning,
                stacklevel=2,
            )


def _frame(files: SceneFiles, path: Path, settings: dict[str, Any], split: Split | None) -> Frame:
    """Return the frame of one entry merged over the settings of its file."""
    source = f"{path} ({shown(settings['file_path'])})"
    mask = None
    if settings.get("mask_path"):
        mask = files.find(_text(settings, "mask_path", path))
        if mask is None:
            raise InputError(
                f"{source} names the mask '{shown(settings['mask_path'])}', which does not exist"
                f"{files.missing(settings['mask_path'])}."
            )

    image, truth = _image(files, path, settings["file_path"]), _truth(files, path, settings)
    group = _light_group(settings, source)
    support = _support(settings, group, path)
    return Frame(
        image, source, lambda *size: frame_camera(settings, source, *size), mask, split, truth, group, support
    )


def _light_group(settings: dict[str, Any], source: str) -> str | None:
    """Return the name of the light that the photo shares with others, None where none is given."""
    group = settings.get("light_group")
    if group is None:
        return None
    if isinstance(group, bool) or not isinstance(group, str | int):
        raise InputError(f"{source}: 'light_group' must be a name or a whole number, not {shown(group)}.")
    return str(group)


def _support(settings: dict[str, Any], group: str | None, path: Path) -> SupportPlane | None:
    """Return the plane that the object stands on in the photos of a light group, None where none is given."""
    supports = settings.get("supports") or {}
    if not isinstance(supports, dict):
        raise InputError(f"{path}: 'supports' must name a plane for each light group, not {shown(supports)}.")
    plane = supports.get(group)
    if plane is None:
        return None
    return SupportPlane.from_json(plane, source=f"{path}, light group {shown(group)}")


def _image(files: SceneFiles, path: Path, written: str) -> Path:
    """Return the image file; the extension may be missing, as Blender's exporters leave it."""
    found = files.find(written, _GUESSED_SUFFIXES)
    if found is None:
        raise InputError(
            f"{path} names the photo '{shown(written)}', which does not exist{files.missing(written)}."
        )
    if not slashed(written).casefold().endswith(found.suffix.casefold()):
        kinds = {suffix.lower() for suffix in _COMMON_SUFFIXES if suffix}
        alike = [other for kind in sorted(kinds) if (other := found.with_suffix(kind)).is_file()]
        if len(alike) > 1 and found in alike:
            raise InputError(
                f"{path} names the photo '{shown(written)}' without an extension, and {alike[0].name} and "
                f"{alike[1].name} are both there; write which of them is meant."
            )
    return found


def _truth(files: SceneFiles, path: Path, settings: dict[str, Any]) -> Truth:
    """Return the ground-truth files that are named and exist, and the name of the light."""
    found = {
        name: files.find(_text(settings, key, path)) for name, key in _TRUTH_KEYS.items() if settings.get(key)
    }
    light = settings.get("hdri")
    return Truth(**found, light=light if isinstance(light, str) else None)


def _text(settings: dict[str, Any], key: str, path: Path) -> str:
    value = settings[key]
    if not isinstance(value, str):
        raise InputError(f"{path}: '{key}' must be text, not {shown(value)}.")
    return value


def frame_camera(settings: dict[str, Any], source: str, image_width: int, image_height: int) -> Camera:
    """Return the camera of one frame merged over the settings of its file; `source` names it in errors.

    Size and principal point that are not given follow from the image. Raises `InputError` for a camera model
    that is not read, for values that are no numbers and for a pose that is no rigid motion.
    """
    other = (key for key in _OTHER_LENSES if settings.get(key) is not None and settings[key] is not False)
    model = settings.get("camera_model") or next(other, "OPENCV")
    model = model.upper() if isinstance(model, str) else model
    if not isinstance(model, str) or model not in _PINHOLE_MODELS | _FISHEYE_MODELS:
        raise InputError(f"{source} has the camera model {shown(model)}, which is not read; {ADVICE}.")
    w, h, cx, cy = (_number(settings, key, source) for key in ("w", "h", "cx", "cy"))
    width, height = w or image_width, h or image_height
    fx, fy = _focal(settings, "x", width, source), _focal(settings, "y", height, source)
    fy = fy or fx
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


def _focal(settings: dict[str, Any], axis: str, extent: float, source: str) -> float | None:
    """Return the focal length in pixels along an `axis` of `extent` pixels, None where none is given.

    From `fl_x` (pixels), else instant-ngp's `x_fov` (degrees), else `camera_angle_x` (radians); -1 for an angle
    that is no field of view.
    """
    focal, degrees, angle = (_number(settings, key, source) for key in (_ACROSS if axis == "x" else _DOWN))
    if focal or (degrees is None and angle is None):
        return focal
    if degrees is None and angle is not None and angle > 2 * math.pi:
        raise InputError(
            f"{source}: 'camera_angle_{axis}' must be in radians, not {angle:g}; {angle:g} degrees are "
            f"{math.radians(angle):.6g}."
        )
    angle = math.radians(degrees) if degrees is not None else angle
    return 0.5 * extent / math.tan(0.5 * angle) if angle and 1e-9 < angle < math.pi else -1.0


def _pose(settings: dict[str, Any], source: str) -> np.ndarray:
    """Return the 4x4 camera-to-world matrix; the last row may be missing."""
    try:
        matrix = np.asarray(settings.get("transform_matrix"), np.float64)
    except (TypeError, ValueError, OverflowError):
        matrix = np.zeros(0)
    if matrix.shape not in ((4, 4), (3, 4)):
        raise InputError(f"{source}: 'transform_matrix' must be a 4x4 matrix of numbers.")
    if np.abs(matrix[3:, :3]).max(initial=0.0) > _NO_TRANSLATION:
        raise InputError(
            f"{source}: the last row of 'transform_matrix' must be 0, 0, 0, 1; the matrix is transposed or of another "
            "kind."
        )
    return np.concatenate([matrix[:3], [[0.0, 0.0, 0.0, 1.0]]])
