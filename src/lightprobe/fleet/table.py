"""The photos to predict from: a Parquet file, one row for each, read a part at a time.

    column   needed   meaning
    run      yes      the object's run folder, path or URL
    photo    yes      the photo, path or URL
    camera   no       its camera, as `lightprobe predict --camera` takes it; else it is found
    mask     no       its mask; else its alpha, or it is found
    id       no       carried over to the index, for whoever made the file
    method, size, sun, ...   no   every field of `jobs.request.LightOptions`; else as the command says

All are text; what is not needed may be absent or null. Relative paths start at the folder of the file. Rows
of one run should stand together: neighbours of one run become one task, which loads the object once.
"""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from typing import Any

from lightprobe.core.errors import InputError, LightprobeError, shown
from lightprobe.core.extras import extra_library
from lightprobe.fleet.storage import Place
from lightprobe.jobs import LightOptions

_NEEDED, _OPTIONAL = ("run", "photo"), ("camera", "mask", "id")
_OPTIONS = tuple(field.name for field in fields(LightOptions))
_AT_ONCE = 16_384  # rows that are read and grouped together
_LARGEST_GROUP = 2**31  # bytes of a row group, unpacked: what a reader has to hold
_FOOTER = 2**20  # bytes at the end of the file with the sizes, counts and ranges of all columns


@dataclass(frozen=True)
class TableRow:
    """One photo to predict from."""

    row: int  # of the file, from 0
    run: str
    photo: str
    camera: str | None = None
    mask: str | None = None
    id: str | None = None
    options: dict[str, str] = field(default_factory=dict)  # of `LightOptions`, as text


class PhotoTable:
    """A Parquet file of photos, checked as far as it can be without reading its rows."""

    def __init__(self, place: Place):
        """Open it; raise `InputError` when it is missing, no Parquet file, or has not these columns."""
        self.place = place
        parquet = extra_library("pyarrow.parquet", "A table of photos", "cluster")
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
        types = extra_library("pyarrow.types", "A table of photos", "cluster")
        schema, known = self._file.schema_arrow, (*_NEEDED, *_OPTIONAL, *_OPTIONS)
        for name in _NEEDED:
            if name not in schema.names:
                raise InputError(
                    f"{self.place} has no column '{name}'; it needs the columns {', '.join(_NEEDED)}."
                )
        for column in schema:
            if column.name not in known:
                raise InputError(
                    f"{self.place} has a column '{shown(column.name)}', which means nothing; known are "
                    f"{', '.join(known)}; what is yours goes into id."
                )
            kind = column.type.value_type if types.is_dictionary(column.type) else column.type
            if not (types.is_string(kind) or types.is_large_string(kind) or types.is_null(kind)):
                raise InputError(f"{self.place}: the column '{column.name}' must be text, not {column.type}.")
        return [name for name in known if name in schema.names]

    def identity(self) -> dict[str, Any]:
        """Return what tells this file from another: its number of rows and a checksum of its footer."""
        if self.place.local is not None:
            with open(self.place.local, "rb") as file:
                file.seek(max(0, file.seek(0, 2) - _FOOTER))
                tail = file.read()
        else:
            tail = self.place.read()[-_FOOTER:]
        return {"rows": self.rows, "footer": hashlib.blake2b(tail, digest_size=16).hexdigest()}

    def chunks(self, size: int, wanted: Callable[[int], bool]) -> Iterator[tuple[TableRow, ...]]:
        """Yield rows of one run, at most `size` at a time, of those whose number is `wanted`.

        Each run's are in order. Raises `InputError` for damaged pages.
        """
        first = 0
        batches = self._file.iter_batches(batch_size=_AT_ONCE, columns=self._columns)
        while True:
            try:
                batch = next(batches, None)
                values = [] if batch is None else batch.to_pylist()
            except Exception as error:
                raise InputError(
                    f"{self.place} is damaged after row {first}: {_first_line(error)}."
                ) from error
            if batch is None:
                return
            by_run = dict[str, list[TableRow]]()
            for number, entry in enumerate(values, first):
                if wanted(number):
                    row = _row(number, entry)
                    by_run.setdefault(row.run, []).append(row)
            for rows in by_run.values():
                yield from (tuple(rows[start : start + size]) for start in range(0, len(rows), size))
            first += batch.num_rows


def _row(number: int, entry: dict[str, str | None]) -> TableRow:
    """Return a row; what is needed and missing is empty, and refused where it is used, in that row alone."""
    optional = {name: entry.get(name) or None for name in _OPTIONAL}
    options = {name: text for name in _OPTIONS if (text := entry.get(name))}
    return TableRow(number, entry["run"] or "", entry["photo"] or "", **optional, options=options)


def _first_line(error: Exception) -> str:
    if isinstance(error, LightprobeError):
        return str(error).rstrip(".")
    return (str(error).strip().split("\n")[0] or type(error).__name__).rstrip(".")
