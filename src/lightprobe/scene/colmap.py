"""COLMAP models, text and binary: `cameras`, `images` (`points3D` is not needed).

A pose is world-to-camera with OpenCV axes (x right, y down, looking along +z): quaternion (w, x, y, z),
translation.
"""

import math
import struct
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lightprobe.core.errors import InputError, LightprobeWarning, shown
from lightprobe.core.reading import LARGEST_MODEL, check_file, decode_text
from lightprobe.scene.camera import Camera
from lightprobe.scene.distortion import ADVICE, with_lens
from lightprobe.scene.file_names import SceneFiles
from lightprobe.scene.frame import Frame, Problems
from lightprobe.scene.lens import Lens

_MODEL_FOLDERS = ("sparse", "colmap/sparse", ".")
_FILES = tuple(f"{part}.{kind}" for part in ("cameras", "images") for kind in ("bin", "txt"))
_SHOWN = 3  # models that a sentence names
_POSE_WORDS = 9  # of a line of an image, before its name
# COLMAP's camera models by their numbers
_NAMES = ["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV"]
_NAMES += ["FOV", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE"]
_NAMES += ["RAD_TAN_THIN_PRISM_FISHEYE", "SIMPLE_DIVISION", "DIVISION", "SIMPLE_FISHEYE", "FISHEYE", "EUCM"]
_NAMES += ["EQUIRECTANGULAR"]
_PARAMETERS = (3, 4, 4, 5, 8, 8, 12, 5, 4, 5, 12, 16, 4, 5, 3, 4, 6, 2)
_COUNTS = dict(zip(_NAMES, _PARAMETERS, strict=True))
# What follows focal lengths and principal point in the parameters of each model that is read
_LENSES: dict[str, Callable[..., Lens]] = {
    "SIMPLE_PINHOLE": Lens,
    "PINHOLE": Lens,
    "SIMPLE_RADIAL": lambda k: Lens((k,)),
    "RADIAL": lambda k1, k2: Lens((k1, k2)),
    "OPENCV": lambda k1, k2, p1, p2: Lens((k1, k2), (p1, p2)),
    "FULL_OPENCV": lambda k1, k2, p1, p2, k3, k4, k5, k6: Lens((k1, k2, k3), (p1, p2), (k4, k5, k6)),
    "OPENCV_FISHEYE": lambda *k: Lens(k, fisheye=True),
    "FISHEYE": lambda: Lens(fisheye=True),
    "SIMPLE_FISHEYE": lambda: Lens(fisheye=True),
    "SIMPLE_RADIAL_FISHEYE": lambda k: Lens((k,), fisheye=True),
    "RADIAL_FISHEYE": lambda k1, k2: Lens((k1, k2), fisheye=True),
    "FOV": lambda angle: Lens(fov=angle),
    "THIN_PRISM_FISHEYE": lambda k1, k2, p1, p2, k3, k4, s1, s2: Lens(
        (k1, k2, k3, k4), (p1, p2), prism=(s1, s2), fisheye=True
    ),
    # six radial coefficients, then p0 and p1, which are our p2 and p1, then s1, t1, s2, t2
    "RAD_TAN_THIN_PRISM_FISHEYE": lambda *k: Lens(
        k[:6], (k[7], k[6]), prism=(k[8], k[10]), prism_fourth=(k[9], k[11]), fisheye=True, radial_first=True
    ),
}


@dataclass(frozen=True)
class _Model:
    """One camera of the model file; its parameters are judged only when a photo uses it."""

    model: str
    width: int
    height: int
    parameters: tuple[float, ...]


@dataclass(frozen=True)
class _View:
    """One registered image of the model file."""

    quaternion: tuple[float, ...]
    translation: tuple[float, ...]
    lens: int
    name: str


def find_model(root: Path) -> Path | None:
    """Return the folder of `root` that holds a COLMAP model, or a part of one, or None; of several the largest."""
    models = _models(root)
    return max(models, key=_registered) if len(models) > 1 else models[0] if models else None


def _models(root: Path) -> list[Path]:
    """Return the models of a folder: those numbered by COLMAP's mapper, else the only one."""
    for folder in (root / sub for sub in _MODEL_FOLDERS):
        numbered = [path for path in folder.glob("[0-9]*") if path.name.isdecimal() and _is_model(path)]
        if numbered and folder != root:
            return sorted(numbered, key=lambda path: int(path.name))
        if _is_model(folder):
            return [folder]
    return []


def _is_model(folder: Path) -> bool:
    return any((folder / name).is_file() for name in _FILES)


def _registered(model: Path) -> int:
    """Return how many images a model has, 0 where that cannot be read."""
    broken = Problems(collect=True)
    with broken.guard():
        images = _model_files(model)[1]
        if images.suffix == ".txt":
            return len(_read_images_text(images, broken))
        return int(_Binary(images, 8).take("Q")[0])
    return 0


def _model_files(model: Path) -> tuple[Path, Path]:
    """Return the files of cameras and images of a model, binary where there are both; refuse half a model."""
    kinds = [[model / f"{part}.{kind}" for part in ("cameras", "images")] for kind in ("bin", "txt")]
    whole = [paths for paths in kinds if all(path.is_file() for path in paths)]
    paths = whole[0] if whole else next(paths for paths in kinds if any(path.is_file() for path in paths))
    for path in paths:
        if not path.is_file():
            raise InputError(
                f"{path} is missing; a COLMAP model needs both cameras{path.suffix} and images{path.suffix}."
            )
        check_file(path, LARGEST_MODEL)
    return paths[0], paths[1]


def _warn_of_others(root: Path, model: Path, count: int) -> None:
    """Warn that COLMAP has put the photos into several models, which have nothing in common."""
    others = {other: _registered(other) for other in _models(root) if other != model}
    if others and count >= max(others.values()):  # else the model was chosen by its own folder
        some = list(others.items())[:_SHOWN]
        listed = ", ".join(f"{other.relative_to(root)} with {images}" for other, images in some)
        warnings.warn(
            f"{root} holds {len(others) + 1} COLMAP models: the largest, {model.relative_to(root)} with {count} photos, "
            f"is read, and not {listed}{', ...' if len(others) > _SHOWN else ''}.",
            LightprobeWarning,
            stacklevel=3,
        )


def read_colmap(root: Path, model: Path, problems: Problems) -> list[Frame]:
    """Return the frames of the model in folder `model`, with photos of `root/images`, else of `root`."""
    paths = _model_files(model)
    is_binary = paths[0].suffix == ".bin"
    lenses, views = dict[int, _Model](), list[_View]()
    with problems.guard():
        lenses = (_read_cameras_binary if is_binary else _read_cameras_text)(paths[0], problems)
    with problems.guard():
        views = (_read_images_binary if is_binary else _read_images_text)(paths[1], problems)
    if not views and not problems.messages:
        raise InputError(f"{paths[1]} holds no registered images; run the COLMAP reconstruction again.")
    _warn_of_others(root, model, len(views))
    files, found = SceneFiles(root, paths[1], places=("images", "")), []
    for view in views:
        with problems.guard():
            found.append(_frame(files, paths, lenses, view))
    files.warn_of_moved()
    return found


def _content(path: Path, size: int = -1) -> bytes:
    try:
        with open(path, "rb") as file:
            return file.read(size)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error


def _text(content: bytes, path: Path) -> str:
    try:
        return content.decode("utf-8") if path.suffix == ".bin" else decode_text(content)
    except UnicodeDecodeError as error:
        raise InputError(f"{path} cannot be read: it holds text that is not UTF-8.") from error


def _frame(files: SceneFiles, paths: tuple[Path, Path], lenses: dict[int, _Model], view: _View) -> Frame:
    image = files.find(view.name)
    if image is None:
        raise InputError(
            f"{paths[1]} names the photo '{shown(view.name)}', which is not in {files.folder}{files.missing(view.name)}."
        )
    if view.lens not in lenses:
        raise InputError(
            f"{paths[1]}: '{shown(view.name)}' uses camera {shown(view.lens)}, which is not in {paths[0].name}."
        )
    source = f"{paths[1]} ({shown(view.name)})"
    return Frame(image, source, lambda width, height: _camera(lenses[view.lens], view, source))


def _camera(lens: _Model, view: _View, source: str) -> Camera:
    """Return the pinhole camera of a view, with its lens; raise `InputError` for models that are not read."""
    if lens.model not in _LENSES:
        raise InputError(f"{source} has the camera model {shown(lens.model)}, which is not read; {ADVICE}.")
    split = 1 if lens.model.startswith(("SIMPLE", "RADIAL")) else 2  # focal lengths
    focal, (cx, cy, *distortion) = lens.parameters[:split], lens.parameters[split:]
    camera = Camera(_pose(view, source), focal[0], focal[-1], cx, cy, lens.width, lens.height)
    camera.check(source)
    return with_lens(camera, _LENSES[lens.model](*distortion), source=source)


def _pose(view: _View, source: str) -> np.ndarray:
    """Return the 4x4 camera-to-world matrix with OpenGL axes of a world-to-camera pose with OpenCV axes."""
    quaternion = np.asarray(view.quaternion)
    length = math.hypot(*view.quaternion)
    if not np.isfinite([*view.quaternion, *view.translation]).all() or not 1e-9 < length < 1e9:
        raise InputError(
            f"{source}: the pose contains NaN or a zero quaternion; remove the photo or reconstruct again."
        )
    w, x, y, z = quaternion / length
    to_camera = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    pose = np.eye(4)
    pose[:3, :3] = to_camera.T * (1.0, -1.0, -1.0)
    pose[:3, 3] = -to_camera.T @ np.asarray(view.translation)
    return pose


class _Binary:
    """A little-endian binary file read from front to back."""

    def __init__(self, path: Path, size: int = -1):
        """Read the first `size` bytes of a file, by default all."""
        self.path, self._data, self._position = path, _content(path, size), 0

    def take(self, layout: str) -> tuple:
        """Return the next values of a `struct` layout."""
        try:
            values = struct.unpack_from("<" + layout, self._data, self._position)
        except struct.error as error:
            raise InputError(f"{self.path} is cut short; copy it again.") from error
        self._position += struct.calcsize("<" + layout)
        return values

    def text(self) -> str:
        """Return the next zero-terminated text."""
        end = self._data.find(b"\0", self._position)
        if end < 0:
            raise InputError(f"{self.path} is cut short; copy it again.")
        text, self._position = self._data[self._position : end], end + 1
        return _text(text, self.path)

    def skip(self, count: int) -> None:
        """Step over `count` bytes."""
        self._position += count
        if self._position > len(self._data):
            raise InputError(f"{self.path} is cut short; copy it again.")


def _read_cameras_binary(path: Path, problems: Problems) -> dict[int, _Model]:
    """Return the cameras by number, up to a broken part of the file, behind which nothing has its place."""
    file, lenses = _Binary(path), {}
    with problems.guard():
        for _ in range(file.take("Q")[0]):
            number, model, width, height = file.take("iiQQ")
            if not 0 <= model < len(_NAMES):
                raise InputError(f"{path} has the unknown camera model number {model}.")
            name = _NAMES[model]
            lenses[number] = _Model(name, width, height, file.take(f"{_COUNTS[name]}d"))
    return lenses


def _read_images_binary(path: Path, problems: Problems) -> list[_View]:
    """Return the images, as far as the file is sound."""
    file, views = _Binary(path), []
    with problems.guard():
        for _ in range(file.take("Q")[0]):
            _, *pose, lens = file.take("I7dI")
            view = _View(tuple(pose[:4]), tuple(pose[4:]), lens, file.text())
            file.skip(24 * file.take("Q")[0])  # observed points: x, y, point number
            views.append(view)
    return views


def _read_cameras_text(path: Path, problems: Problems) -> dict[int, _Model]:
    lenses = {}
    for number, line in _lines(path):
        if words := line.split():
            with problems.guard():
                key, lens = _lens(f"{path} line {number}", words)
                lenses[key] = lens
    return lenses


def _lens(source: str, words: list[str]) -> tuple[int, _Model]:
    """Return the number and camera of one line of cameras.txt."""
    try:
        key, model, width, height = int(words[0]), words[1], int(words[2]), int(words[3])
        parameters = tuple(float(word) for word in words[4:])
    except (ValueError, IndexError) as error:
        raise InputError(f"{source} is not a camera.") from error
    if _COUNTS.get(model, len(parameters)) != len(parameters):
        raise InputError(
            f"{source}: {shown(model)} needs {_COUNTS[model]} parameters, not {len(parameters)}."
        )
    return key, _Model(model, width, height, parameters)


def _read_images_text(path: Path, problems: Problems) -> list[_View]:
    """Read images.txt: a line for each image and one of its observed points, which may be empty or missing."""
    views, has_points = [], False  # of the image before
    for number, line in _lines(path):
        words = line.split(maxsplit=_POSE_WORDS)
        if has_points and not _is_view(words):
            has_points = False
            if not _are_points(line):
                with problems.guard():
                    raise InputError(
                        f"{path} line {number} is no list of points (x, y and a number for each), nor an image; write "
                        "the model again."
                    )
        elif words:
            has_points = True
            with problems.guard():
                views.append(_view(f"{path} line {number}", words))
    return views


def _are_points(line: str) -> bool:
    """Return whether a line may be the observed points of an image, which are many: only their ends are read."""
    words = line.split()
    return not words or (len(words) % 3 == 0 and all(map(_is_number, words[:3] + words[-3:])))


def _is_view(words: list[str]) -> bool:
    """Return whether a line's words are those of an image."""
    numbers, name = words[:_POSE_WORDS], "".join(words[_POSE_WORDS:]).strip()
    return bool(name) and not _is_number(name) and all(map(_is_number, numbers))


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _view(source: str, words: list[str]) -> _View:
    """Return the image of one line of images.txt."""
    try:
        pose, lens, name = [float(word) for word in words[1:8]], int(words[8]), words[9].strip()
    except (ValueError, IndexError) as error:
        raise InputError(f"{source} is not an image.") from error
    return _View(tuple(pose[:4]), tuple(pose[4:]), lens, name)


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield (line number, line) of a text file without its comments."""
    for number, line in enumerate(_text(_content(path), path).splitlines(), start=1):
        if not line.startswith("#"):
            yield number, line
