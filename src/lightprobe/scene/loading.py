"""From a folder to a `Scene`: its layout, its photos with masks and names, the split, the similarity."""

import os
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.imaging import foreign_encoding, image_size, read_exif_ev100
from lightprobe.scene import colmap, nerd, transforms, unread_cameras
from lightprobe.scene.findings import encoding_sentences
from lightprobe.scene.frame import Frame, Problems, Split, list_images, unique_names
from lightprobe.scene.masks import MaskFolder, without_background
from lightprobe.scene.normalise import find_similarity
from lightprobe.scene.photo import Photo, Scene
from lightprobe.scene.pixels import fit_camera, load_alpha
from lightprobe.scene.soundness import judge
from lightprobe.scene.support import common_support

T = TypeVar("T")

_TEST_EVERY = 16  # NeRD's rule: test photos are images[::16] of the sorted list
_PIXELS_AT_ONCE = 2**28  # of photos that are decoded at the same time
THUMBNAIL = 192  # longer side of the pictures that a scene is judged on
_LAYOUTS = (
    f"poses_bounds.npy with images/ and masks/ (NeRD, LLFF), {transforms.SINGLE} or {transforms.TRAIN} (Blender, "
    "nerfstudio), or a COLMAP model in sparse/0, sparse or the folder itself"
)


@dataclass(frozen=True)
class Reading:
    """What a scene folder holds, before anything is computed from it."""

    root: Path
    format: str
    photos: dict[Split, tuple[Photo, ...]]
    files: frozenset[Path]  # the image files that have a camera, sound or not

    def all_photos(self) -> list[tuple[Split, Photo]]:
        """Return every photo with its split."""
        return [(split, photo) for split, photos in self.photos.items() for photo in photos]


def load_scene(path: Path) -> Scene:
    """Read the scene in folder `path`, whichever of the known layouts it has.

    Every camera, image header and mask is checked. Raises `InputError` at the first thing that is missing,
    damaged or contradictory; `lightprobe.scene.inspect.inspect` lists all of them. Warns of what can be
    trained on, but not well.
    """
    return _loaded(path)[0]


def load_checked_scene(path: Path) -> Scene:
    """Return `load_scene(path)`, its masks and cameras compared as `inspect` does, before it is trained on.

    Also raises `InputError` where no object can come of them, and warns of what is doubtful.
    """
    scene, masks = _loaded(path)
    photos = [*scene.train, *scene.test, *scene.relight]
    found = judge(scene.train, photos[len(scene.train) :], masks, scene.root)
    if found.refusals:
        raise InputError(f"{scene.root} cannot be trained on. {found.refusals[0]}")
    for sentence in (*unposed_sentences(scene.root, [photo.image_path for photo in photos]), *found.doubts):
        warnings.warn(sentence, LightprobeWarning, stacklevel=2)
    return scene


def _loaded(path: Path) -> tuple[Scene, dict[str, np.ndarray]]:
    """Return what `load_scene` does, and the small masks (h, w) float32 of all photos by name."""
    problems = Problems()
    reading = read_folder(Path(path), problems)
    photos = [photo for _, photo in reading.all_photos()]
    found = in_parallel(lambda photo: load_alpha(photo, THUMBNAIL), photos)
    masks = {photo.name: result() for photo, result in found}
    bare, sentence = without_background(masks)
    if 2 * bare >= len(masks) > 0:  # a close-up of the object alone is possible, but not of most photos
        raise InputError(f"{reading.root}: {sentence}")
    if bare:
        warnings.warn(sentence, LightprobeWarning, stacklevel=3)
    for sentence in encoding_sentences(photos):
        warnings.warn(sentence, LightprobeWarning, stacklevel=3)
    train = reading.photos[Split.TRAIN]
    similarity = find_similarity([photo.camera for photo in train], [masks[photo.name] for photo in train])
    test, relight = reading.photos[Split.TEST], reading.photos[Split.RELIGHT]
    support = common_support([photo.support for photo in train], similarity.scale)
    return Scene(reading.root, reading.format, train, test, relight, similarity, support), masks


def read_folder(path: Path, problems: Problems) -> Reading:
    """Return the photos of a scene folder; what is wrong with a single photo goes to `problems`."""
    unread_cameras.check_folder(path)
    root, layout, frames = _read_frames(path.resolve(), problems)
    frames.sort(key=lambda frame: frame.image.as_posix())
    names = unique_names([frame.image for frame in frames], root)
    masks = MaskFolder(root, [frame.image for frame in frames if frame.mask is None])
    first: dict[Path, Frame] = {}
    photos: dict[Split, list[Photo]] = {split: [] for split in Split}
    for index, (frame, name) in enumerate(zip(frames, names, strict=True)):
        with problems.guard():
            _refuse_second(frame, first.setdefault(frame.image.resolve(), frame))
            by_rule = Split.TRAIN if index % _TEST_EVERY else Split.TEST
            photos[frame.split or by_rule].append(_photo(frame, name, masks))
    if len(photos[Split.TRAIN]) < 2 and not problems.messages:
        raise InputError(
            f"{root} holds {len(frames)} photos with cameras; two or more are needed for training."
        )
    files = frozenset(frame.image for frame in frames)
    return Reading(root, layout, {split: tuple(found) for split, found in photos.items()}, files)


def in_parallel(
    work: Callable[[Photo], T], photos: Iterable[Photo]
) -> Iterator[tuple[Photo, Callable[[], T]]]:
    """Do `work` on photos in threads; yield each with a function that returns or raises its outcome."""
    photos = list(photos)
    largest = max((photo.camera.width * photo.camera.height for photo in photos), default=1)
    with ThreadPoolExecutor(max(1, min(os.cpu_count() or 1, _PIXELS_AT_ONCE // largest))) as pool:
        waiting = [(photo, pool.submit(work, photo)) for photo in photos]
        try:
            for photo, future in waiting:
                yield photo, future.result
        finally:
            pool.shutdown(cancel_futures=True)


def unposed_sentences(root: Path, files: Iterable[Path]) -> list[str]:
    """Return a sentence about the photos in `images/` of the scene `root` that are not among `files`, if any."""
    left = unposed_images(root, files)
    if not left:
        return []
    return [f"{len(left)} photos in images/ have no camera and are left out, such as {left[0].name}."]


def unposed_images(root: Path, files: Iterable[Path]) -> list[Path]:
    """Return the images in `images/` of the scene `root` that are not among `files`, which have a camera."""
    folder = root / "images"
    if not folder.is_dir():
        return []
    known = {path.resolve() for path in files}  # `images` may be a link to elsewhere
    return [path for path in list_images(folder) if path.resolve() not in known]


def has_cameras(root: Path) -> bool:
    """Return whether a folder holds the cameras of one of the layouts that are read."""
    names = (transforms.TRAIN, transforms.SINGLE, nerd.POSES)
    return any((root / name).is_file() for name in names) or colmap.find_model(root) is not None


def _read_frames(root: Path, problems: Problems) -> tuple[Path, str, list[Frame]]:
    """Return (scene folder, layout, frames) by the camera files there; `InputError` lists the layouts."""
    if any((root / name).is_file() for name in (transforms.TRAIN, transforms.SINGLE)):
        return root, "transforms", transforms.read_transforms(root, problems)
    if (root / nerd.POSES).is_file():
        return root, "nerd", nerd.read_nerd(root)
    model = colmap.find_model(root)
    if model is None:
        content = "holds photos but no cameras" if list_images(root) else "is not a scene"
        content = content if any(root.iterdir()) else "is empty"
        raise InputError(
            f"{root} {content}; {unread_cameras.beside(root) or f'a scene folder has {_LAYOUTS}.'}"
        )
    if model == root:  # the model itself was named: the photos lie beside it or above
        root = next((folder for folder in (root, *root.parents[:2]) if (folder / "images").is_dir()), root)
    return root, "colmap", colmap.read_colmap(root, model, problems)


def _refuse_second(frame: Frame, first: Frame) -> None:
    """Raise `InputError` unless `frame` is the first of its photo, which would count twice."""
    if frame is first:
        return
    try:
        size = image_size(frame.image)
        cameras = [found.camera(*size).to_json() for found in (first, frame)]
    except InputError:  # the first frame's error has been told
        cameras = [{}, {}]
    differ = "" if cameras[0] == cameras[1] else ", with different cameras"
    raise InputError(
        f"{first.image} is named twice{differ}, by {first.source} and {frame.source}; keep one entry for each photo."
    )


def _photo(frame: Frame, name: str, masks: MaskFolder) -> Photo:
    """Return the checked photo of a frame."""
    camera = frame.camera(*image_size(frame.image))
    camera.check(frame.source)
    camera = fit_camera(camera, frame.image, frame.source)
    mask = frame.mask or masks.find(frame.image)
    exposure, encoding = read_exif_ev100(frame.image), foreign_encoding(frame.image)
    return Photo(
        name, camera, frame.image, mask, exposure, frame.truth, encoding, frame.light_group, frame.support
    )
