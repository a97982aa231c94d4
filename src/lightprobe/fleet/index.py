"""What became of every photo and every scene: Parquet, readable while it grows.

The index of predictions is a folder of parts, `index/part-000000.parquet` and so on, as Parquet readers take
it for one table. A part is written once, whole, when enough rows have come or time has passed; a row is in
one part only. What is in no part was not finished, and is done again by the next call. The index of trainings
is one small file.
"""

import io
import re
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from typing import Any, TypeVar, get_type_hints

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.core.extras import extra_library
from lightprobe.fleet.storage import Place

FOLDER = "index"
_ROWS = 20_000  # of a part
_PART = re.compile(r"part-(\d+)\.parquet")


class State(StrEnum):
    """What became of a task."""

    DONE = "done"
    FAILED = "failed"


@dataclass(frozen=True)
class PhotoRow:
    """What became of a photo; all but the first five are null where it failed."""

    row: int  # of the table of photos
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


Row = TypeVar("Row", PhotoRow, SceneRow)


def encode(rows: Iterable[Row], kind: type[Row]) -> bytes:
    """Return rows as a Parquet file, in the order of their first column."""
    arrow = extra_library("pyarrow", "An index", "cluster")
    parquet = extra_library("pyarrow.parquet", "An index", "cluster")
    first = fields(kind)[0].name
    ordered = sorted(map(asdict, rows), key=lambda row: row[first])
    written = io.BytesIO()
    parquet.write_table(arrow.Table.from_pylist(ordered, _schema(kind)), written, compression="zstd")
    return written.getvalue()


def decode(place: Place, kind: type[Row]) -> list[Row]:
    """Return the rows of an index file, or raise `InputError` naming it where it cannot be used."""
    return [kind(**row) for row in _columns(place, kind).to_pylist()]


def _columns(place: Place, kind: type[Row], names: list[str] | None = None) -> Any:
    """Return an index file, or some of its columns, as a table of Arrow; errors as `decode`."""
    parquet = extra_library("pyarrow.parquet", "An index", "cluster")
    data, schema = place.read(), _schema(kind)
    try:
        return parquet.read_table(io.BytesIO(data), columns=names or schema.names, schema=schema)
    except Exception as error:  # Arrow has many kinds for damage
        said = str(error).strip().split("\n")[0].rstrip(".")
        raise InputError(
            f"{place} is damaged or no index ({said}); remove it, and its rows are made again."
        ) from error


def _schema(kind: type[Row]) -> Any:
    arrow = extra_library("pyarrow", "An index", "cluster")
    types = {int: arrow.int64(), float: arrow.float32(), str: arrow.string()}
    hints = get_type_hints(kind)
    return arrow.schema(
        [(name, types[getattr(hint, "__args__", (hint,))[0]]) for name, hint in hints.items()]
    )


class PhotoIndex:
    """The index of predictions, which one process at a time writes."""

    def __init__(self, output: Place, rows: int, every: float = 30.0):
        """Read which of the `rows` are there; raise `InputError` for a damaged part.

        every: seconds after which a part is written, if it has not enough rows before.
        """
        self._folder, self._every = output.child(FOLDER), every
        self.done = np.zeros(rows, bool)
        self.failed = 0
        self._next, self._held, self._since = 0, list[PhotoRow](), time.monotonic()
        for number, part in self._parts().items():
            columns = _columns(part, PhotoRow, ["row", "state"]).to_pydict()
            known = np.array(columns["row"], np.int64)
            if len(known) and not 0 <= known.min() <= known.max() < rows:
                raise InputError(
                    f"{part} has rows that the table of photos does not have; choose another folder with -o."
                )
            self.done[known] = True
            self.failed += columns["state"].count(State.FAILED.value)
            self._next = max(self._next, number + 1)

    def _parts(self) -> dict[int, Place]:
        found = dict[int, Place]()
        for name in self._folder.names():
            number = _PART.fullmatch(name)
            if number is None and name.startswith("part-"):
                raise InputError(f"{self._folder}/{name} is no part of the index; remove it.")
            if number is not None:
                found[int(number[1])] = self._folder.child(name)
        return found

    @property
    def count(self) -> int:
        """How many rows are known, written or held."""
        return int(self.done.sum())

    def forget_failures(self) -> None:
        """Drop the rows of photos that failed, so that they are tried again."""
        for part in self._parts().values():
            rows = decode(part, PhotoRow)
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
        if len(self._held) >= _ROWS or time.monotonic() - self._since >= self._every:
            self.flush()

    def flush(self) -> None:
        """Write the rows that are held as a part of their own."""
        if self._held:
            part = self._folder.child(f"part-{self._next:06d}.parquet")
            part.write(encode(self._held, PhotoRow))
            self._next, self._held = self._next + 1, []
        self._since = time.monotonic()


class SceneIndex:
    """The index of trainings, one file that is written anew whenever a scene is finished or given up."""

    NAME = "index.parquet"

    def __init__(self, output: Place):
        """Read it, if it is there."""
        self._file = output.child(self.NAME)
        rows = decode(self._file, SceneRow) if self._file.exists() else []
        self.rows = {row.scene: row for row in rows}

    def put(self, row: SceneRow) -> None:
        """Take a scene's row in the place of an earlier one, and write the file."""
        self.rows[row.scene] = row
        self._file.write(encode(self.rows.values(), SceneRow))
