"""Who writes a folder of results, and what the results in it are of."""

import contextlib
import json
from collections.abc import Iterator
from typing import Any

from lightprobe.core.config.stored import first_difference, plain
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.files import disk_errors, locked_file
from lightprobe.fleet.storage import Place

RECORD = "fleet.json"
_LARGEST = 2**20  # bytes of a record


@contextlib.contextmanager
def held(output: Place, record: dict[str, Any], *, alone: bool) -> Iterator[None]:
    """Hold a folder of results, where this machine has it, once what the results are of is known to be `record`.

    An object store has no locks. alone: whether a new folder has to be empty. Raises `LockedError` when another
    fleet writes it, `ConfigError` where the results that lie there are of something else, `InputError` for a
    damaged record.
    """
    if output.local is None:
        _check_record(output, record, alone)
        yield
        return
    with disk_errors(output.local):
        output.local.mkdir(parents=True, exist_ok=True)
    busy = f"{output} is being written by another fleet; wait for it to end."
    with locked_file(output.local / ".fleet.lock", busy):
        _check_record(output, record, alone)
        yield


def _check_record(output: Place, record: dict[str, Any], alone: bool) -> None:
    file, given = output.child(RECORD), plain(record)
    if not file.exists():
        if alone and output.names():
            raise ConfigError(f"{output} is not empty and no fleet's; choose another folder with -o.")
        file.write((json.dumps(given, indent=2) + "\n").encode())
        return
    try:
        stored = json.loads(file.read(_LARGEST))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{file} is damaged; choose another folder with -o.") from error
    difference = first_difference(stored, given, "fleet")
    if difference:
        key, old, new = difference
        raise ConfigError(
            f"{output} was started with {key} = {old}, not {new}; choose another folder with -o."
        )
