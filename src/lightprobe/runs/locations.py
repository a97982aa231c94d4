"""Cameras and masks of new photos of a run's object, and the files they go to."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from lightprobe.core.device import resolve_device
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.files import checksum, named_file, refuse_replacing, resolved
from lightprobe.core.run import RunFolder
from lightprobe.scene.camera import Camera
from lightprobe.scene.frame import cut_name
from lightprobe.scene.record import read_record

if TYPE_CHECKING:  # the package is loaded when a photo is located, and not before
    from lightprobe.localization import Located, Locator

_STEM_BYTES = 255 - len(".confidence.exr")  # of a photo's name that the names of its files can hold


@dataclass(frozen=True)
class LocationFiles:
    """Where the files of a located photo go, each in a folder of its own choice."""

    camera: Path | None = None
    """Camera as JSON; by default NAME.camera.json in the folder."""
    mask: Path | None = None
    """Mask as PNG, white object on black; by default NAME.mask.png."""
    overlay: Path | None = None
    """The photo with the object's outline, PNG; by default NAME.overlay.png."""

    def within(self, folder: Path, image: Path) -> "LocationFiles":
        """Return all files of one photo, those not chosen in `folder`."""
        stem = file_stem(image)
        names = {"camera": ".camera.json", "mask": ".mask.png", "overlay": ".overlay.png"}
        chosen = {
            key: getattr(self, key) or named_file(folder, stem, suffix) for key, suffix in names.items()
        }
        return LocationFiles(**chosen)

    def chosen(self) -> tuple[Path | None, Path | None, Path | None]:
        """Return the files that are named, None where one is not."""
        return self.camera, self.mask, self.overlay

    def check(self, count: int) -> None:
        """Raise `ConfigError` when chosen names cannot serve `count` photos, or not as these files."""
        for key, suffix in (("camera", ".json"), ("mask", ".png"), ("overlay", ".png")):
            path = getattr(self, key)
            if path is None:
                continue
            if count > 1:
                raise ConfigError(
                    f"--save-{key} names one file, {path}, but there are {count} photos; give a folder."
                )
            if path.suffix.lower() != suffix:
                raise ConfigError(f"--save-{key} {path} must end with {suffix}.")

    def write(self, located: "Located") -> None:
        """Write all three files; none of the names may be left to choose."""
        if self.camera is None or self.mask is None or self.overlay is None:
            raise ValueError("Chosen by `within`.")
        located.save_camera(self.camera)
        located.save_mask(self.mask)
        located.save_overlay(self.overlay)


@dataclass(frozen=True)
class LocatedPhoto:
    """A photo with its camera and mask, and where these are."""

    image: Path
    files: LocationFiles
    located: "Located"

    def warnings(self) -> list[str]:
        """Return what is doubtful about it, a sentence each, with where one can look at it."""
        return [f"{sentence} Overlay: {self.files.overlay}" for sentence in self.located.verdict.sentences]


def locate_photos(
    run_folder: Path | str,
    images: Sequence[Path],
    folder: Path | None = None,
    *,
    files: LocationFiles | None = None,
    mask: Path | None = None,
    device: str | torch.device = "auto",
) -> Iterator[LocatedPhoto]:
    """Locate photos of a run's object one after the other, and write camera, mask and overlay of each.

    folder: for the files, by default RUN/predictions. mask: white object on black, of several photos a
    folder. Raises `InputError` at the end when the object was not found in photos, and before any work for a
    run that cannot be used, `ConfigError` for names that cannot be written.
    """
    run, files = RunFolder.open(Path(run_folder)), files or LocationFiles()
    if not images:
        raise ConfigError("No photo is named: lightprobe locate RUN IMAGE.")
    files.check(len(images))
    refuse_replacing(files.chosen(), [*images, *(photo_mask(image, mask) for image in images)])
    where = folder or run.path / "predictions"
    refuse_namesakes(images, "locate them one by one, or rename one")
    targets = [files.within(where, image) for image in images]
    return _located(run, images, targets, mask, resolve_device(device))


def _located(
    run: RunFolder,
    images: Sequence[Path],
    targets: Sequence[LocationFiles],
    mask: Path | None,
    device: torch.device,
) -> Iterator[LocatedPhoto]:
    from lightprobe.localization import Locator

    locator, failures = Locator.load(run.path, device), list[str]()
    for image, target in zip(images, targets, strict=True):
        try:
            yield locate_photo(locator, image, photo_mask(image, mask), target)
        except InputError as error:
            failures.append(str(error))
    if failures:
        raise InputError(" ".join(failures))


def locate_photo(locator: "Locator", image: Path, mask: Path | None, files: LocationFiles) -> LocatedPhoto:
    """Locate one photo and write its files; raise `InputError` when the object is not found in it."""
    located = locator.locate(image, mask=mask)
    files.write(located)
    return LocatedPhoto(image, files, located)


def photo_mask(image: Path, mask: Path | None) -> Path | None:
    """Return the mask of a photo, out of a folder of masks if `mask` is one."""
    return mask / f"{image.stem}.png" if mask is not None and mask.is_dir() else mask


def file_stem(image: Path) -> str:
    """Return what the files made of a photo are named by: its stem, cut where names would grow too long."""
    return cut_name(image.stem, _STEM_BYTES)


def refuse_namesakes(images: Sequence[Path], advice: str) -> None:
    """Raise `ConfigError`, which ends with the `advice`, when two photos' files would have the same name."""
    named = dict[str, Path]()
    for image in images:
        stem = file_stem(image)
        if stem in named:
            raise ConfigError(
                f"{named[stem]} and {image} have the same name, and so would their files; {advice}."
            )
        named[stem] = image


def own_camera(run: RunFolder, digest: str) -> Camera | None:
    """Return the camera of the scene's photo whose file has this checksum, None where none has; input frame."""
    if not run.scene_file.is_file():
        return None
    photos, cameras = run.scene().get("photos", {}), read_record(run).cameras
    found = (
        camera
        for split, named in cameras.items()
        for name, camera in named.items()
        if photos[split][name].get("image_checksum") == digest
    )
    return next(found, None)


def own_entry(run: RunFolder, image: Path) -> dict[str, Any] | None:
    """Return what scene.json says of a photo that belongs to the run's scene; None of others.

    It is one of the scene's files, or a copy of one by the same name.
    """
    record, whole = run.scene(), resolved(image)
    for photos in record.get("photos", {}).values():
        for name, photo in photos.items() if isinstance(photos, dict) else ():
            file = photo.get("image") if isinstance(photo, dict) else None
            if not isinstance(file, str) or "\0" in file:
                continue
            if whole is not None and resolved(Path(record["root"], file)) == whole:
                return photo
            same_name = image.stem == name or image.name == Path(file).name
            if same_name and image.is_file() and checksum(image) == photo.get("image_checksum"):
                return photo
    return None
