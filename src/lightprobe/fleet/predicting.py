"""Predictions from every photo of a file of jobs: maps, and an index with a row for each photo.

OUT/fleet.json                          which jobs and options these are
OUT/maps/000012/000012345.exr           the map of row 12345, and beside it .light.json, and what else was asked for
OUT/index/part-000000.parquet           what became of the photos; see `index`
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from lightprobe.core.config.prediction import UNCHANGED, PredictionOptions
from lightprobe.core.errors import ConfigError
from lightprobe.fleet.executor import Executor, Needs
from lightprobe.fleet.index import FOLDER, PhotoIndex
from lightprobe.fleet.jobs import Job, JobFile, chunks
from lightprobe.fleet.prediction_task import Chunk, PhotoOptions, failed, predict_chunk
from lightprobe.fleet.record import check_record, held
from lightprobe.fleet.storage import Place
from lightprobe.light.upsampling import map_height
from lightprobe.runs.progress import OnProgress, silent

CHUNK = 32  # photos of a task: five seconds to half a minute of work, while a new process loads its object in four


@dataclass(frozen=True)
class PhotoSummary:
    """What became of all photos, those of earlier calls included."""

    photos: int
    done: int
    failed: int
    index: str


def predict_fleet(
    jobs: Path | str,
    output: Path | str,
    executor: Executor,
    *,
    options: PhotoOptions | None = None,
    settings: PredictionOptions = UNCHANGED,
    needs: Needs | None = None,
    chunk: int = CHUNK,
    retry_failed: bool = False,
    on_progress: OnProgress = silent,
) -> PhotoSummary:
    """Predict from every photo of the Parquet file `jobs` (`jobs`) and write maps and index into `output`.

    The same call goes on where an interrupted one stopped: what has a row is not done again. settings: what
    changes of how the runs predict. needs: what a task takes. chunk: photos of a task at most. retry_failed:
    try those photos again that have failed. A photo whose process dies, in a chunk and then alone, gets a row
    that says so. Raises `InputError` for jobs or an index that cannot be used, `ConfigError` for options that
    cannot, or for an `output` of other jobs or options, and `LockedError` when another process writes it.
    """
    chosen, wanted = options or PhotoOptions(), needs or Needs()
    if chunk < 1:
        raise ConfigError(f"A task needs --chunk of at least 1 photo, not {chunk}.")
    if chosen.size is not None:
        map_height(chosen.size)
    chosen.sun.check(chosen.sources)
    file, place = JobFile(Place.of(jobs)), Place.of(output)
    with held(place):
        record = {"jobs": file.identity(), "options": asdict(chosen), "settings": asdict(settings)}
        check_record(place, record, alone=True)
        index = PhotoIndex(place, file.rows)
        if retry_failed:
            index.forget_failures()
        whole = Chunk((), file.place.parent, place, chosen, settings, wanted.threads, wanted.device)
        try:
            _predict(file, index, executor, whole, wanted, chunk, on_progress)
        finally:
            index.flush()
    return PhotoSummary(file.rows, index.count - index.failed, index.failed, str(place.child(FOLDER)))


def _predict(
    file: JobFile,
    index: PhotoIndex,
    executor: Executor,
    whole: Chunk,
    needs: Needs,
    size: int,
    on_progress: OnProgress,
) -> None:
    """Run all tasks; then the photos of those that were lost one by one, so that one photo cannot cost the
    others.
    """
    lost: list[Job] = []
    on_progress("photos", index.count, file.rows)

    def tasks() -> Iterator[Chunk]:
        for part in file.parts(lambda row: not index.done[row]):
            yield from (replace(whole, jobs=jobs) for jobs in chunks(part, size))

    for outcome in executor.run(predict_chunk, tasks(), needs):
        if outcome.result is None and len(outcome.task.jobs) > 1:
            lost += outcome.task.jobs
            continue
        index.add(outcome.result or [failed(job, outcome.lost or "No result.") for job in outcome.task.jobs])
        on_progress("photos", index.count, file.rows, _note(index))
    alone = (replace(whole, jobs=(job,)) for job in lost)
    for outcome in executor.run(predict_chunk, alone, needs) if lost else ():
        index.add(outcome.result or [failed(job, outcome.lost or "No result.") for job in outcome.task.jobs])
        on_progress("photos", index.count, file.rows, _note(index))


def _note(index: PhotoIndex) -> str:
    return f"{index.failed} failed" if index.failed else ""
