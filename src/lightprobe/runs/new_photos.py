"""Photos from outside a run's scene, as predictions take them: with cameras, given or found, and backgrounds."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lightprobe.core.run import RunFolder
from lightprobe.imaging import image_size, read_exif_ev100, read_ldr, read_mask
from lightprobe.prediction import Predictor
from lightprobe.runs.locations import LocatedPhoto, LocationFiles, locate_photo, own_entry
from lightprobe.scene import Photo, load_pixels, new_photo
from lightprobe.scene.background import Background, is_opaque, load_background
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Pixels
from lightprobe.scene.pixels import load_observed, load_thumbnail
from lightprobe.scene.record import recorded_mask

if TYPE_CHECKING:  # the package is loaded when a photo is located, and not before
    from lightprobe.localization import Locator


@dataclass(frozen=True)
class PhotoFiles:
    """A photo, its mask, and where camera and mask go if they have to be found."""

    image: Path
    mask: Path | None
    location: LocationFiles  # all of them


@dataclass(frozen=True)
class NewPhoto:
    """What a prediction is made from."""

    pixels: Pixels
    camera: Camera  # input frame, of the photo at its own size
    background: Background | None  # None: not wanted, or the photo is cut out
    ev100: float | None  # exposure value from EXIF, if complete
    location: LocatedPhoto | None  # None: the camera was given

    @property
    def pixel_camera(self) -> Camera:
        """The camera of `pixels`, which may be a reduced photo's."""
        height, width = self.pixels.alpha.shape
        return self.camera.resized(width, height)

    @property
    def doubt(self) -> float:
        """What a doubtful pose adds to the error to expect of ln radiance."""
        return 0.0 if self.location is None else self.location.located.verdict.doubt


class NewPhotos:
    """Photos that are read one by one when they are asked for; cameras are looked for only where none is
    known.
    """

    def __init__(self, run: RunFolder, files: Sequence[PhotoFiles], camera: Path | None, background: bool):
        """Check all that can be before any work.

        camera: a file of cameras, by default the run's own photos'. background: whether backgrounds are
        wanted. Raises `InputError` for a photo, mask or camera that cannot be used.
        """
        self._run, self._files, self._background = run, files, background
        self._photos = [_photo(run, one, camera) for one in files]
        self._locator: Locator | None = None
        self._most_opaque: int | None = None

    @property
    def lack_cameras(self) -> bool:
        """Whether there are photos that have to be located."""
        return None in self._photos

    def locate_with(self, locator: "Locator") -> None:
        """Take what photos without a camera are located by, which the caller has loaded."""
        self._locator = locator

    def read_within(self, most_opaque: int) -> None:
        """Read photos no larger than predictions need them: with about so many pixels in the mask."""
        self._most_opaque = most_opaque

    def read(self, index: int) -> NewPhoto:
        """Return one photo; raises `InputError` when it cannot be decoded or the object is not found in it."""
        files, photo = self._files[index], self._photos[index]
        ev100 = read_exif_ev100(files.image)
        if photo is not None:
            pixels, _ = (
                load_pixels(photo) if self._most_opaque is None else load_observed(photo, self._most_opaque)
            )
            background = load_background(photo) if self._background else None
            return NewPhoto(pixels, replace(photo.camera, lens=None), background, ev100, None)
        if self._locator is None:
            raise ValueError("Loaded with the photos that need it.")
        found = locate_photo(self._locator, files.image, files.mask, files.location)
        located, background = found.located, None
        if self._background and is_opaque(files.image):
            background = Background.of(located.color, located.clipped, located.mask, located.camera)
        return NewPhoto(located.pixels, located.camera, background, ev100, found)

    def surroundings(self, index: int, photo: NewPhoto) -> np.ndarray:
        """Return what a photo that `read` has returned shows, background included, at about the size of its
        pixels.

        (H, W, 3) float32, linear and straight; black where a cut-out photo shows nothing.
        """
        if photo.location is not None:
            return photo.location.located.color
        known = self._photos[index]
        if known is None:
            raise ValueError("Located, if its camera is not known.")
        return load_thumbnail(known, max(photo.pixels.alpha.shape))[0]

    def whole(self, index: int, photo: NewPhoto) -> tuple[np.ndarray, np.ndarray]:
        """Return all that a photo shows at full size, once `read` has returned it: colour and the object's
        coverage.

        (H, W, 3) linear and straight, background included, and (H, W), both float32.
        """
        if photo.location is not None and photo.location.files.mask is not None:
            return read_ldr(self._files[index].image)[0], read_mask(photo.location.files.mask)
        known = self._photos[index]
        if known is None:
            raise ValueError("Located, if its camera is not known.")
        return load_thumbnail(known, max(photo.camera.width, photo.camera.height))


def _photo(run: RunFolder, files: PhotoFiles, camera: Path | None) -> Photo | None:
    """Return a photo with the camera that is known of it, or None where it has to be located."""
    image_size(files.image)  # a file that is no photo is told before any work
    if camera is not None:
        return new_photo(files.image, camera, files.mask)
    entry = own_entry(run, files.image)
    if entry is None:
        return None
    mask = files.mask or recorded_mask(run, entry)
    if mask is None and is_opaque(files.image):
        return None  # its camera is known, but the mask that it was learnt with is gone: locating finds both
    return new_photo(files.image, run.scene_file, mask)


def load_locator(run: RunFolder, predictor: Predictor) -> "Locator":
    """Return what photos of a run's object are located by; raise `InputError` or `ConfigError` where it is
    missing.
    """
    from lightprobe.localization import Locator, stored_views

    views = stored_views(run, predictor.decomposition)
    return Locator(predictor.decomposition, views, predictor.device)
