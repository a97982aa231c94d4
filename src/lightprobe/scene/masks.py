"""Which mask file belongs to which photo of a scene, and whether the masks can be believed at all."""

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.imaging import image_size, read_orientation, turned_size
from lightprobe.scene.file_names import fold
from lightprobe.scene.frame import list_images

_FOLDERS = ("masks", "mask")
_SAME_SHAPE = 0.02  # of the ratio of width and height, which rounding changes in small pictures


class MaskFolder:
    """The mask files of a scene by photo: `a.png`, or COLMAP's `a.jpg.png`, for `images/a.jpg`.

    A photo of a subfolder has its mask in a subfolder of the same name. A mask outside of it serves by its
    bare name, but only one photo. Letter case and Unicode form tell masks apart only where they have to.
    """

    def __init__(self, root: Path, images: Iterable[Path]):
        """Look through the mask folders of the scene `root`; `images`: all photos that name no mask."""
        self._root = root
        self._files: dict[str, list[Path]] = {}
        for folder in mask_folders(root):
            found: dict[str, list[Path]] = {}
            for path in list_images(folder):
                found.setdefault(fold(path.relative_to(folder).with_suffix("").as_posix()), []).append(path)
            self._files = {**found, **self._files}
        self._users = Counter(mask for image in dict.fromkeys(images) for mask in self._choice(image)[:1])

    def find(self, image: Path) -> Path | None:
        """Return the mask of a photo, or None: the photo's alpha channel must do.

        Raises `InputError` when several photos would share the mask, or several masks fit the photo.
        """
        found = self._choice(image)
        if not found:
            return None
        if len(found) > 1:
            raise InputError(
                f"{found[0]} and {found[1]} could both be the mask of {image}; remove one, or call it {image.name}.png."
            )
        mask, users = found[0], self._users[found[0]]
        if users > 1:
            below = self._below(image)
            place = mask.parent / below.with_name(
                f"{below.name}.png" if self._own(image) else f"{below.stem}.png"
            )
            raise InputError(
                f"{mask} could be the mask of {users} photos named {image.stem}, one of them {image}; give each photo a "
                f"mask of its own, this one's in {place}."
            )
        return mask

    def _choice(self, image: Path) -> list[Path]:
        """Return the mask of a photo: at its own place below the mask folder, else by its bare name.

        Several where nothing tells them apart.
        """
        return self._own(image) or self._alike(Path(image.name))

    def _own(self, image: Path) -> list[Path]:
        return self._alike(self._below(image))

    def _alike(self, below: Path) -> list[Path]:
        """Return the masks of a photo's place: by its whole name and another ending, of its name, of its stem."""
        whole = self._files.get(fold(below.as_posix()), [])
        stem = self._files.get(fold(below.with_suffix("").as_posix()), [])
        same = [mask for mask in stem if fold(mask.name) == fold(below.name)]
        found = whole or same or stem
        return [mask for mask in found if mask.stem in (below.name, below.stem)] or found

    def _below(self, image: Path) -> Path:
        """Return where a photo lies in `images/`, which may be a link to elsewhere, or else in the scene."""
        for folder in (self._root / "images", (self._root / "images").resolve(), self._root):
            if image.is_relative_to(folder):
                return image.relative_to(folder)
        return Path(image.name)


def mask_folders(root: Path) -> list[Path]:
    """Return the folders of a scene that masks are looked for in."""
    return [
        path
        for name in _FOLDERS
        for path in sorted(root.iterdir())
        if path.name.casefold() == name and path.is_dir()
    ]


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
