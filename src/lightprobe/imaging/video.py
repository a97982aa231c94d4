"""Frames out of a video file, upright and in linear light, and the choice of those that are worth a photo.

Only the containers that cameras write are opened, by their content, and each by its own parser, so that
nothing in a file can lead to another file. Ten-bit video in PQ or HLG becomes linear as such photos do: 1.0
is its reference white.
"""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.core.extras import photo_library
from lightprobe.core.files import filled_folder
from lightprobe.core.reading import LARGEST_VIDEO, check_file
from lightprobe.imaging.color import srgb_encode
from lightprobe.imaging.encodings import coded
from lightprobe.imaging.exif import upright
from lightprobe.imaging.limits import check_pixels
from lightprobe.imaging.opening import STILL_BRANDS
from lightprobe.imaging.photo_file import linear_srgb

_START = 16  # bytes of a file that tell its container
_PACKET = 188  # bytes of a packet of an MPEG transport stream
_SHARPNESS_SIDE = 640  # pixels of the longer side that sharpness is measured on, coarser than noise
_THUMBNAIL_SIDE = 48  # pixels of the longer side that frames are compared on
_SAME = 0.04  # mean difference of two frames that show the same, in the standard deviation of one
_BLURRED = 0.4  # of the median sharpness of the chosen frames around: below, a frame is blurred
_AROUND = 4  # chosen frames to each side that a frame's sharpness is compared with
_ODDEST = 4.0  # times as wide as high, or as high as wide: pixels beyond are damage
_QUALITY = 95  # of JPEG files: what a video's own compression left is more than this takes
# Turn anticlockwise that a file asks for, in degrees -> EXIF orientation
_TURNS = {0: 1, 90: 8, -90: 6, 180: 3, -180: 3}
_HIGH_DEFINITION = 720  # rows from which video without a stated matrix has BT.709's instead of BT.601's
# Matrix coefficients of H.273 -> swscale's number of them; 2 is not stated
_MATRICES = {1: 1, 4: 4, 5: 5, 6: 5, 7: 7, 9: 9, 10: 9}


@dataclass(frozen=True)
class VideoFrame:
    """One frame of a video."""

    index: int  # from 0
    seconds: float  # from the video's beginning
    color: np.ndarray  # (H, W, 3) float32 linear sRGB, upright


@dataclass(frozen=True)
class FrameMeasure:
    """What the choice of frames goes by."""

    index: int
    seconds: float
    sharpness: float  # mean squared gradients, geometric mean of both axes, over the variance of grey values
    thumbnail: np.ndarray  # (h, w) uint8 grey


@dataclass(frozen=True)
class FrameChoice:
    """Frames worth a photo, and what was left out."""

    frames: tuple[FrameMeasure, ...]
    total: int  # frames of the video
    blurred: int  # chosen for their time, but blurred
    alike: int  # chosen for their time, but showing the same as the one before


def is_video(path: Path) -> bool:
    """Return whether a file is a video of a kind that is read, by its content; False for anything else."""
    try:
        return _container(Path(path)) is not None
    except InputError:
        return False


def frames(path: Path, every: int = 1) -> Iterator[VideoFrame]:
    """Yield every `every`-th frame of a video.

    Raises `InputError` naming the file when it is missing, damaged before its first frame, no video, or needs
    a library that is not installed; a video that is damaged later ends there, with a warning.
    """
    for index, frame, aspect in _decoded(Path(path)):
        if index % every == 0:
            yield VideoFrame(index, float(frame.time or 0.0), _color(frame, aspect))


def measure_frames(path: Path) -> list[FrameMeasure]:
    """Return sharpness and a thumbnail of every frame of a video; raises `InputError` as `frames`."""
    found = []
    for index, frame, _ in _decoded(Path(path)):
        grey = _small(frame, _SHARPNESS_SIDE).astype(np.float32)
        down, across = np.diff(grey, axis=0), np.diff(grey, axis=1)
        # Motion blurs along its own direction only, so that both must be sharp.
        sharpness = float(np.sqrt(np.mean(down**2) * np.mean(across**2)) / max(float(grey.var()), 1.0))
        found.append(FrameMeasure(index, float(frame.time or 0.0), sharpness, _small(frame, _THUMBNAIL_SIDE)))
    return found


def choose_frames(measured: list[FrameMeasure], count: int) -> FrameChoice:
    """Return about `count` sharp frames, well spread over a video's time.

    The video is cut into `count` stretches, each of which gives its sharpest frame; of these the blurred are
    dropped, and those that show the same as the one kept before.
    """
    edges = np.linspace(0, len(measured), min(count, len(measured)) + 1).round().astype(int)
    best = [max(measured[first:last], key=lambda frame: frame.sharpness) for first, last in pairwise(edges)]
    sharp = [frame for k, frame in enumerate(best) if frame.sharpness >= _BLURRED * _median_around(best, k)]
    kept: list[FrameMeasure] = []
    for frame in sharp:
        if not kept or difference(kept[-1].thumbnail, frame.thumbnail) >= _SAME:
            kept.append(frame)
    return FrameChoice(tuple(kept), len(measured), len(best) - len(sharp), len(sharp) - len(kept))


def difference(first: np.ndarray, second: np.ndarray) -> float:
    """Return the mean difference of two grey thumbnails (h, w) uint8 in standard deviations.

    0 for the same picture, about 1 for two that have nothing in common; infinite for two of different size.
    """
    if first.shape != second.shape:
        return float("inf")
    a, b = (picture.astype(np.float64) - picture.mean() for picture in (first, second))
    deviations = max(a.std(), 1.0), max(b.std(), 1.0)
    return float(np.abs(a / deviations[0] - b / deviations[1]).mean())


def extract_frames(path: Path, folder: Path, count: int) -> FrameChoice:
    """Write about `count` sharp, well-spread frames of a video as JPEG into `folder`, and return the choice.

    Files are called `frame_000123.jpg` by the frame's number; the folder may exist. Raises `InputError` as
    `frames`, and for a video that gives fewer than two different frames.
    """
    path = Path(path)
    choice = choose_frames(measure_frames(path), count)
    if len(choice.frames) < 2:
        raise InputError(
            f"{path} shows one and the same picture in all of its {choice.total} frames; "
            "film the object while walking around it, or give photos."
        )
    wanted = {frame.index for frame in choice.frames}
    with filled_folder(Path(folder)) as temporary:
        for index, frame, aspect in _decoded(path):
            if index in wanted:
                picture = np.clip(srgb_encode(_color(frame, aspect)) * 255 + 0.5, 0, 255).astype(np.uint8)
                file = temporary / f"frame_{index:06d}.jpg"
                Image.fromarray(picture).save(file, quality=_QUALITY, subsampling=0)
    return choice


def _container(path: Path) -> str | None:
    """Return FFmpeg's name of the parser for a file's container, or None when it is no video that is read."""
    check_file(path, LARGEST_VIDEO)
    try:
        with open(path, "rb") as file:
            start = file.read(_START)
            file.seek(_PACKET)
            later = file.read(_START)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error
    if start[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"):
        return None if start[4:8] == b"ftyp" and start[8:12] in STILL_BRANDS else "mov"
    if start[:4] == b"RIFF":
        return "avi" if start[8:12] == b"AVI " else None
    # Packets of 188 bytes begin with G; cameras put a time of four bytes before each.
    if (start[:1] == later[:1] == b"G") or (start[4:5] == later[8:9] == b"G"):
        return "mpegts"
    return {b"\x1a\x45\xdf\xa3": "matroska", b"\0\0\1\xba": "mpeg"}.get(start[:4])


def _decoded(path: Path) -> Iterator[tuple[int, Any, float]]:
    """Yield number and frame as PyAV has it, and its pixels' width over height, up to the end or damage."""
    container = _container(path)
    if container is None:
        raise InputError(f"{path} is not a video (MP4, MOV, MKV, WebM, AVI or MPEG).")
    library = photo_library("av", path)
    index = -1
    try:
        with (
            open(path, "rb") as file,
            library.open(file, format=container, metadata_errors="replace") as video,
        ):
            if not video.streams.video:
                raise InputError(f"{path} holds no pictures, only sound or data; give a video of the object.")
            stream = video.streams.video[0]
            if stream.codec_context is None:
                raise InputError(
                    f"{path} is coded in a way that is not read, or damaged; convert it to H.264."
                )
            check_pixels(path, stream.codec_context.width, stream.codec_context.height)
            for index, frame in enumerate(video.decode(stream)):
                yield index, frame, _aspect(stream)
    except library.error.FFmpegError as error:
        if index < 0:
            reason = str(error.strerror or error).rstrip(".")
            raise InputError(
                f"{path} cannot be decoded ({reason}); it is damaged or cut short: copy it again."
            ) from error
        sentence = f"{path} is damaged behind its frame {index}; only the frames up to it are used."
        warnings.warn(sentence, LightprobeWarning, stacklevel=3)
    if index < 0:
        raise InputError(f"{path} holds no frame that can be decoded; copy it again.")


def _small(frame: Any, side: int) -> np.ndarray:
    """Return a frame in grey, (h, w) uint8, its longer side of at most `side` pixels, not turned."""
    scale = min(1.0, side / max(frame.width, frame.height))
    width, height = (max(1, round(length * scale)) for length in (frame.width, frame.height))
    return frame.reformat(width=width, height=height, format="gray", interpolation="AREA").to_ndarray()


def _aspect(stream: Any) -> float:
    """Return the width of a pixel over its height: DV, HDV and DVDs keep pictures narrower than shown."""
    told = stream.sample_aspect_ratio
    return float(told) if told and 1 / _ODDEST <= told <= _ODDEST else 1.0


def _color(frame: Any, aspect: float) -> np.ndarray:
    """Return linear sRGB (H, W, 3) float32, upright, of a frame of pixels `aspect` times as wide as high."""
    deep = frame.format.components[0].bits > 8
    matrix = _MATRICES.get(int(frame.colorspace), 1 if frame.height >= _HIGH_DEFINITION else 5)
    width = max(1, round(frame.width * aspect))
    samples = frame.reformat(width, format="rgb48le" if deep else "rgb24", src_colorspace=matrix).to_ndarray()
    encoding = coded(int(frame.color_primaries), int(frame.color_trc))
    turned = upright(samples, _TURNS.get(int(frame.rotation), 1))
    return linear_srgb(turned, 65535 if deep else 255, encoding)


def _median_around(best: list[FrameMeasure], place: int) -> float:
    around = best[max(0, place - _AROUND) : place + _AROUND + 1]
    return float(np.median([frame.sharpness for frame in around]))
