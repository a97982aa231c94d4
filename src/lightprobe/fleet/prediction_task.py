"""Some photos of one object to their maps: what a worker of a fleet does. Every photo gets a row, whatever
happens.
"""

import contextlib
import os
import tempfile
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch

from lightprobe.core.config.prediction import UNCHANGED, Method, PredictionOptions, Sun
from lightprobe.core.device import resolve_device
from lightprobe.core.errors import InputError, LightprobeError, LightprobeWarning, shown
from lightprobe.core.failures import reporting_errors
from lightprobe.core.partial import partial_folder
from lightprobe.core.reading import LARGEST_PICTURE, LARGEST_TEXT
from lightprobe.core.run import RunFolder
from lightprobe.fleet.index import PhotoRow, State
from lightprobe.fleet.jobs import Job
from lightprobe.fleet.storage import Place
from lightprobe.light import cubemap
from lightprobe.light.upsampling import map_height
from lightprobe.runs.loaded import LoadedRun
from lightprobe.runs.locations import LocationFiles
from lightprobe.runs.predictions import PredictedPhoto, PredictionFiles, predict_photos

MAPS = "maps"
IN_A_FOLDER = 1000  # maps of a folder: file systems and object stores list folders of a million slowly
# What predictions need nothing of, in a run that has to be fetched
_LEFT_OUT = (
    "checkpoints/",
    "model/checkpoints/",
    "predictions/",
    "report/",
    "oracle/",
    "env/",
    "scene/",
    "export/",
)


@dataclass(frozen=True)
class PhotoOptions:
    """How all photos of a call are predicted from, and what is written."""

    method: Method | None = None
    """How the light is found where the file of jobs does not say; by default as each run is configured."""
    confidence: bool = False
    """Also write the confidence of each map."""
    background: bool = True
    """Use what photos show around the object."""
    size: str | None = None
    """Size of the maps, WxH; else that of the prediction."""
    sun: Sun = Sun.INSIDE
    """Whether the maps have the suns and lamps."""
    sources: bool = True
    """Look for suns and lamps: most of what the single step costs."""


@dataclass(frozen=True)
class Chunk:
    """Photos of one run, which one task predicts from."""

    jobs: tuple[Job, ...]
    beside: Place  # the folder that relative paths start at
    output: Place
    options: PhotoOptions = field(default_factory=PhotoOptions)
    settings: PredictionOptions = UNCHANGED
    threads: int = 1
    device: str = "cpu"


def predict_chunk(chunk: Chunk) -> list[PhotoRow]:
    """Predict from the photos of a chunk, write their files, and return one row for each photo."""
    torch.set_num_threads(chunk.threads)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightprobeWarning)  # verdicts go into the rows
        return [_row(job, chunk) for job in chunk.jobs]


def map_place(row: int) -> tuple[str, str, str]:
    """Return folder, folder and stem of the files of a row; no name comes out of the file of jobs."""
    return MAPS, f"{row // IN_A_FOLDER:06d}", f"{row:09d}"


def failed(job: Job, reason: str) -> PhotoRow:
    """Return the row of a photo that got no map."""
    return PhotoRow(job.row, job.run, job.photo, State.FAILED.value, reason, job.id)


def _row(job: Job, chunk: Chunk) -> PhotoRow:
    try:
        with reporting_errors():
            return _predicted(job, chunk)
    except LightprobeError as error:
        return failed(job, str(error))


def _predicted(job: Job, chunk: Chunk) -> PhotoRow:
    """Predict from one photo and write its files; raise a `LightprobeError` saying why it got none."""
    options, (*folders, stem) = chunk.options, map_place(job.row)
    method = _method(job) or options.method
    loaded = _loaded(_place(job.run, "run", chunk.beside), chunk.device, chunk.settings)
    target = chunk.output.child(*folders)
    with _scratch(
        needed=target.local is None or "://" in f"{chunk.beside}{job.photo}{job.camera}{job.mask}"
    ) as scratch:
        where = target.local if target.local is not None else scratch / "out"
        image = _place(job.photo, "photo", chunk.beside)
        files = PredictionFiles(
            _fetched(job.camera, "camera", chunk.beside, scratch, LARGEST_TEXT),
            _fetched(job.mask, "mask", chunk.beside, scratch, LARGEST_PICTURE),
            where / f"{stem}.exr",
            where / f"{stem}.confidence.exr" if options.confidence else None,
            LocationFiles(
                where / f"{stem}.camera.json", where / f"{stem}.mask.png", where / f"{stem}.overlay.png"
            ),
            None if options.size is None else map_height(options.size),
            options.sun,
            options.sources,
        )
        photo = image.fetch(scratch / "in" / image.name, LARGEST_PICTURE)
        found = next(
            iter(
                predict_photos(
                    loaded.run.path,
                    [photo],
                    files,
                    method=method,
                    background=options.background,
                    device=chunk.device,
                    loaded=loaded,
                )
            )
        )
        if target.local is None:
            for path in sorted(where.iterdir(), key=os.path.getmtime):
                target.child(path.name).write(path.read_bytes())
    return _told(job, found, "/".join((*folders, f"{stem}.exr")))


def _told(job: Job, found: PredictedPhoto, name: str) -> PhotoRow:
    verdict, prediction = found.prediction.verdict, found.prediction
    sentences = [*verdict.sentences]
    if found.location is not None:
        sentences = [*found.location.located.verdict.sentences, *sentences]
    return replace(
        failed(job, " ".join(sentences)),
        state=State.DONE.value,
        reason=" ".join(sentences) or None,
        map=name,
        method=found.method.value,
        verdict=verdict.status.value,
        explained=verdict.explained,
        overlap=verdict.overlap,
        confidence=float(cubemap.sphere_mean(prediction.confidence)),
        seconds=prediction.seconds["total"],
    )


def _method(job: Job) -> Method | None:
    if job.method is None:
        return None
    if job.method not in list(Method):
        raise InputError(f"There is no method '{shown(job.method)}'; use one of {', '.join(Method)}.")
    return Method(job.method)


def _place(text: str, name: str, beside: Place) -> Place:
    if not text:
        raise InputError(f"This row of the file of jobs has no {name}.")
    return Place.of(text, beside)


def _fetched(text: str | None, name: str, beside: Place, scratch: Path, largest: int) -> Path | None:
    """Return the path of a camera or mask on this machine, or None where there is none."""
    if text is None:
        return None
    place = _place(text, name, beside)
    return place.fetch(scratch / name / place.name, largest)


@contextlib.contextmanager
def _scratch(*, needed: bool) -> Iterator[Path]:
    """Yield a temporary folder, or where none is needed a path that nothing is written to.

    What a killed worker leaves of it the next one clears away.
    """
    base = Path(tempfile.gettempdir())
    if not needed:
        yield base
        return
    with partial_folder(base) as folder:
        yield folder


_HELD: dict[tuple[str, str, PredictionOptions], tuple[LoadedRun, contextlib.ExitStack]] = {}


def _loaded(run: Place, device: str, settings: PredictionOptions) -> LoadedRun:
    """Return a run that is loaded; the last one is kept, as tasks of one object follow each other."""
    key = (str(run), device, settings)
    if key not in _HELD:
        while _HELD:
            _HELD.popitem()[1][1].close()
        stack = contextlib.ExitStack()
        folder = run.local
        if folder is None:
            base = stack.enter_context(partial_folder(Path(tempfile.gettempdir())))
            folder = run.fetch_folder(base / "run", _LEFT_OUT)
        _HELD[key] = (LoadedRun(RunFolder.open(folder), resolve_device(device), settings), stack)
    return _HELD[key][0]
