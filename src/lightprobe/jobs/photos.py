"""Photos of a run's object as predictions take them: with cameras that are known or found, and backgrounds."""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lightprobe.core.errors import LightprobeWarning
from lightprobe.core.files import checksum, resolved, write_json
from lightprobe.core.run import RunFolder
from lightprobe.imaging import image_size, read_exif_ev100, read_ldr, read_mask, write_mask
from lightprobe.imaging.decoding import foreign_encoding
from lightprobe.jobs.request import Output, PredictRequest
from lightprobe.scene import Photo, load_pixels, new_photo
from lightprobe.scene.background import Background, is_opaque, load_background
from lightprobe.scene.camera import Camera
from lightprobe.scene.findings import encoding_sentences
from lightprobe.scene.photo import Pixels
from lightprobe.scene.pixels import fit_camera, load_observed, load_thumbnail
from lightprobe.scene.record import SPLITS, read_record, recorded_mask

if TYPE_CHECKING:  # the package is loaded when a photo is located, and not before
    from lightprobe.localization import Located, Locator


@dataclass(frozen=True)
class LocatedPhoto:
    """A photo with the camera and mask that were found, and the files they went to."""

    image: Path
    files: Mapping[Output, Path]
    located: "Located"

    @property
    def warnings(self) -> list[str]:
        """What is doubtful about it, a sentence each, with where one can look at it."""
        return [f"{sentence} Overlay: {self.files[Output.OVERLAY]}" for sentence in self.sentences]

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is doubtful about it."""
        return tuple(self.located.verdict.sentences)

    def to_json(self) -> dict[str, Any]:
        """Return what programs are told."""
        return {
            "photo": str(self.image),
            "files": {output.value: str(path) for output, path in self.files.items()},
            "camera": self.located.camera.to_json(),
            "seconds": self.located.seconds,
            "verdict": self.located.verdict.to_json(),
        }


@dataclass(frozen=True)
class NewPhoto:
    """What a prediction is made from."""

    image: Path
    pixels: Pixels
    camera: Camera  # input frame, of the photo at its own size
    background: Background | None  # None: not wanted, or the photo is cut out
    ev100: float | None  # exposure value from EXIF, if complete
    source: Photo | LocatedPhoto  # with the camera that was known, or found

    @property
    def location(self) -> LocatedPhoto | None:
        """The photo with its camera and mask, if they were found."""
        return self.source if isinstance(self.source, LocatedPhoto) else None

    @property
    def pixel_camera(self) -> Camera:
        """The camera of `pixels`, which may be a reduced photo's."""
        height, width = self.pixels.alpha.shape
        return self.camera.resized(width, height)

    @property
    def doubt(self) -> float:
        """What a doubtful pose adds to the error to expect of ln radiance."""
        return 0.0 if self.location is None else self.location.located.verdict.doubt

    def with_background(self) -> np.ndarray:
        """Return what the photo shows, background included, at about the size of its pixels.

        (H, W, 3) float32, linear and straight; black where a cut-out photo shows nothing.
        """
        if isinstance(self.source, LocatedPhoto):
            return self.source.located.color
        return load_thumbnail(self.source, max(self.pixels.alpha.shape))[0]

    def whole(self) -> tuple[np.ndarray, np.ndarray]:
        """Return all that the photo shows at full size: colour and the object's coverage.

        (H, W, 3) linear and straight, background included, and (H, W), both float32. The mask of a located
        photo is read from its file.
        """
        if isinstance(self.source, LocatedPhoto):
            return read_ldr(self.image)[0], read_mask(self.source.files[Output.MASK])
        return load_thumbnail(self.source, max(self.camera.width, self.camera.height))

    def write_location(self, files: Mapping[Output, Path]) -> None:
        """Write those of camera, mask and overlay that are wanted of a photo whose camera is known."""
        for output, path in files.items():
            match output:
                case Output.CAMERA:
                    write_json(path, self.camera.to_json())
                case Output.MASK:
                    write_mask(path, self.pixels.alpha)
                case Output.OVERLAY:
                    from lightprobe.localization.locator import write_overlay

                    write_overlay(path, self.with_background(), self.pixels.alpha)


def known_photo(run: RunFolder, request: PredictRequest) -> Photo | None:
    """Return the photo of a request with the camera that is known of it, or None where it has to be located.

    The camera is the given one, or that of the scene's own photo. Raises `InputError` for a photo, mask or
    camera that cannot be used; nothing is decoded yet.
    """
    image = request.photo
    image_size(image)  # a file that is no photo is told before any work
    if request.camera is not None:
        return new_photo(image, request.camera, request.mask_file)
    entry = own_entry(run, image, renamed=request.name is not None)
    if entry is None:
        return None
    mask = request.mask_file or recorded_mask(run, entry)
    if mask is None and is_opaque(image):
        return None  # its camera is known, but the mask that it was learnt with is gone: locating finds both
    source = str(run.scene_file)
    camera = fit_camera(Camera.from_json(entry.get("camera"), source=source), image, source)
    photo = Photo(image.stem, camera, image, mask, encoding=foreign_encoding(image))
    for sentence in encoding_sentences([photo]):
        warnings.warn(sentence, LightprobeWarning, stacklevel=2)
    return photo


def read_photo(
    request: PredictRequest,
    known: Photo | None,
    files: Mapping[Output, Path],
    locator: Callable[[], "Locator"],
    most_opaque: int | None,
) -> NewPhoto:
    """Decode the photo of a request, and locate it unless its camera is `known`.

    files: where camera, mask and overlay go if they are found. most_opaque: the photo is reduced to about so
    many pixels in the mask; None: it is not. Raises `InputError` when the photo cannot be decoded or the
    object is not found in it.
    """
    ev100 = read_exif_ev100(request.photo)
    if known is not None:
        pixels, _ = load_pixels(known) if most_opaque is None else load_observed(known, most_opaque)
        background = load_background(known) if request.background else None
        camera = replace(known.camera, lens=None)
        return NewPhoto(request.photo, pixels, camera, background, ev100, known)
    found = locate_photo(locator(), request, files)
    located, background = found.located, None
    if request.background and is_opaque(request.photo):
        background = Background.of(located.color, located.clipped, located.mask, located.camera)
    return NewPhoto(request.photo, located.pixels, located.camera, background, ev100, found)


def locate_photo(locator: "Locator", request: PredictRequest, files: Mapping[Output, Path]) -> LocatedPhoto:
    """Locate a photo and write its files; raise `InputError` when the object is not found in it."""
    located = locator.locate(request.photo, mask=request.mask_file)
    save = {
        Output.CAMERA: located.save_camera,
        Output.MASK: located.save_mask,
        Output.OVERLAY: located.save_overlay,
    }
    for output, path in files.items():
        save[output](path)
    return LocatedPhoto(request.photo, files, located)


def own_entry(run: RunFolder, image: Path, renamed: bool = False) -> dict[str, Any] | None:
    """Return what scene.json says of a photo that belongs to the run's scene; None of others.

    It is one of the scene's files, or a copy of one by the same name; a `renamed` copy may have any name.
    """
    read_record(run)  # checked
    record, whole, digest = run.scene(), resolved(image), ""
    for name, photo in (entry for split in SPLITS for entry in record["photos"][split].items()):
        file = Path(photo["image"])
        if whole is not None and resolved(Path(record["root"], file)) == whole:
            return photo
        if (renamed or image.stem == name or image.name == file.name) and image.is_file():
            digest = digest or checksum(image)
            if digest == photo.get("image_checksum"):
                return photo
    return None
