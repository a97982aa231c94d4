"""Videos that tests encode themselves: a camera that pans over a random wall."""

from fractions import Fraction

import av
import numpy as np
import scipy

_RNG = np.random.default_rng(4)
_WALL = np.kron(_RNG.integers(0, 256, (24, 120, 1)), np.ones((5, 5, 3)))  # a panorama that a camera pans over


def write_video(path, pictures, *, codec="mpeg4", pixels="yuv420p", rate=10, **settings):
    """Encode uint8 pictures (H, W, 3), or uint16 ones for deep pixel formats."""
    with av.open(str(path), "w") as video:
        stream = video.add_stream(codec, rate=rate)
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = pixels
        stream.bit_rate = 8_000_000
        for key, value in settings.items():
            setattr(stream.codec_context, key, value)
        for index, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(
                picture, format="rgb24" if picture.dtype == np.uint8 else "rgb48le"
            )
            frame.pts, frame.time_base = index, Fraction(1, rate)
            video.mux(stream.encode(frame))
        video.mux(stream.encode())
    return path


def pan(count, blurred=(), still=()):
    """Pictures of a camera that pans by 4 pixels a frame, some of them blurred, some without moving on."""
    place, found = 0, []
    for index in range(count):
        place += 0 if index in still else 4
        picture = _WALL[:, place : place + 160]
        found.append(scipy.ndimage.gaussian_filter(picture, (0, 6, 0)) if index in blurred else picture)
    return [picture.astype(np.uint8) for picture in found]
