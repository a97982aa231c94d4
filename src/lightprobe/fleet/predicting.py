"""Predictions from every photo of a table: maps, and an index with a row for each photo.

OUT/fleet.json                          which table and options these are
OUT/maps/000012/000012345.exr           the map of row 12345, and beside it .light.json, and what else was asked for
OUT/index/part-000000.parquet           what became of the photos; see `index`

A task is some photos of one object, a `Chunk`. What a worker does with it, `predict_chunk`, knows nothing of Ray.
"""

import contextlib
import os
import tempfile
import warnings
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import torch

from lightprobe.core.config.prediction import UNCHANGED, PredictionOptions
from lightprobe.core.errors import ConfigError, InputError, LightprobeError, LightprobeWarning
from lightprobe.core.failures import reporting_errors
from lightprobe.core.partial import partial_folder
from lightprobe.core.reading import LARGEST_PICTURE, LARGEST_TEXT
from lightprobe.fleet.executor import Executor, Needs
from lightprobe.fleet.index import FOLDER, PhotoIndex, PhotoRow, State
from lightprobe.fleet.record import held
from lightprobe.fleet.storage import Place
from lightprobe.fleet.table import PhotoTable, TableRow
from lightprobe.jobs import Answer, AnswerFiles, LightOptions, Output, PredictRequest, Session, predict_photo
from lightprobe.jobs.files import LOCATION
from lightprobe.light import cubemap
from lightprobe.runs.progress import OnProgress, silent

CHUNK = 32  # photos of a task: five seconds to half a minute of work, while a new process loads its object in four
_IN_A_FOLDER = 1000  # maps of a folder: file systems and object stores list folders of a million slowly
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
class PhotoSummary:
    """What became of all photos, those of earlier calls included."""

    photos: int
    done: int
    failed: int
    index: str


@dataclass(frozen=True)
class Chunk:
    """Photos of one run, which one task predicts from."""

    rows: tuple[TableRow, ...]
    beside: Place  # the folder that relative paths start at
    output: Place
    options: LightOptions = LightOptions()  # noqa: RUF009  frozen
    confidence: bool = False
    settings: PredictionOptions = UNCHANGED
    threads: int = 1
    device: str = "cpu"


def predict_fleet(
    table: Path | str,
    output: Path | str,
    executor: Executor,
    *,
    options: LightOptions | None = None,
    confidence: bool = False,
    settings: PredictionOptions = UNCHANGED,
    needs: Needs | None = None,
    chunk: int = CHUNK,
    retry_failed: bool = False,
    on_progress: OnProgress = silent,
) -> PhotoSummary:
    """Predict from every photo of the Parquet file `table` and write maps and index into `output`.

    The same call goes on where an interrupted one stopped: what has a row is not done again. options: of
    photos for which the table says nothing else. confidence: whether it is written, too. settings: what
    changes of how the runs predict. needs: what a task takes. chunk: photos of a task at most. retry_failed:
    try those photos again that have failed. A photo whose process dies, in a chunk and then alone, gets a row
    that says so. Raises `InputError` for a table or an index that cannot be used, `ConfigError` for options
    that cannot, or for an `output` of another table or options, and `LockedError` when another process writes
    it.
    """
    chosen, wanted = options or LightOptions(), needs or Needs()
    if chunk < 1:
        raise ConfigError(f"A task needs --chunk of at least 1 photo, not {chunk}.")
    file, place = PhotoTable(Place.of(table)), Place.of(output)
    record = {
        "jobs": file.identity(),
        "options": {**asdict(chosen), "confidence": confidence},
        "settings": asdict(settings),
    }
    with held(place, record, alone=True):
        index = PhotoIndex(place, file.rows)
        if retry_failed:
            index.forget_failures()
        whole = Chunk(
            (), file.place.parent, place, chosen, confidence, settings, wanted.threads, wanted.device
        )
        try:
            chunks = (
                replace(whole, rows=rows) for rows in file.chunks(chunk, lambda row: not index.done[row])
            )
            on_progress("photos", index.count, file.rows)
            lost = _run(executor, chunks, wanted, index, on_progress)
            if lost:  # one photo cannot cost the others
                alone = (replace(whole, rows=(row,)) for row in lost)
                _run(executor, alone, wanted, index, on_progress)
        finally:
            index.flush()
    return PhotoSummary(file.rows, index.count - index.failed, index.failed, str(place.child(FOLDER)))


def _run(
    executor: Executor, chunks: Iterable[Chunk], needs: Needs, index: PhotoIndex, on_progress: OnProgress
) -> list[TableRow]:
    """Run tasks; put what became of their photos into the index, and return the photos of lost chunks of several."""
    lost = list[TableRow]()
    for outcome in executor.run(predict_chunk, chunks, needs):
        rows = outcome.task.rows
        if outcome.result is None and len(rows) > 1:
            lost += rows
            continue
        index.add(outcome.result or [failed(row, outcome.lost or "No result.") for row in rows])
        note = f"{index.failed} failed" if index.failed else ""
        on_progress("photos", index.count, len(index.done), note)
    return lost


def predict_chunk(chunk: Chunk) -> list[PhotoRow]:
    """Predict from the photos of a chunk, write their files, and return a row for each photo, whatever happens."""
    torch.set_num_threads(chunk.threads)
    found = list[PhotoRow]()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightprobeWarning)  # verdicts go into the rows
        for row in chunk.rows:
            try:
                with reporting_errors():
                    found.append(_predicted(row, chunk))
            except LightprobeError as error:
                found.append(failed(row, str(error)))
    return found


def map_place(row: int) -> tuple[str, str, str]:
    """Return folder, folder and stem of the files of a row; no name comes out of the table."""
    return "maps", f"{row // _IN_A_FOLDER:06d}", f"{row:09d}"


def failed(row: TableRow, reason: str) -> PhotoRow:
    """Return the index row of a photo that got no map."""
    return PhotoRow(row.row, row.run, row.photo, State.FAILED.value, reason, row.id)


def _predicted(row: TableRow, chunk: Chunk) -> PhotoRow:
    """Predict from one photo and write its files; raise a `LightprobeError` saying why it got none."""
    options = chunk.options.updated(row.options)
    session = _session(_place(row.run, "run", chunk.beside), chunk)
    *folders, stem = map_place(row.row)
    outputs = [Output.EXR, *LOCATION, *([Output.CONFIDENCE] if chunk.confidence else [])]
    target = chunk.output.child(*folders)
    with contextlib.ExitStack() as stack:
        scratch = Path(tempfile.gettempdir())
        if target.local is None or "://" in f"{chunk.beside}{row.photo}{row.camera}{row.mask}":
            scratch = stack.enter_context(
                partial_folder(scratch)
            )  # a killed worker's the next one clears away

        def fetched(text: str, name: str, largest: int) -> Path:
            place = _place(text, name, chunk.beside)
            return place.fetch(scratch / name / place.name, largest)

        request = PredictRequest(
            photo=fetched(row.photo, "photo", LARGEST_PICTURE),
            camera=None if row.camera is None else fetched(row.camera, "camera", LARGEST_TEXT),
            mask=None if row.mask is None else fetched(row.mask, "mask", LARGEST_PICTURE),
            **vars(options),
        )
        where = target.local or scratch / "out"
        answer = predict_photo(session, request, AnswerFiles.named(where, stem, outputs))
        if target.local is None:
            for path in sorted(where.iterdir(), key=os.path.getmtime):
                target.child(path.name).write(path.read_bytes())
    return _told(row, answer, "/".join((*folders, f"{stem}.exr")))


def _told(row: TableRow, answer: Answer, name: str) -> PhotoRow:
    verdict = answer.prediction.verdict
    return replace(
        failed(row, ""),
        state=State.DONE.value,
        reason=" ".join(answer.sentences) or None,
        map=name,
        method=answer.method.value,
        verdict=verdict.status.value,
        explained=verdict.explained,
        overlap=verdict.overlap,
        confidence=float(cubemap.sphere_mean(answer.prediction.confidence)),
        seconds=answer.prediction.seconds["total"],
    )


def _place(text: str, name: str, beside: Place) -> Place:
    if not text:
        raise InputError(f"This row of the table has no {name}.")
    return Place.of(text, beside)


_HELD: dict[tuple[str, str, PredictionOptions], tuple[Session, contextlib.ExitStack]] = {}


def _session(run: Place, chunk: Chunk) -> Session:
    """Return a run that is loaded; the last one is kept, as tasks of one object follow each other."""
    key = (str(run), chunk.device, chunk.settings)
    if key not in _HELD:
        while _HELD:
            _HELD.popitem()[1][1].close()
        stack = contextlib.ExitStack()
        folder = run.local
        if folder is None:
            base = stack.enter_context(partial_folder(Path(tempfile.gettempdir())))
            folder = run.fetch_folder(base / "run", _LEFT_OUT)
        _HELD[key] = (Session(folder, chunk.device, chunk.settings), stack)
    return _HELD[key][0]
