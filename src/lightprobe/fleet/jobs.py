"""The photos to predict from: a Parquet file, one row for each, read a part at a time.

    column   needed   meaning
    run      yes      the object's run folder, path or URL
    photo    yes      the photo, path or URL
    camera   no       its camera, as `lightprobe predict --camera` takes it; else it is found
    mask     no       its mask; else its alpha, or it is found
    method   no       how the light is found; else as the command says
    id       no       carried over to the index, for whoever made the file

All are text; what is not needed may be absent or null. Relative paths start at the folder of the file. Rows
of one run should stand together: neighbours of one run become one task, which loads the object once.
"""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from lightprobe.core.errors import InputError, LightprobeError, shown
from lightprobe.core.extras import extra_library
from lightprobe.fleet.storage import Place

NEEDED, OPTIONAL = ("run", "photo"), ("camera", "mask", "method", "id")
_AT_ONCE = 16_384  # rows that are read and grouped together
_LARGEST_GROUP = 2**31  # bytes of a row group, unpacked: what a reader has to hold
_FOOTER = (
    2**20
)  # bytes at the end of the file that tell it from others: sizes, counts and ranges of all columns


@dataclass(frozen=True)
class Job:
    """One photo to predict from."""

    row: int  # of the file, from 0
    run: str
    photo: str
    camera: str | None = None
    mask: str | None = None
    method: str | None = None
    id: str | None = None


class JobFile:
    """A Parquet file of jobs, checked as far as it can be without reading its rows."""

    def __init__(self, place: Place):
        """Open it; raise `InputError` when it is missing, no Parquet file, or has not these columns."""
        self.place = place
        parquet = extra_library("pyarrow.parquet", "A file of jobs", "cluster")
        source = place.parquet()
        try:
            self._file = parquet.ParquetFile(source)
            metadata = self._file.metadata
            groups = [metadata.row_group(i).total_byte_size for i in range(metadata.num_row_groups)]
        except Exception as error:  # Arrow has many kinds for damage
            raise InputError(f"{place} cannot be read as Parquet: {_first_line(error)}.") from error
        if max(groups, default=0) > _LARGEST_GROUP:
            raise InputError(
                f"{place} has a row group of {max(groups) / 1e9:.1f} GB; write it with smaller ones."
            )
        self.rows = int(metadata.num_rows)
        self._columns = self._checked_columns()

    def _checked_columns(self) -> list[str]:
        types = extra_library("pyarrow.types", "A file of jobs", "cluster")
        schema, known = self._file.schema_arrow, (*NEEDED, *OPTIONAL)
        for name in NEEDED:
            if name not in schema.names:
                raise InputError(
                    f"{self.place} has no column '{name}'; it needs the columns {', '.join(NEEDED)}."
                )
        for field in schema:
            if field.name not in known:
                raise InputError(
                    f"{self.place} has a column '{shown(field.name)}', which means nothing; known are "
                    f"{', '.join(known)}; what is yours goes into id."
                )
            kind = field.type.value_type if types.is_dictionary(field.type) else field.type
            if not (types.is_string(kind) or types.is_large_string(kind) or types.is_null(kind)):
                raise InputError(f"{self.place}: the column '{field.name}' must be text, not {field.type}.")
        return [name for name in known if name in schema.names]

    def identity(self) -> dict[str, Any]:
        """Return what tells this file from another: its number of rows and a checksum of its footer."""
        if self.place.local is not None:
            with open(self.place.local, "rb") as file:
                end = file.seek(0, 2)
                file.seek(max(0, end - _FOOTER))
                tail = file.read()
        else:
            tail = self.place.read()[-_FOOTER:]
        return {"rows": self.rows, "footer": hashlib.blake2b(tail, digest_size=16).hexdigest()}

    def parts(self, wanted: Callable[[int], bool]) -> Iterator[list[Job]]:
        """Yield the jobs whose row is `wanted`, some thousands at a time; raise `InputError` for damaged
        pages.
        """
        first = 0
        batches = self._file.iter_batches(batch_size=_AT_ONCE, columns=self._columns)
        while True:
            try:
                batch = next(batches, None)
                values = None if batch is None else batch.to_pydict()
            except Exception as error:
                raise InputError(
                    f"{self.place} is damaged after row {first}: {_first_line(error)}."
                ) from error
            if batch is None or values is None:
                return
            yield [
                Job(first + i, **{name: _text(values[name][i], name) for name in self._columns})  # type: ignore[arg-type]
                for i in range(batch.num_rows)
                if wanted(first + i)
            ]
            first += batch.num_rows


def _text(value: str | None, name: str) -> str | None:
    """Return a value; what is needed and missing is empty, and refused where it is used, in that row alone."""
    return (value or "") if name in NEEDED else (value or None)


def _first_line(error: Exception) -> str:
    if isinstance(error, LightprobeError):
        return str(error).rstrip(".")
    return (str(error).strip().split("\n")[0] or type(error).__name__).rstrip(".")


def chunks(jobs: list[Job], size: int) -> Iterator[tuple[Job, ...]]:
    """Yield jobs of one run, at most `size` at a time, each run's in order."""
    by_run: dict[str, list[Job]] = {}
    for job in jobs:
        by_run.setdefault(job.run, []).append(job)
    for same in by_run.values():
        for start in range(0, len(same), size):
            yield tuple(same[start : start + size])
