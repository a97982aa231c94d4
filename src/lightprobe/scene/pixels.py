"""Decoded pixels of one photo, at the size asked for.

Area averaging happens in linear light with colour premultiplied by alpha, so that background never bleeds in.
It is done a few rows at a time: a photo of a hundred million pixels takes no more memory than its 8-bit
samples.

One rule for turned photos: photo, mask and camera belong to the same picture. A photo is turned upright as
its EXIF orientation says, unless its camera fits only the pixels as stored. A mask follows its own
orientation if its file has one; without one it lies on the photo's stored pixels and is turned along with
them, unless it fits only unturned.

A photo whose camera has a lens is resampled to the pinhole camera's picture before all else, and its mask
too.
"""

import functools
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from lightprobe import imaging
from lightprobe.core.errors import InputError
from lightprobe.scene.camera import Camera
from lightprobe.scene.distortion import Resampling, bilinear, span
from lightprobe.scene.masks import mask_turn
from lightprobe.scene.photo import OPAQUE, Photo, Pixels, averaged, reduced_size


def load_pixels(photo: Photo, max_side: int | None = None) -> tuple[Pixels, Camera]:
    """Decode a photo and its mask, reduced to at most `max_side` pixels, and return the camera to match.

    Colour is linear and straight; it is 0 where alpha is 0. Raises `InputError` naming the file when the
    photo or mask is missing or damaged, when their sizes differ, or when the mask shows no object.
    """
    return _pixels(_Opened(photo), *_size_within(photo.camera, max_side))


def load_observed(photo: Photo, most_opaque: int) -> tuple[Pixels, Camera]:
    """Return `load_pixels(photo)` as `Pixels.within` reduces it to about `most_opaque` pixels in the mask.

    The same values, but the photo is never held whole: of one larger than `limits.WORKED_PIXELS` with a small
    object it is that many pixels at most.
    """
    opened = _Opened(photo)
    opaque = sum(int((opened.alpha_rows(*strip) >= OPAQUE).sum()) for strip in opened.strips())
    height, width = imaging.worked_size(
        photo.image_path, opened.size, reduced_size(opened.size, opaque, most_opaque)
    )
    return _pixels(opened, height, width)


def _pixels(opened: "_Opened", height: int, width: int) -> tuple[Pixels, Camera]:
    """Return what `load_pixels` does at one size."""
    if (height, width) == opened.size:
        color, alpha, clipped = opened.whole()
        color *= alpha[..., None] > 0
        pixels = Pixels(color, alpha, clipped)
    else:
        pixels = opened.reduced(height, width)
    return pixels, replace(opened.camera.resized(width, height), lens=None)


def load_thumbnail(photo: Photo, max_side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return linear straight colour (h, w, 3), background included, and alpha (h, w), averaged separately.

    Size and errors as `load_pixels`.
    """
    return load_shown(photo, max_side)[:2]


def load_shown(photo: Photo, max_side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return `load_thumbnail` and the share (h, w, 3) of each pixel that the photo's white hides."""
    return _Opened(photo).shown(*_size_within(photo.camera, max_side))


def load_alpha(photo: Photo, max_side: int | None = None) -> np.ndarray:
    """Return only the coverage of a photo, (H, W) float32 in [0, 1]; otherwise as `load_pixels`."""
    opened = _Opened(photo)
    alpha = imaging.resize_rows(opened.alpha_rows, opened.size, *_size_within(photo.camera, max_side))
    opened.check_seen()
    return alpha


def fit_camera(camera: Camera, image_path: Path, source: str) -> Camera:
    """Return `camera` for the pixels of its image file, which may have been scaled since its estimate.

    Programs differ in whether they turn photos by their EXIF orientation; the shape of the image decides
    which was meant. Raises `InputError` naming `source` when the shape fits neither way.
    """
    sizes = [imaging.image_size(image_path), imaging.image_size(image_path, orient=False)]
    for width, height in sizes:
        scale = max(width, height) / max(camera.width, camera.height)
        if max(abs(camera.width * scale - width), abs(camera.height * scale - height)) <= 1.5:
            is_same = (width, height) == (camera.width, camera.height)
            return camera if is_same else camera.resized(width, height)
    raise InputError(
        f"{image_path} has {sizes[0][0]} x {sizes[0][1]} pixels, but {source} describes a camera of "
        f"{camera.width} x {camera.height}; use the photos the cameras were estimated from, uncropped."
    )


# Colour (h, W, 3), alpha (h, W) and the share at white (h, W, 3) of the rows first..last - 1
_Rows = Callable[[int, int], tuple[np.ndarray, np.ndarray, np.ndarray]]


class _Opened:
    """A photo and its mask, turned to fit each other and the camera, and handed out rows at a time.

    Each is decoded when its rows are first asked for.
    """

    def __init__(self, photo: Photo):
        self._photo = photo
        self._mask_file = photo.mask_path or photo.image_path
        self._turn, mask_turn = _turns(photo)
        self._mask = None if photo.mask_path is None else imaging.PhotoFile(photo.mask_path, turn=mask_turn)
        self._highest = 0.0  # of the coverage handed out
        self._resampling = None if photo.camera.lens is None else Resampling(photo.camera)
        self.camera = photo.camera
        self.size = (photo.camera.height, photo.camera.width)
        self._check_mask()

    @functools.cached_property
    def _image(self) -> imaging.PhotoFile:
        return imaging.PhotoFile(self._photo.image_path, turn=self._turn)

    def rows(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return linear straight colour (h, W, 3), alpha (h, W) and clipped (h, W, 3) of some rows."""
        color, alpha, white = self._read(self._clipped, first, last)
        return color, alpha, white > 0

    def strips(self) -> Iterator[tuple[int, int]]:
        """Yield (first, last) of consecutive strips of rows that are worked on at once."""
        return (self._mask or self._image).strips()

    def alpha_rows(self, first: int, last: int) -> np.ndarray:
        """Return alpha (h, W) of the rows first..last - 1."""
        if self._mask is None:
            return self.rows(first, last)[1]
        mask = self._mask
        if self._resampling is None:
            alpha = mask.mask_rows(first, last)
        else:
            alpha = self._straight(lambda *strip: mask.mask_rows(*strip)[..., None], first, last)[..., 0]
        self._highest = max(self._highest, float(alpha.max()))
        return alpha

    def _read(self, stored: _Rows, first: int, last: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return what `stored` returns of the photo as its lens made it, of the pinhole's picture.

        The object's colour is averaged with its coverage as weight, where it has any: no background bleeds
        in.
        """
        if self._resampling is None:
            color, alpha, white = stored(first, last)
        else:

            def planes(first: int, last: int) -> np.ndarray:
                color, alpha, white = stored(first, last)
                return np.dstack([color * alpha[..., None], alpha, color, white])

            found = self._straight(planes, first, last)
            alpha, white = np.ascontiguousarray(found[..., 3]), found[..., 7:]
            own = found[..., :3] / np.maximum(alpha, 1e-6)[..., None]
            color = np.where(alpha[..., None] > 1e-6, own, found[..., 4:7])
        self._highest = max(self._highest, float(alpha.max()))
        return color, alpha, white

    def _stored(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return colour (h, W, 3), alpha (h, W) and what is at white (h, W, 3) of the photo as its lens made it."""
        color, own = self._image.rows(first, last)
        alpha = own if self._mask is None else self._mask.mask_rows(first, last)
        if alpha is None:
            raise ValueError("Checked to have one.")
        return color, alpha, self._image.clipped_rows(first, last)

    def _clipped(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return `_stored` with what is at white on the object alone."""
        color, alpha, white = self._stored(first, last)
        return color, alpha, white & (alpha[..., None] > 0)

    def _straight(self, read: Callable[[int, int], np.ndarray], first: int, last: int) -> np.ndarray:
        """Return rows first..last - 1 (h, W, C) of the pinhole's picture; `read` returns the lens' rows."""
        if self._resampling is None:
            raise ValueError("The photo has no lens.")
        places, shown = self._resampling.places(first, last)
        top, bottom = span(places, shown)
        return bilinear(read(top, min(bottom, self.size[0])), top, places) * shown[..., None]

    def whole(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return linear colour (H, W, 3), background included, alpha (H, W), and clipped (H, W, 3) bool."""
        color, alpha = np.empty((*self.size, 3), np.float32), np.empty(self.size, np.float32)
        clipped = np.empty((*self.size, 3), bool)
        for first, last in self.strips():
            color[first:last], alpha[first:last], clipped[first:last] = self.rows(first, last)
        self.check_seen()
        return color, alpha, clipped

    def reduced(self, height: int, width: int) -> Pixels:
        """Return the pixels area-averaged to `height` x `width`, colour premultiplied meanwhile."""
        pixels = averaged(self.rows, self.size, (height, width))
        self.check_seen()
        return pixels

    def shown(self, height: int, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return colour (height, width, 3), alpha (height, width) and the share of white, each for itself."""

        def planes(first: int, last: int) -> np.ndarray:
            return np.dstack(self._read(self._stored, first, last))

        small = imaging.resize_rows(planes, (*self.size, 7), height, width)
        self.check_seen()
        color, alpha, share = (np.ascontiguousarray(part) for part in np.split(small, [3, 4], axis=2))
        return color, alpha[..., 0], share

    def check_seen(self) -> None:
        """Raise `InputError` when all coverage has been handed out and no pixel shows the object."""
        if self._highest < OPAQUE:
            raise InputError(
                f"{self._mask_file} shows no object (its brightest pixel is {self._highest * 255:.0f} of 255); "
                "the object must be white, or remove the photo."
            )

    def _check_mask(self) -> None:
        """Raise `InputError` unless there is a mask, and of the photo's size."""
        mask, (height, width) = self._mask or self._image, self.size
        if self._mask is None and not mask.has_alpha:
            raise InputError(
                f"{self._photo.image_path} has no mask: give it an alpha channel, or a picture of the object in white "
                f"on black, in a scene masks/{self._photo.image_path.stem}.png beside the images folder, for a "
                "prediction with --mask."
            )
        if (mask.height, mask.width) != self.size:
            raise InputError(
                f"{self._mask_file} has {mask.width} x {mask.height} pixels, but its photo has {width} x {height}; "
                "a mask needs the size of its photo."
            )


def _turns(photo: Photo) -> tuple[int, int]:
    """Return the EXIF orientations, 1 for none, by which the photo's stored pixels and its mask's turn."""
    size = (photo.camera.width, photo.camera.height)
    stored = imaging.image_size(photo.image_path, orient=False)
    tag = imaging.read_orientation(photo.image_path) or 1
    turn = next((turn for turn in (tag, 1) if imaging.turned_size(stored, turn) == size), None)
    if turn is None:
        raise InputError(f"{photo.image_path} no longer has the {size[0]} x {size[1]} pixels of its camera.")
    if photo.mask_path is None:
        return turn, turn
    if turn == tag:
        return turn, mask_turn(photo.mask_path, photo.image_path, size)
    mask = imaging.image_size(photo.mask_path, orient=False)  # the camera is for the stored photo
    return turn, next((turn for turn in (1, imaging.undo(tag)) if imaging.turned_size(mask, turn) == size), 1)


def _size_within(camera: Camera, max_side: int | None) -> tuple[int, int]:
    """Return the (height, width) of a photo scaled down so that no side exceeds `max_side`."""
    camera = camera if max_side is None else camera.within(max_side)
    return camera.height, camera.width
