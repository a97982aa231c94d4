"""Which mask file belongs to which photo of a scene, and whether the masks can be believed at all."""

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.imaging import image_size, read_orientation, turned_size
from lightprobe.scene.frame import list_images

_FOLDERS = ("masks", "mask")
_SAME_SHAPE = 0.02  # of the ratio of width and height, which rounding changes in small pictures


class MaskFolder:
    """The mask files of a scene by photo: `a.png`, or COLMAP's `a.jpg.png`, for `images/a.jpg`.

    A photo of a subfolder has its mask in a subfolder of the same name. A mask outside of it serves by its
    bare name, but only one photo.
    """

    def __init__(self, root: Path, images: Iterable[Path]):
        """Look through the mask folders of the scene `root`; `images`: all photos that name no mask."""
        self._root = root
        self._files: dict[str, Path] = {}
        for folder in (root / name for name in _FOLDERS if (root / name).is_dir()):
            for path in list_images(folder):
                self._files.setdefault(path.relative_to(folder).with_suffix("").as_posix(), path)
        lacking = [image for image in dict.fromkeys(images) if self._own(image) is None]
        self._wanted = Counter(found for image in lacking if (found := self._by_name(image)) is not None)

    def find(self, image: Path) -> Path | None:
        """Return the mask of a photo, or None: the photo's alpha channel must do.

        Raises `InputError` when several photos of that name would share the mask.
        """
        own = self._own(image)
        if own is not None:
            return own
        found = self._by_name(image)
        if found is not None and self._wanted[found] > 1:
            place = found.parent / self._below(image).with_suffix(".png")
            raise InputError(
                f"{found} could be the mask of {self._wanted[found]} photos named {image.stem}, one of them {image}; "
                f"put each photo's mask into a folder named as the photo's, this one's to {place}."
            )
        return found

    def _own(self, image: Path) -> Path | None:
        """Return the mask at the photo's own place below the mask folder."""
        below = self._below(image)
        return self._first(below.with_suffix("").as_posix(), below.as_posix())

    def _by_name(self, image: Path) -> Path | None:
        return self._first(image.stem, image.name)

    def _first(self, *keys: str) -> Path | None:
        return next((self._files[key] for key in keys if key in self._files), None)

    def _below(self, image: Path) -> Path:
        """Return where a photo lies in `images/`, which may be a link to elsewhere, or else in the scene."""
        for folder in (self._root / "images", (self._root / "images").resolve(), self._root):
            if image.is_relative_to(folder):
                return image.relative_to(folder)
        return Path(image.name)


def mask_turn(mask: Path, image: Path, size: tuple[int, int]) -> int:
    """Return the EXIF orientation that a mask is turned by; `size`: (width, height) of its photo upright.

    The mask's own. A mask without one is turned along with its photo, unless its shape fits only unturned.
    """
    own, tag = read_orientation(mask), read_orientation(image) or 1
    stored = image_size(mask, orient=False)
    turns = (tag, 1) if own is None else (own, tag, 1)
    return next((turn for turn in turns if same_shape(turned_size(stored, turn), size)), 1)


def same_shape(size: tuple[int, int], photo: tuple[int, int]) -> bool:
    """Return whether a mask of `size` (width, height) has the shape of its `photo`, whatever the scale."""
    return abs(size[0] * photo[1] - size[1] * photo[0]) <= _SAME_SHAPE * size[1] * photo[0]


def without_background(alphas: Mapping[str, np.ndarray]) -> tuple[int, str]:
    """Return how many masks (h, w), by photo, show nothing but the object, and a sentence about them."""
    names = [name for name, alpha in alphas.items() if alpha.min() >= 0.5]
    return len(names), "" if not names else (
        f"{len(names)} of {len(alphas)} masks show no background, such as that of {names[0]}: the object must be "
        "white (or opaque) and all else black (or transparent), so that its outline can be seen."
    )
