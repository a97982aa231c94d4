"""Runs that are loaded to predict with: one, or those that were asked for last."""

import time
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from lightprobe.core.config.prediction import UNCHANGED, Method, PredictionOptions
from lightprobe.core.device import resolve_device
from lightprobe.core.memory import held_bytes
from lightprobe.core.run import RunFolder
from lightprobe.jobs.photos import NewPhoto, read_photo
from lightprobe.jobs.request import LightOptions, Output, PredictRequest
from lightprobe.prediction import Prediction, Predictor, methods_for, recorded_config
from lightprobe.scene import Photo
from lightprobe.scene.frame import Split
from lightprobe.scene.photo import Pixels
from lightprobe.scene.record import read_record

if TYPE_CHECKING:  # the package is loaded when a photo is located, and not before
    from lightprobe.localization import Locator

_WARM_UP_SIDE = 128  # pixels of the picture that nobody has taken


class Session:
    """A run with its predictor and its locator, each loaded when it is first needed."""

    def __init__(
        self, run: Path | str, device: str | torch.device = "auto", settings: PredictionOptions = UNCHANGED
    ):
        """Open a run; raise `InputError` when there is none. settings: what changes of how it predicts."""
        self.run, self.device = RunFolder.open(Path(run)), resolve_device(device)
        self._settings = settings
        self.seconds = 0.0  # that loading the predictor took

    @cached_property
    def predictor(self) -> Predictor:
        """The run's predictor; raises `InputError` for a run without an object."""
        begin = time.perf_counter()
        config = self._settings.over(recorded_config(self.run))
        predictor = Predictor.load(self.run.path, self.device, config)
        self.seconds = time.perf_counter() - begin
        return predictor

    @cached_property
    def locator(self) -> "Locator":
        """What photos of the object are located by; raises `InputError` or `ConfigError` where it is missing."""
        return load_locator(self.run, self.predictor)

    def warm_up(self) -> None:
        """Load, compile and compute what the first photo would wait for, by a prediction from a grey picture.

        Raises `InputError` for a run without an object, or one whose files cannot be used.
        """
        for camera in list(read_record(self.run).cameras[Split.TRAIN.value].values())[:1]:
            small = camera.within(_WARM_UP_SIDE)
            grey = np.full((small.height, small.width, 3), 0.2, np.float32)
            pixels = Pixels.of(grey, np.ones(grey.shape[:2], np.float32))
            self.predictor.predict(pixels, small, refuse=False, sources=True)
        if self.run.views_file.is_file():
            self.locator  # noqa: B018  loaded

    def method(self, options: LightOptions) -> Method:
        """Return the method that is asked for, or the run's own."""
        return options.method or methods_for(self.predictor.model, self.predictor.config)[0]

    def read(
        self, request: PredictRequest, known: Photo | None, files: Mapping[Output, Path], whole: bool = False
    ) -> NewPhoto:
        """Return a photo with its camera, see `photos.read_photo`; reduced as predictions take it, or `whole`."""
        most = None if whole else self.predictor.config.max_pixels
        return read_photo(request, known, files, lambda: self.locator, most)

    def predict(self, photo: NewPhoto, options: LightOptions) -> Prediction:
        """Return the light in a photo; raises `InputError` for one that no light explains."""
        pixels, camera = photo.pixels, photo.pixel_camera
        asked = self._arguments(options)
        return self.predictor.predict(pixels, camera, background=photo.background, doubt=photo.doubt, **asked)

    def predict_together(
        self, photos: Sequence[NewPhoto], options: LightOptions, exposures: Sequence[float] | None
    ) -> tuple[Prediction, list[float]]:
        """Return the one light of several photos, and their exposures relative to the first's.

        The exposures are found with the light unless they are given. Raises `InputError` as `predict`.
        """
        prediction, found = self.predictor.predict_together(
            [(photo.pixels, photo.pixel_camera) for photo in photos],
            exposures=exposures,
            backgrounds=[photo.background for photo in photos],
            doubt=max(photo.doubt for photo in photos),
            **self._arguments(options),
        )
        return prediction, found.tolist()

    def _arguments(self, options: LightOptions) -> dict[str, Any]:
        """Return what the predictor is told of the options."""
        return {"method": self.method(options), "sources": options.sources}


class Sessions:
    """The runs that were asked for last, as many as a limit of memory or of their number lets stay."""

    def __init__(self, device: torch.device, *, most: int | None = None, memory: int | None = None):
        """Compute on `device`; keep at most `most` runs, whose tensors and arrays take at most `memory` bytes.

        The run at hand is kept in any case.
        """
        self.device, self._most, self._memory = device, most, memory
        self._kept = OrderedDict[str, tuple[int, Session]]()  # by path, with the time of their files
        self.loads = self.evictions = 0

    @property
    def paths(self) -> tuple[str, ...]:
        """The folders of the runs that are loaded, the least recently used first."""
        return tuple(self._kept)

    def get(self, run: Path | str) -> Session:
        """Return a run with its predictor, loaded anew when its files have changed.

        Raises `InputError` as `Session`.
        """
        folder = RunFolder.open(Path(run))
        key, newest = str(folder.path), _newest(folder)
        if key in self._kept and self._kept[key][0] != newest:
            del self._kept[key]
        if key not in self._kept:
            most = self._most
            if most is not None:  # so many need not be held and one more
                self._forget(lambda: len(self._kept) >= most)
            session = Session(folder.path, self.device)
            session.predictor  # noqa: B018  loaded, or refused
            self._kept[key] = newest, session
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


def load_locator(run: RunFolder, predictor: Predictor) -> "Locator":
    """Return what photos of a run's object are located by; raise `InputError` or `ConfigError` where it is missing."""
    from lightprobe.localization import Locator, stored_views

    views = stored_views(run, predictor.decomposition)
    return Locator(predictor.decomposition, views, predictor.device)


def _newest(run: RunFolder) -> int:
    """Return when what a predictor is loaded from has changed last."""
    files = (run.asset_file, run.config_file, run.calibration_file, *run.model_folder.glob("*.json"))
    return max((path.stat().st_mtime_ns for path in files if path.exists()), default=0)
