"""What became of every photo and every scene: Parquet, readable while it grows.

The index of predictions is a folder of parts, `index/part-000000.parquet` and so on, as Parquet readers take
it for one table. A part is written once, whole, when enough rows have come or time has passed; a row is in
one part only. What is in no part was not finished, and is done again by the next call. The index of trainings
is one small file.
"""

import io
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from typing import Any, get_type_hints

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.core.extras import extra_library
from lightprobe.fleet.storage import Place

FOLDER = "index"
_ROWS, _SECONDS = 20_000, 30.0  # of a part, whichever comes first
_PART = "part-"


class State(StrEnum):
    """What became of a task."""

    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True)
class PhotoRow:
    """What became of a photo; all but the first five are null where it failed."""

    row: int  # of the file of jobs
    run: str
    photo: str
    state: str  # of `State`
    reason: str | None = None  # why it failed, a sentence; of a doubtful photo what is doubtful
    id: str | None = None
    map: str | None = None  # relative to the folder of the results
    method: str | None = None
    verdict: str | None = None
    explained: float | None = None  # see `prediction.verdict`
    overlap: float | None = None
    confidence: float | None = None  # mean over the sphere
    seconds: float | None = None  # of the prediction alone


@dataclass(frozen=True)
class SceneRow:
    """What became of a scene."""

    scene: str
    run: str
    state: str
    reason: str | None = None
    phase1_seconds: float | None = None
    phase2_seconds: float | None = None
    memory: float | None = None  # GiB at most
    photos: int | None = None  # that it was trained on
    relit: float | None = None  # mean PSNR of relighting, of the default method, where it was evaluated
    object: float | None = None  # mean PSNR of the test photos


Row = PhotoRow | SceneRow


def encode(rows: Iterable[Row], kind: type[Row]) -> bytes:
    """Return rows as a Parquet file, in the order of their first column."""
    arrow = extra_library("pyarrow", "An index", "cluster")
    parquet = extra_library("pyarrow.parquet", "An index", "cluster")
    names = [field.name for field in fields(kind)]
    ordered = sorted((asdict(row) for row in rows), key=lambda row: row[names[0]])
    columns = {name: [row[name] for row in ordered] for name in names}
    written = io.BytesIO()
    parquet.write_table(arrow.table(columns, schema=_schema(kind)), written, compression="zstd")
    return written.getvalue()


def decode(
    data: bytes, place: Place, kind: type[Row], columns: list[str] | None = None
) -> dict[str, list[Any]]:
    """Return the columns of an index file, or raise `InputError` naming it where it cannot be used."""
    parquet = extra_library("pyarrow.parquet", "An index", "cluster")
    names = columns or [field.name for field in fields(kind)]
    try:
        table = parquet.read_table(io.BytesIO(data), columns=names, schema=_schema(kind))
        return table.to_pydict()
    except Exception as error:  # Arrow has many kinds for damage
        said = str(error).strip().split("\n")[0].rstrip(".")
        raise InputError(
            f"{place} is damaged or no index ({said}); remove it, and its rows are made again."
        ) from error


def _schema(kind: type[Row]) -> Any:
    arrow = extra_library("pyarrow", "An index", "cluster")
    types = {int: arrow.int64(), float: arrow.float32(), str: arrow.string()}
    hints = get_type_hints(kind)
    plain = {
        name: next(each for each in types if each is hint or each in getattr(hint, "__args__", ()))
        for name, hint in hints.items()
    }
    return arrow.schema([(name, types[found]) for name, found in plain.items()])


class PhotoIndex:
    """The index of predictions, which one process at a time writes."""

    def __init__(self, output: Place, rows: int, clock: Callable[[], float] = time.monotonic):
        """Read which of the `rows` are there; raise `InputError` for a damaged part."""
        self._folder, self._clock = output.child(FOLDER), clock
        self.done = np.zeros(rows, bool)
        self.failed = 0
        self._next, self._held, self._since = 0, list[PhotoRow](), clock()
        for part in self._parts():
            columns = decode(part.read(), part, PhotoRow, ["row", "state"])
            self._note(part, np.array(columns["row"], np.int64))
            self.failed += columns["state"].count(State.FAILED.value)
            self._next = max(self._next, int(part.name[len(_PART) : -len(".parquet")]) + 1)

    def _parts(self) -> list[Place]:
        names = [
            name for name in self._folder.names() if name.startswith(_PART) and name.endswith(".parquet")
        ]
        odd = next((name for name in names if not name[len(_PART) : -len(".parquet")].isdecimal()), None)
        if odd is not None:
            raise InputError(f"{self._folder}/{odd} is no part of the index; remove it.")
        return [self._folder.child(name) for name in names]

    def _note(self, part: Place, rows: np.ndarray) -> None:
        if len(rows) and not 0 <= rows.min() <= rows.max() < len(self.done):
            raise InputError(
                f"{part} has rows that the file of jobs does not have; choose another folder with -o."
            )
        self.done[rows] = True

    @property
    def count(self) -> int:
        """How many rows are known, written or held."""
        return int(self.done.sum())

    def forget_failures(self) -> None:
        """Drop the rows of photos that failed, so that they are tried again."""
        for part in self._parts():
            columns = decode(part.read(), part, PhotoRow)
            rows = [
                PhotoRow(**dict(zip(columns, values, strict=True)))
                for values in zip(*columns.values(), strict=True)
            ]
            kept = [row for row in rows if row.state != State.FAILED]
            if len(kept) == len(rows):
                continue
            part.write(encode(kept, PhotoRow)) if kept else part.remove()
            self.done[[row.row for row in rows if row.state == State.FAILED]] = False
        self.failed = 0

    def add(self, rows: Iterable[PhotoRow]) -> None:
        """Take rows, each once, and write a part when it is time."""
        for row in rows:
            if self.done[row.row]:
                raise ValueError(f"Row {row.row} is in the index already.")
            self.done[row.row] = True
            self.failed += row.state == State.FAILED
            self._held.append(row)
        if len(self._held) >= _ROWS or self._clock() - self._since >= _SECONDS:
            self.flush()

    def flush(self) -> None:
        """Write the rows that are held as a part of their own."""
        if self._held:
            part = self._folder.child(f"{_PART}{self._next:06d}.parquet")
            part.write(encode(self._held, PhotoRow))
            self._next, self._held = self._next + 1, []
        self._since = self._clock()


class SceneIndex:
    """The index of trainings, one file that is written anew whenever a scene is finished or given up."""

    NAME = "index.parquet"

    def __init__(self, output: Place):
        """Read it, if it is there."""
        self._file = output.child(self.NAME)
        self.rows: dict[str, SceneRow] = {}
        if self._file.exists():
            columns = decode(self._file.read(), self._file, SceneRow)
            found = (
                dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)
            )
            self.rows = {row["scene"]: SceneRow(**row) for row in found}

    def put(self, row: SceneRow) -> None:
        """Take a scene's row in the place of an earlier one, and write the file."""
        self.rows[row.scene] = row
        self._file.write(encode(self.rows.values(), SceneRow))
