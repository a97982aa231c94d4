"""The steps of a preparation, kept beside the scene so that the same command goes on: one file a step.

A step's key is the checksum of all that it depends on. A file is written whole or not at all, and a file of
another key is as good as none.
"""

import hashlib
import io
import json
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from lightprobe.core.files import named_file, write_bytes

HIDDEN = ".prepare"  # the folder in a scene that holds the steps
_LARGEST = 2**32  # bytes of a step's arrays: what is more is no step of ours
_VERSION = 10  # of all steps: raised when what they keep, or how they find it, changes


Kept = TypeVar("Kept")


def array_key(array: np.ndarray) -> str:
    """Return the checksum of an array of any shape."""
    return hashlib.blake2b(array.tobytes(), digest_size=16).hexdigest()


def key_of(*parts: Any) -> str:
    """Return the checksum of JSON values."""
    text = json.dumps([_VERSION, *parts], sort_keys=True, default=str)
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


class Cache:
    """The kept steps of a scene, each some arrays of any shape by name, in a folder of their own."""

    def __init__(self, folder: Path):
        self.folder = Path(folder)

    def arrays(
        self, name: str, key: str, make: Callable[[], Mapping[str, np.ndarray]]
    ) -> dict[str, np.ndarray]:
        """Return the arrays of step `name` that are kept under `key`, else those that `make` returns."""
        found = self.find(name, key)
        if found is None:
            found = dict(make())
            self.keep(name, key, found)
        return found

    def find(self, name: str, key: str) -> dict[str, np.ndarray] | None:
        """Return the arrays of step `name` that are kept under `key`, None where none are."""

        def wanted(stored: Mapping[str, np.ndarray]) -> dict[str, np.ndarray] | None:
            if str(stored["key"]) != key:
                return None
            return {name: stored[name] for name in stored if name != "key"}

        return self._read(name, wanted)

    def newest(self, name: str, part: str) -> np.ndarray | None:
        """Return one array, of any shape, of step `name`, of whatever key; None where none is kept."""
        return self._read(name, lambda stored: np.asarray(stored[part]))

    def _read(self, name: str, wanted: Callable[[Mapping[str, np.ndarray]], Kept | None]) -> Kept | None:
        """Return what is `wanted` of the arrays of step `name`; None where they are not there, or damaged."""
        path = named_file(self.folder, name, ".npz")
        try:
            with zipfile.ZipFile(path) as archive:
                if sum(part.file_size for part in archive.infolist()) > _LARGEST:
                    return None
            with np.load(path, allow_pickle=False) as stored:
                return wanted(stored)
        except Exception:  # whatever the parsers of a damaged archive and its arrays run into
            return None

    def keep(self, name: str, key: str, values: Mapping[str, np.ndarray]) -> None:
        """Keep the arrays of step `name` under `key`."""
        buffer = io.BytesIO()
        np.savez_compressed(buffer, **{**values, "key": np.array(key)})  # type: ignore[arg-type]
        write_bytes(named_file(self.folder, name, ".npz"), buffer.getvalue())
