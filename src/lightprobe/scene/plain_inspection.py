"""A look at plain photos or a video before cameras and masks are found for them: what would fail, what would
be poor.

Problems say that cameras can hardly be found; hints, that the result will be poor; advice, what to photograph
next.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from lightprobe.core.errors import printable
from lightprobe.imaging import UNREADABLE, VIDEO_SUFFIXES, is_video
from lightprobe.imaging.video import FrameChoice, choose_frames, measure_frames
from lightprobe.scene.findings import exposures, numbered, sizes
from lightprobe.scene.frame import Problems
from lightprobe.scene.loading import has_cameras
from lightprobe.scene.plain_photos import PlainPhoto, copies, list_photos, measure_photos

VIDEO_FRAMES = 60  # photos that a video is to give
_FEWEST, _ENOUGH = 8, 25  # different sharp photos: below, cameras are seldom found; below, parts stay unseen
_BLURRED, _FAR_BELOW = (
    0.3,
    0.6,
)  # sharpness of a blurred photo, and of one beside others in the others' median
_BARE = 0.005  # share of a photo with corners: below, nothing can be matched
_CLIPPED, _DARK = 0.1, 0.9  # share of a photo at white, and as good as black, that spoils it
_ZOOMED = 0.03  # relative difference of focal lengths of one lens
_SMALL = 640  # pixels of the longer side below which little can be matched
_EXPOSURES = 1.0  # EV between the darkest and the brightest surroundings that count as different lights


@dataclass(frozen=True)
class PlainInspection:
    """Everything found on plain photos."""

    root: Path
    photos: tuple[PlainPhoto, ...]
    problems: tuple[str, ...]
    hints: tuple[str, ...]
    advice: tuple[str, ...]  # what to photograph next
    video: FrameChoice | None = None  # for a video, in place of photos

    def lines(self) -> list[str]:
        """Return the findings as text for a terminal: facts, problems, hints, and what to photograph next."""
        facts = [f"{'photos' if self.video is None else 'video '}   {self.root} (no cameras yet)"]
        facts += _photo_facts(self.photos) if self.video is None else _video_facts(self.video)
        said = [*numbered("problem", self.problems), *numbered("hint", self.hints)]
        return [printable(line) for line in (*facts, *said, *(f"next     {line}" for line in self.advice))]


def is_plain(path: Path) -> bool:
    """Return whether `path` is a video, or a folder with photos or a video, but without cameras."""
    path = Path(path)
    if not path.is_dir():
        return path.is_file() and is_video(path)
    return not has_cameras(path) and bool(list_photos(path) or _videos(path))


def only_video(path: Path) -> Path | None:
    """Return the video that stands for photos: `path` itself, or the only one in a folder without photos,
    else None.
    """
    path = Path(path)
    if not path.is_dir():
        return path if path.is_file() and is_video(path) else None
    found = [] if list_photos(path) else _videos(path)
    return found[0] if len(found) == 1 else None


def inspect_plain(path: Path) -> PlainInspection:
    """Examine plain photos in a folder, or a video, without stopping at what is wrong with one of them."""
    path = Path(path)
    if not path.is_dir():
        return _inspect_video(path)
    if (video := only_video(path)) is not None:
        return _inspect_video(video)
    files = list_photos(path)
    problems = Problems(collect=True)
    photos = measure_photos(files, problems)
    hints, advice = list[str](), list[str]()
    _judge_number(photos, problems.messages, hints, advice)
    _judge_quality(photos, problems.messages, hints, advice)
    hints += _camera_hints(photos)
    advice += _light_advice(photos)
    if extra := _videos(path):
        hints.append(f"{len(extra)} videos beside the photos are left out, such as {extra[0].name}.")
    return PlainInspection(path, tuple(photos), tuple(problems.messages), tuple(hints), tuple(advice))


def blurred(photos: Sequence[PlainPhoto]) -> list[PlainPhoto]:
    """Return the photos that are blurred, by themselves or beside the others."""
    if not photos:
        return []
    least = max(_BLURRED, _FAR_BELOW * float(np.median([photo.sharpness for photo in photos])))
    return [photo for photo in photos if photo.sharpness < least]


def _inspect_video(path: Path) -> PlainInspection:
    problems, hints, advice = Problems(collect=True), list[str](), list[str]()
    choice = None
    with problems.guard():
        choice = choose_frames(measure_frames(path), VIDEO_FRAMES)
    if choice is None:
        return PlainInspection(path, (), tuple(problems.messages), (), (), FrameChoice((), 0, 0, 0))
    count = len(choice.frames)
    if count < _FEWEST:
        problems.messages.append(
            f"The video gives {_count(count, 'different sharp frame')} of {choice.total}; {_FEWEST} or more are needed."
        )
        advice.append(
            "film again, walking slowly around the object, with the camera always on it and in focus."
        )
    elif count < _ENOUGH:
        hints.append(f"The video gives {count} different sharp frames; about {VIDEO_FRAMES} are better.")
        advice.append("film longer: once around at the object's height, once from above.")
    if choice.blurred * 4 > count:
        hints.append(
            f"{choice.blurred} stretches of the video have no sharp frame: move more slowly, in more light."
        )
    hints.append(
        "A video shows the object under one light; photos under other lights tell light and surface apart."
    )
    return PlainInspection(path, (), tuple(problems.messages), tuple(hints), tuple(advice), choice)


def _judge_number(
    photos: Sequence[PlainPhoto], problems: list[str], hints: list[str], advice: list[str]
) -> None:
    """Add what is to be said of how many different photos there are."""
    alike = copies(photos)
    different = len(photos) - len(alike)
    if alike:
        verb = "shows" if len(alike) == 1 else "show"
        hints.append(
            f"{_count(len(alike), 'photo')} {verb} the same as another, such as {alike[0].path.name}; "
            "copies add nothing."
        )
    if different < _FEWEST:
        problems.append(
            f"{_count(different, 'different photo')} of the object; {_FEWEST} or more are needed."
        )
    if different < _ENOUGH:
        advice.append(
            f"about {_ENOUGH - different} more photos: all around at the object's height, every 15 degrees, and once "
            "more from above, each sharing most of what it shows with the one before."
        )


def _judge_quality(
    photos: Sequence[PlainPhoto], problems: list[str], hints: list[str], advice: list[str]
) -> None:
    """Add what is to be said of blur, texture, exposure and size."""
    unsharp, bare = blurred(photos), [photo for photo in photos if photo.texture < _BARE]
    if unsharp:
        (problems if 2 * len(unsharp) > len(photos) else hints).append(_such_as(unsharp, photos, "blurred"))
        advice.append("the blurred views again, with the camera at rest, in more light or on a stand.")
    if 2 * len(bare) > len(photos):
        problems.append(_such_as(bare, photos, "without texture that can be matched"))
        advice.append(
            "the object on something richly patterned, such as a newspaper, which moves along with it."
        )
    if white := [photo for photo in photos if photo.clipped > _CLIPPED]:
        hints.append(
            _such_as(white, photos, f"at white in more than {_CLIPPED:.0%} of the picture: expose less")
        )
    if dark := [photo for photo in photos if photo.dark > _DARK]:
        hints.append(
            _such_as(dark, photos, f"as good as black in more than {_DARK:.0%} of the picture: expose more")
        )
    if small := [photo for photo in photos if max(photo.width, photo.height) < _SMALL]:
        hints.append(_such_as(small, photos, f"of fewer than {_SMALL} pixels: give the camera's own files"))
    if odd := [photo for photo in photos if photo.encoding == UNREADABLE]:
        hints.append(_such_as(odd, photos, f"encoded with an {UNREADABLE}, and taken as sRGB"))


def _camera_hints(photos: Sequence[PlainPhoto]) -> list[str]:
    """Return what is to be said of focal lengths, which the search for cameras starts from."""
    unknown = [photo for photo in photos if photo.focal is None]
    known = sorted(photo.focal for photo in photos if photo.focal is not None)
    hints = []
    if unknown:
        hints.append(
            _such_as(unknown, photos, "without a focal length, which is then guessed: give unedited files")
        )
    lenses = 1 + sum(later > earlier * (1 + _ZOOMED) for earlier, later in pairwise(known))
    if known and lenses > 1:
        hints.append(
            f"The photos have {lenses} focal lengths, from {known[0]:.2f} to {known[-1]:.2f} of the longer side; one "
            "lens without zoom gives better cameras."
        )
    return hints


def _light_advice(photos: Sequence[PlainPhoto]) -> list[str]:
    values = [photo.ev100 for photo in photos if photo.ev100 is not None]
    if len(values) < len(photos) or not values or max(values) - min(values) > _EXPOSURES:
        return []
    return ["the object under other lights: all photos have about the same exposure, as if taken under one."]


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
    names = Counter(photo.encoding for photo in photos if photo.encoding not in (None, UNREADABLE))
    listed = ", ".join(f"{name} ({count})" for name, count in names.most_common())
    return facts + ([f"colours  converted to sRGB: {listed}"] if listed else [])


def _video_facts(choice: FrameChoice) -> list[str]:
    if not choice.total:
        return []
    left = f"left out: {choice.blurred} blurred, {choice.alike} like the one before"
    return [f"frames   {choice.total}, of which {len(choice.frames)} would be used ({left})"]


def _videos(folder: Path) -> list[Path]:
    return sorted(
        path for path in folder.iterdir() if path.suffix.lower() in VIDEO_SUFFIXES and path.is_file()
    )


def _such_as(some: Sequence[PlainPhoto], photos: Sequence[PlainPhoto], what: str) -> str:
    return f"{len(some)} of {len(photos)} photos {'is' if len(some) == 1 else 'are'} {what}, such as {some[0].path.name}."


def _count(number: int, noun: str) -> str:
    return f"{number or 'no'} {noun}{'' if number == 1 else 's'}"
