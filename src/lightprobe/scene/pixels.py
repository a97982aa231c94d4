"""Decoded pixels of one photo, at the size asked for.

Area averaging happens in linear light with colour premultiplied by alpha, so that background never bleeds in.
"""

from pathlib import Path

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.imaging import image_size, read_alpha, read_ldr, read_mask, resize_area
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Photo, Pixels


def load_pixels(photo: Photo, max_side: int | None = None) -> tuple[Pixels, Camera]:
    """Decode a photo and its mask, scaled down so that no side exceeds `max_side`, and return the camera to match.

    Colour is linear and straight; it is 0 where alpha is 0. Raises `InputError` naming the file when the photo or mask
    is missing or damaged, when their sizes differ, or when the mask shows no object.
    """
    color, alpha = decode(photo)
    color = np.where(alpha[..., None] > 0, color, np.float32(0))
    width, height = target_size(photo.camera, max_side)
    return Pixels.of(color, alpha).resized(height, width), photo.camera.resized(width, height)


def decode(photo: Photo) -> tuple[np.ndarray, np.ndarray]:
    """Return linear straight colour (H, W, 3), background included, and alpha (H, W) at full size; errors as above."""
    color, alpha = read_ldr(photo.image_path, orient=_follows_orientation(photo))
    return color, _checked_alpha(photo, alpha) if photo.mask_path is None else load_alpha(photo)


def load_alpha(photo: Photo, max_side: int | None = None) -> np.ndarray:
    """Return only the coverage of a photo, (H, W) float32 in [0, 1]; otherwise as `load_pixels`."""
    orient = _follows_orientation(photo)
    if photo.mask_path is None:
        alpha = _checked_alpha(photo, read_alpha(photo.image_path, orient=orient))
    else:
        alpha = _checked_alpha(photo, read_mask(photo.mask_path, orient=orient))
    width, height = target_size(photo.camera, max_side)
    return alpha if (height, width) == alpha.shape else resize_area(alpha, height, width)


def fit_camera(camera: Camera, image_path: Path, source: str) -> Camera:
    """Return `camera` for the pixels of its image file, which may have been scaled since the camera was estimated.

    Programs differ in whether they turn photos by their EXIF orientation; the shape of the image decides which was
    meant. Raises `InputError` naming `source` when the shape fits neither way.
    """
    sizes = [image_size(image_path), image_size(image_path, orient=False)]
    for width, height in sizes:
        scale = max(width, height) / max(camera.width, camera.height)
        if max(abs(camera.width * scale - width), abs(camera.height * scale - height)) <= 1.5:
            return camera if (width, height) == (camera.width, camera.height) else camera.resized(width, height)
    raise InputError(
        f"{image_path} has {sizes[0][0]} x {sizes[0][1]} pixels, but {source} describes a camera of "
        f"{camera.width} x {camera.height}; use the photos the cameras were estimated from, uncropped."
    )


def _follows_orientation(photo: Photo) -> bool:
    """Tell whether the camera is for the upright photo (True) or for its pixels as stored; see `fit_camera`."""
    size = (photo.camera.width, photo.camera.height)
    if image_size(photo.image_path) == size:
        return True
    if image_size(photo.image_path, orient=False) == size:
        return False
    raise InputError(f"{photo.image_path} no longer has the {size[0]} x {size[1]} pixels of its camera.")


def _checked_alpha(photo: Photo, alpha: np.ndarray | None) -> np.ndarray:
    """Return `alpha` if it is there, has the photo's size and shows something; raise `InputError` otherwise."""
    if alpha is None:
        raise InputError(
            f"{photo.image_path} has no mask: give it an alpha channel, or a picture of the object in white on black, "
            f"in a scene masks/{photo.image_path.stem}.png beside the images folder, for a prediction with --mask."
        )
    path = photo.mask_path or photo.image_path
    width, height = photo.camera.width, photo.camera.height
    if alpha.shape != (height, width):
        raise InputError(
            f"{path} has {alpha.shape[1]} x {alpha.shape[0]} pixels, but its photo has {width} x {height}; "
            "a mask needs the size of its photo."
        )
    if alpha.max() < 0.5:
        raise InputError(
            f"{path} shows no object (its brightest pixel is {alpha.max() * 255:.0f} of 255); "
            "the object must be white, or remove the photo."
        )
    return alpha


def target_size(camera: Camera, max_side: int | None) -> tuple[int, int]:
    """Return (width, height) of a photo scaled down so that no side exceeds `max_side`."""
    longest = max(camera.width, camera.height)
    if max_side is None or max_side >= longest:
        return camera.width, camera.height
    scale = max_side / longest
    return max(1, round(camera.width * scale)), max(1, round(camera.height * scale))
