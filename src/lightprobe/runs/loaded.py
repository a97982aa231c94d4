"""Runs that stay loaded between predictions; the least recently used go when they take too much memory."""

import time
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from lightprobe.core.config.prediction import UNCHANGED, PredictionOptions
from lightprobe.core.files import checksum, write_json
from lightprobe.core.memory import held_bytes
from lightprobe.core.run import RunFolder
from lightprobe.imaging import image_size
from lightprobe.prediction import Predictor, recorded_config
from lightprobe.runs.locations import own_camera
from lightprobe.runs.new_photos import NewPhoto, NewPhotos, PhotoFiles, load_locator
from lightprobe.scene.background import is_opaque

if TYPE_CHECKING:  # the package is loaded when a photo is located, and not before
    from lightprobe.localization import Locator


class LoadedRun:
    """A run with its predictor, and what its new photos are located by once one has needed it."""

    def __init__(self, run: RunFolder, device: torch.device, settings: PredictionOptions = UNCHANGED):
        """Load the predictor; raise `InputError` for a run without an object.

        settings: what changes of how the run predicts.
        """
        begin = time.perf_counter()
        self.run = run
        self.predictor = Predictor.load(run.path, device, settings.over(recorded_config(run)))
        self.seconds = time.perf_counter() - begin
        self._locator: Locator | None = None

    def locator(self) -> "Locator":
        """Return the locator, loaded once; errors as in `load_locator`."""
        if self._locator is None:
            self._locator = load_locator(self.run, self.predictor)
        return self._locator

    def make_ready(self, photos: NewPhotos) -> None:
        """Let photos be read as predictions take them, those without a camera be located; errors as
        `load_locator`.
        """
        photos.read_within(self.predictor.config.max_pixels)
        if photos.lack_cameras:
            photos.locate_with(self.locator())

    def read(
        self,
        files: PhotoFiles,
        camera: Path | None = None,
        *,
        background: bool = True,
        whole: bool = True,
        tell: Callable[[str], None] = lambda stage: None,
    ) -> NewPhoto:
        """Return a photo with its camera: the given one, that of the scene's own photo if it is one, else it
        is found.

        whole: whether it is read at its own size, where its camera is known, or as predictions take it.
        Raises `InputError` for a photo, mask or camera that cannot be used, or when the object is not found.
        """
        if camera is None:
            camera = self._own_camera(files)
        photos = NewPhotos(self.run, [files], camera, background)
        if not whole:
            photos.read_within(self.predictor.config.max_pixels)
        if camera is None:
            tell("finding the object in the photo")
            photos.locate_with(self.locator())
        return photos.read(0)

    def _own_camera(self, files: PhotoFiles) -> Path | None:
        """Return where the camera of the scene's own photo is written, None for another one or without its
        mask.
        """
        image_size(files.image)  # a file that is no photo is told before any work
        own, place = own_camera(self.run, checksum(files.image)), files.location.camera
        if own is None or place is None or (files.mask is None and is_opaque(files.image)):
            return None
        write_json(place, own.to_json())
        return place


class LoadedRuns:
    """The runs that were asked for last, as many as a limit of memory or of their number lets stay."""

    def __init__(self, device: torch.device, *, most: int | None = None, memory: int | None = None):
        """Compute on `device`; keep at most `most` runs, whose tensors and arrays take at most `memory`
        bytes.

        The run at hand is kept in any case.
        """
        self.device, self._most, self._memory = device, most, memory
        self._kept: OrderedDict[str, tuple[int, LoadedRun]] = (
            OrderedDict()
        )  # by path, with the time of their files
        self.loads = self.evictions = 0

    @property
    def paths(self) -> tuple[str, ...]:
        """The folders of the runs that are loaded, the least recently used first."""
        return tuple(self._kept)

    def get(self, run: RunFolder) -> LoadedRun:
        """Return a run, loaded anew when its files have changed; raises `InputError` as `LoadedRun`."""
        key, newest = str(run.path), _newest(run)
        if key in self._kept and self._kept[key][0] != newest:
            del self._kept[key]
        if key not in self._kept:
            if self._most is not None:
                self._forget(
                    lambda: len(self._kept) >= (self._most or 1)
                )  # so many need not be held and one more
            self._kept[key] = newest, LoadedRun(run, self.device)
            self.loads += 1
        self._kept.move_to_end(key)
        return self._kept[key][1]

    def trim(self) -> int:
        """Let runs go until the limit of memory holds; return the bytes that those which are left take.

        To be called after a prediction: only then is known what it has left in its run.
        """
        held = {key: held_bytes(one) for key, (_, one) in self._kept.items()}

        def left() -> int:
            return sum(held[key] for key in self._kept)

        self._forget(lambda: self._memory is not None and len(self._kept) > 1 and left() > self._memory)
        return left()

    def _forget(self, too_much: Callable[[], bool]) -> None:
        while self._kept and too_much():
            self._kept.popitem(last=False)
            self.evictions += 1


def _newest(run: RunFolder) -> int:
    """Return when what a predictor is loaded from has changed last."""
    files = (run.asset_file, run.config_file, run.calibration_file, *run.model_folder.glob("*.json"))
    return max((path.stat().st_mtime_ns for path in files if path.exists()), default=0)
