"""Plain photos, without cameras and masks: which files they are, what is measured on them, and what may fail.

Sharpness compares detail with what is left of it after blurring, as a picture that is blurred already loses
little (Crété et al., "The blur effect", 2007); texture counts corners, which are what photos are matched by
(Shi and Tomasi, "Good features to track", 1994).
"""

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import scipy

from lightprobe import imaging
from lightprobe.core.errors import printable
from lightprobe.imaging.video import FrameChoice, choose_frames, difference, measure_frames
from lightprobe.scene import unread_cameras
from lightprobe.scene.coverage import ENOUGH, FEWEST
from lightprobe.scene.findings import converted_encodings, exposures, numbered, sizes
from lightprobe.scene.frame import Problems, list_images
from lightprobe.scene.loading import has_cameras

SAME = 0.04  # difference of two photos' thumbnails, in standard deviations, below which they show the same
_SIDE = 1280  # pixels of the longer side that sharpness and texture are measured on, as features are found
_THUMBNAIL = 48  # pixels of the longer side that photos are compared on
_MASKS = frozenset({"masks", "mask"})  # folders that hold no photos
_MADE = (".prepare", "prepare.json", "config.json")  # in folders that `prepare` and `train` have made
_BLUR = 9  # pixels of the running mean that detail is compared across
_CELL = 16  # pixels of a side of the cells of which texture is the share with a corner
_CORNER = 15.0  # squared grey levels per pixel of a cell's smaller eigenvalue; noise of 10 levels makes 4
_DARK = 0.002  # linear value below which 8 bits tell nothing
_THREADS = 2  # photos decoded at the same time at most: each takes memory
VIDEO_FRAMES = 60  # photos that a video is to give

_BLURRED, _FAR_BELOW = 0.3, 0.6  # sharpness of a blurred photo, and relative to the photos' median
_BARE = 0.005  # share of a photo with corners: below, nothing can be matched
_CLIPPED, _DARK_SHARE = 0.1, 0.9  # share of a photo at white, and as good as black, that spoils it
_ZOOMED = 0.03  # relative difference of focal lengths of one lens
_SMALL = 640  # pixels of the longer side below which little can be matched
_EXPOSURES = 1.0  # EV between the darkest and the brightest photo that count as different lights


@dataclass(frozen=True)
class PlainPhoto:
    """What was measured on one photo."""

    path: Path
    width: int
    height: int
    focal: float | None  # focal length over the longer side, None: not in the file
    ev100: float | None
    up: np.ndarray | None  # (3,) direction against gravity in the camera's axes, None: not in the file
    encoding: str | None  # colour encoding that is converted
    sharpness: float  # 0 for no detail, about .3 blurred, .6 and more sharp
    texture: float  # share of the picture with corners to match
    clipped: float  # share of pixels at the photo's white
    dark: float  # share of pixels that are as good as black
    thumbnail: np.ndarray  # (h, w) uint8 grey


def list_photos(folder: Path) -> list[Path]:
    """Return the photos in a folder, or in its `images` if it has one, and in subfolders, without masks.

    Of a raw file and its camera's picture of the same name only the raw file is taken, which is linear.
    Scenes and runs that were made in a subfolder hold no photos of their own.
    """
    folder = Path(folder)
    folder = folder / "images" if (folder / "images").is_dir() else folder
    images = list_images(folder)
    inner = {parent for path in images for parent in path.parents if folder in parent.parents}
    apart = {parent for parent in inner if any((parent / name).exists() for name in _MADE)}
    images = [path for path in images if not _MASKS & set(path.relative_to(folder).parts[:-1])]
    found = [path for path in images if apart.isdisjoint(path.parents)]
    raw = {path.with_suffix("") for path in found if path.suffix.lower() in imaging.RAW_SUFFIXES}
    return [
        path
        for path in found
        if path.suffix.lower() in imaging.RAW_SUFFIXES or path.with_suffix("") not in raw
    ]


def bright_level(luma: np.ndarray) -> float:
    """Return what stands for the white of a photo of radiance in any unit, from its linear luma (any shape).

    The 99th percentile of what is not black; 1 where all is.
    """
    lit = luma[luma > 0]
    return float(np.percentile(lit, 99)) if lit.size else 1.0


def measure_photo(path: Path) -> PlainPhoto:
    """Return what is measured on one photo; raise `InputError` naming the file when it cannot be read."""
    photo = imaging.PhotoFile(path)
    scale = min(1.0, _SIDE / max(photo.width, photo.height))
    height, width = (max(1, round(length * scale)) for length in (photo.height, photo.width))

    def planes(first: int, last: int) -> np.ndarray:
        color, _ = photo.rows(first, last)
        return np.dstack([color @ imaging.LUMA, photo.clipped_rows(first, last).any(axis=2)])

    small = imaging.resize_rows(planes, (photo.height, photo.width, 2), height, width)
    light = small[..., 0]
    bright = light if photo.has_white else light / bright_level(light)
    grey = np.clip(imaging.srgb_encode(bright), 0, 1) * 255
    return PlainPhoto(
        Path(path),
        photo.width,
        photo.height,
        imaging.focal_ratio(path),
        imaging.read_exif_ev100(path),
        imaging.gravity(path),
        imaging.foreign_encoding(path),
        sharpness(grey),
        texture(grey),
        float(small[..., 1].mean()),
        float((bright < _DARK).mean()),
        np.rint(imaging.shrink_area(grey, _THUMBNAIL)).astype(np.uint8),
    )


def measure_photos(paths: Iterable[Path], problems: Problems) -> list[PlainPhoto]:
    """Return the photos that can be read, measured, in order; what is wrong goes to `problems`."""
    found = []
    with ThreadPoolExecutor(min(_THREADS, os.cpu_count() or 1)) as pool:
        for waiting in [pool.submit(measure_photo, path) for path in paths]:
            with problems.guard():
                found.append(waiting.result())
    return found


def sharpness(grey: np.ndarray) -> float:
    """Return how much of a picture's detail blurring takes away, 0 to 1, the smaller of both axes.

    grey (h, w), 0 to 255. Motion blurs along its own direction only.
    """
    lost = []
    for axis in (0, 1):
        steps = np.abs(np.diff(grey, axis=axis))
        blurred = scipy.ndimage.uniform_filter1d(grey, _BLUR, axis=axis)
        kept = np.abs(np.diff(blurred, axis=axis))
        lost.append(np.maximum(steps - kept, 0).sum() / max(float(steps.sum()), 1e-6))
    return float(min(lost))


def texture(grey: np.ndarray) -> float:
    """Return the share of cells of 16 x 16 pixels of a picture (h, w), 0 to 255, that hold a corner."""
    if min(grey.shape) < 2:
        return 0.0
    smooth = scipy.ndimage.gaussian_filter(grey.astype(np.float32), 1.0)
    down, across = np.gradient(smooth)
    a, b, c = (_cell_means(product) for product in (across * across, across * down, down * down))
    if not a.size:
        return 0.0
    smaller = (a + c) / 2 - np.sqrt(((a - c) / 2) ** 2 + b * b)
    return float((smaller > _CORNER).mean())


def copies(photos: Sequence[PlainPhoto]) -> list[PlainPhoto]:
    """Return the photos that show the same as one before them in the list."""
    kept: list[PlainPhoto] = []
    found: list[PlainPhoto] = []
    for photo in photos:
        alike = any(difference(photo.thumbnail, other.thumbnail) < SAME for other in kept)
        (found if alike else kept).append(photo)
    return found


def _cell_means(values: np.ndarray) -> np.ndarray:
    """Return the means (h // 16, w // 16) of `values` (h, w) over its cells."""
    height, width = (length // _CELL for length in values.shape)
    return values[: height * _CELL, : width * _CELL].reshape(height, _CELL, width, _CELL).mean(axis=(1, 3))


@dataclass(frozen=True)
class PlainInspection:
    """Everything found on plain photos.

    Problems say that cameras can hardly be found; hints, that the result will be poor; advice, what to
    photograph next.
    """

    root: Path
    photos: tuple[PlainPhoto, ...] = ()
    problems: list[str] = field(default_factory=list)
    hints: list[str] = field(default_factory=list)
    advice: list[str] = field(default_factory=list)
    video: FrameChoice | None = None  # for a video, in place of photos

    def lines(self) -> list[str]:
        """Return the findings as text for a terminal: facts, problems, hints, and what to photograph next."""
        facts = [f"{'photos' if self.video is None else 'video '}   {self.root} (no cameras yet)"]
        facts += _photo_facts(self.photos) if self.video is None else _video_facts(self.video)
        said = [*numbered("problem", self.problems), *numbered("hint", self.hints)]
        return [printable(line) for line in (*facts, *said, *(f"next     {line}" for line in self.advice))]


def is_plain(path: Path) -> bool:
    """Return whether `path` is a video, or a folder with photos or a video, but without cameras."""
    if not path.is_dir():
        return path.is_file() and imaging.is_video(path)
    return not has_cameras(path) and bool(list_photos(path) or _videos(path))


def only_video(path: Path) -> Path | None:
    """Return `path` if it is a video, or the only video in a folder without photos, else None."""
    if not path.is_dir():
        return path if path.is_file() and imaging.is_video(path) else None
    found = [] if list_photos(path) else _videos(path)
    return found[0] if len(found) == 1 else None


def inspect_plain(path: Path) -> PlainInspection:
    """Examine plain photos in a folder, or a video, without stopping at what is wrong with one of them."""
    if not path.is_dir() or only_video(path) is not None:
        return _inspect_video(only_video(path) or path)
    problems = Problems(collect=True)
    photos = measure_photos(list_photos(path), problems)
    found = PlainInspection(path, tuple(photos), problems.messages)
    _judge_number(found)
    _judge_quality(found)
    _judge_cameras(found)
    values = [photo.ev100 for photo in photos if photo.ev100 is not None]
    if len(values) == len(photos) and values and max(values) - min(values) <= _EXPOSURES:
        found.advice.append(
            "the object under other lights: all photos have about the same exposure, as if taken under one."
        )
    if sentence := unread_cameras.beside(path):
        found.hints.append(f"{sentence[:-1]}, or let `prepare` find cameras anew.")
    if extra := _videos(path):
        found.hints.append(f"{len(extra)} videos beside the photos are left out, such as {extra[0].name}.")
    return found


def blurred(photos: Sequence[PlainPhoto]) -> list[PlainPhoto]:
    """Return the photos that are blurred, by themselves or beside the others."""
    if not photos:
        return []
    least = max(_BLURRED, _FAR_BELOW * float(np.median([photo.sharpness for photo in photos])))
    return [photo for photo in photos if photo.sharpness < least]


def _inspect_video(path: Path) -> PlainInspection:
    problems, choice = Problems(collect=True), FrameChoice((), 0, 0, 0)
    with problems.guard():
        choice = choose_frames(measure_frames(path), VIDEO_FRAMES)
    found = PlainInspection(path, problems=problems.messages, video=choice)
    if found.problems:
        return found
    count = len(choice.frames)
    if count < FEWEST:
        found.problems.append(
            f"The video gives {_count(count, 'different sharp frame')} of {choice.total}; {FEWEST} or more are needed."
        )
        found.advice.append(
            "film again, walking slowly around the object, with the camera always on it and in focus."
        )
    elif count < ENOUGH:
        found.hints.append(
            f"The video gives {count} different sharp frames; about {VIDEO_FRAMES} are better."
        )
        found.advice.append("film longer: once around at the object's height, once from above.")
    if choice.blurred * 4 > count:
        found.hints.append(
            f"{choice.blurred} stretches of the video have no sharp frame: move more slowly, in more light."
        )
    found.hints.append(
        "A video shows the object under one light; photos under other lights tell light and surface apart."
    )
    return found


def _judge_number(found: PlainInspection) -> None:
    """Add what is to be said of how many different photos there are."""
    alike = copies(found.photos)
    different = len(found.photos) - len(alike)
    if alike:
        verb = "shows" if len(alike) == 1 else "show"
        found.hints.append(
            f"{_count(len(alike), 'photo')} {verb} the same as another, such as {alike[0].path.name}; "
            "copies add nothing."
        )
    if different < FEWEST:
        found.problems.append(
            f"{_count(different, 'different photo')} of the object; {FEWEST} or more are needed."
        )
    if different < ENOUGH:
        found.advice.append(
            f"about {ENOUGH - different} more photos: all around at the object's height, every 15 degrees, and once "
            "more from above, each sharing most of what it shows with the one before."
        )


def _judge_quality(found: PlainInspection) -> None:
    """Add what is to be said of blur, texture, exposure, size and encoding."""
    photos = found.photos
    unsharp, bare = blurred(photos), [photo for photo in photos if photo.texture < _BARE]
    if unsharp:
        is_poor = 2 * len(unsharp) > len(photos)
        (found.problems if is_poor else found.hints).append(_such_as(unsharp, photos, "blurred"))
        found.advice.append("the blurred views again, with the camera at rest, in more light or on a stand.")
    if 2 * len(bare) > len(photos):
        found.problems.append(_such_as(bare, photos, "without texture that can be matched"))
        found.advice.append(
            "the object on something richly patterned, such as a newspaper, which moves along with it."
        )
    for bad, words in (
        (
            [photo for photo in photos if photo.clipped > _CLIPPED],
            f"at white in more than {_CLIPPED:.0%} of the picture: expose less",
        ),
        (
            [photo for photo in photos if photo.dark > _DARK_SHARE],
            f"as good as black in more than {_DARK_SHARE:.0%} of the picture: expose more",
        ),
        (
            [photo for photo in photos if max(photo.width, photo.height) < _SMALL],
            f"of fewer than {_SMALL} pixels: give the camera's own files",
        ),
        (
            [photo for photo in photos if photo.encoding == imaging.UNREADABLE],
            f"encoded with an {imaging.UNREADABLE}, and taken as sRGB",
        ),
    ):
        if bad:
            found.hints.append(_such_as(bad, photos, words))


def _judge_cameras(found: PlainInspection) -> None:
    """Add what is to be said of focal lengths, which the search for cameras starts from."""
    unknown = [photo for photo in found.photos if photo.focal is None]
    known = sorted(photo.focal for photo in found.photos if photo.focal is not None)
    if unknown:
        words = "without a focal length, which is then guessed: give unedited files"
        found.hints.append(_such_as(unknown, found.photos, words))
    lenses = 1 + sum(later > earlier * (1 + _ZOOMED) for earlier, later in pairwise(known))
    if known and lenses > 1:
        found.hints.append(
            f"The photos have {lenses} focal lengths, from {known[0]:.2f} to {known[-1]:.2f} of the longer side; one "
            "lens without zoom gives better cameras."
        )


def _photo_facts(photos: Sequence[PlainPhoto]) -> list[str]:
    if not photos:
        return ["readable none"]
    focal = [photo.focal for photo in photos if photo.focal is not None]
    lengths = f"{min(focal):.2f} to {max(focal):.2f} of the longer side" if focal else "not in the files"
    differ = len(photos) - len(copies(photos))
    facts = [
        f"readable {len(photos)}, of which {differ} differ and {len(blurred(photos))} are blurred",
        sizes([(photo.width, photo.height) for photo in photos]),
        f"focal    {lengths}" + (f" ({len(focal)} of {len(photos)} photos)" if focal else ""),
        exposures([photo.ev100 for photo in photos]),
    ]
    level = sum(photo.up is not None for photo in photos)
    facts += [f"gravity  in {level} of {len(photos)} photos"] if level else []
    converted = converted_encodings(photo.encoding for photo in photos)
    return facts + ([f"colours  converted to sRGB: {converted}"] if converted else [])


def _video_facts(choice: FrameChoice) -> list[str]:
    if not choice.total:
        return []
    left = f"left out: {choice.blurred} blurred, {choice.alike} like the one before"
    return [f"frames   {choice.total}, of which {len(choice.frames)} would be used ({left})"]


def _videos(folder: Path) -> list[Path]:
    found = (path for path in folder.iterdir() if path.suffix.lower() in imaging.VIDEO_SUFFIXES)
    return sorted(path for path in found if path.is_file())


def _such_as(some: Sequence[PlainPhoto], photos: Sequence[PlainPhoto], what: str) -> str:
    verb, name = "is" if len(some) == 1 else "are", some[0].path.name
    return f"{len(some)} of {len(photos)} photos {verb} {what}, such as {name}."


def _count(number: int, noun: str) -> str:
    return f"{number or 'no'} {noun}{'' if number == 1 else 's'}"
