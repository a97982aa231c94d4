"""Files and folders by path or by URL: of this machine, or of an object store through fsspec.

A file appears whole or not at all: on this machine by a rename, in an object store because a put is atomic
there. The kinds of URL are few on purpose: fsspec also knows some that run commands or unpack archives.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lightprobe.core.errors import ConfigError, InputError, LightprobeError, ResourceError, shown
from lightprobe.core.extras import extra_library
from lightprobe.core.files import disk_errors, inside, is_file_name, remove, write_bytes
from lightprobe.core.reading import LARGEST_MODEL, check_file

_HERE = "file"
# kind of URL -> the package that fsspec needs for it
_STORES = {"memory": "", "s3": "s3fs", "gs": "gcsfs", "gcs": "gcsfs", "abfs": "adlfs", "az": "adlfs"}
_LONGEST = 4096  # characters of a path or URL


@dataclass(frozen=True)
class Place:
    """A file or a folder, which may not exist yet."""

    protocol: str  # "file", or a kind of object store
    path: str  # absolute; in an object store bucket and key

    @staticmethod
    def of(text: str | Path, beside: "Place | None" = None) -> "Place":
        """Return the place of a path or URL; relative paths start at the folder `beside`, by default the
        current one.

        Raises `InputError` for what can be neither, and for kinds of URL that are not read.
        """
        given = str(text)
        if not given or len(given) > _LONGEST or "\0" in given:
            raise InputError(
                f"'{shown(given)}' is no path or URL; give one of at most {_LONGEST} characters."
            )
        protocol, found, path = given.partition("://")
        if not found:
            if beside is None or beside.protocol == _HERE or os.path.isabs(given):
                return Place(_HERE, os.path.abspath(os.path.join(beside.path if beside else "", given)))
            return Place.of(f"{beside}/{given}")
        if "::" in given or protocol not in (_HERE, *_STORES):
            known = ", ".join(f"{kind}://" for kind in (_HERE, *_STORES))
            raise InputError(f"'{shown(given)}' cannot be read: URLs may begin with {known}.")
        if protocol == _HERE:
            return Place(_HERE, os.path.abspath(path))
        if not path.strip("/") or any(part in (".", "..") for part in path.split("/")):
            raise InputError(f"'{shown(given)}' names no object; give bucket and key without dots.")
        return Place(protocol, path.strip("/"))

    def __str__(self) -> str:
        return self.path if self.protocol == _HERE else f"{self.protocol}://{self.path}"

    @property
    def local(self) -> Path | None:
        """The path, where this machine has it."""
        return Path(self.path) if self.protocol == _HERE else None

    @property
    def name(self) -> str:
        """The last part."""
        return self.path.rstrip("/").rpartition("/")[2]

    @property
    def parent(self) -> "Place":
        """The folder that it lies in."""
        return Place(self.protocol, self.path.rpartition("/")[0] or "/")

    def child(self, *names: str) -> "Place":
        """Return a place below; raise `InputError` unless every name is a plain one."""
        for name in names:
            if not is_file_name(name):
                raise InputError(
                    f"{name[:200]!a} cannot be the name of a file in {self}: it must be a plain name."
                )
        return Place(self.protocol, "/".join([self.path.rstrip("/"), *names]))

    def exists(self) -> bool:
        """Return whether there is a file or folder."""
        return self.local.exists() if self.local is not None else bool(self._remote("exists", self.path))

    def is_folder(self) -> bool:
        """Return whether there is a folder."""
        return self.local.is_dir() if self.local is not None else bool(self._remote("isdir", self.path))

    def read(self, largest: int = LARGEST_MODEL) -> bytes:
        """Return a file's bytes; raise `InputError` when there is none or it has more than `largest`."""
        if self.local is not None:
            check_file(self.local, largest)
            return self.local.read_bytes()
        size = self._remote("info", self.path).get("size") or 0
        if size > largest:
            raise InputError(
                f"{self} has {size / 1e9:.1f} GB, more than the {largest / 1e9:.1f} GB that are read."
            )
        data: bytes = self._remote("cat_file", self.path)
        return data

    def write(self, data: bytes) -> None:
        """Write a file, whole or not at all, and the folders that it lies in."""
        write_bytes(self.local, data) if self.local is not None else self._remote(
            "pipe_file", self.path, data
        )

    def remove(self) -> None:
        """Remove a file, if there is one."""
        if self.local is not None:
            remove(self.local)
        elif self.exists():
            self._remote("rm_file", self.path)

    def names(self) -> list[str]:
        """Return the names in a folder in order, without hidden ones; none where there is no such folder."""
        if not self.is_folder():
            return []
        if self.local is not None:
            with disk_errors(self.local):
                found = os.listdir(self.local)
        else:
            paths = self._remote("ls", self.path, detail=False)
            found = [path.rstrip("/").rpartition("/")[2] for path in paths if path.strip("/") != self.path]
        return sorted(name for name in found if name and not name.startswith("."))

    def files(self) -> list[str]:
        """Return the relative paths of the files of an object store below a folder."""
        return [path.strip("/")[len(self.path) + 1 :] for path in self._remote("find", self.path)]

    def fetch(self, to: Path, largest: int = LARGEST_MODEL) -> Path:
        """Return the path of a file on this machine: its own, or `to` after copying it there."""
        if self.local is not None:
            return self.local
        write_bytes(to, self.read(largest))
        return to

    def fetch_folder(self, to: Path, leave_out: tuple[str, ...] = ()) -> Path:
        """Return the path of a folder on this machine: its own, or `to` after copying its files there.

        leave_out: beginnings of relative paths that are not needed. Raises `InputError` when there is no
        file.
        """
        if self.local is not None:
            return self.local
        names = [name for name in self.files() if not name.startswith(leave_out)]
        if not names:
            raise InputError(f"{self} does not exist or is empty.")
        for name in names:
            write_bytes(
                inside(to, name, source=Path(str(self))), Place(self.protocol, f"{self.path}/{name}").read()
            )
        return to

    def parquet(self) -> Any:
        """Return what pyarrow reads a file from: its path, or an open file of the object store."""
        if self.local is None:
            return self._remote("open", self.path, "rb")
        check_file(self.local, 2**40)
        return str(self.local)

    def _remote(self, method: str, *arguments: Any, **options: Any) -> Any:
        """Return what a method of the object store's filesystem does; its errors become sentences."""
        try:
            fsspec = extra_library("fsspec", "An object store", "cluster")
            store = fsspec.filesystem(self.protocol, use_listings_cache=False)
            return getattr(store, method)(*arguments, **options)
        except LightprobeError:
            raise
        except FileNotFoundError as error:
            raise InputError(f"{self} does not exist.") from error
        except ImportError as error:
            package = _STORES[self.protocol]
            raise ConfigError(
                f"{self} needs a library that is not installed: pip install {package}."
            ) from error
        except Exception as error:  # each store has errors of its own, from wrong keys to broken networks
            said = str(error).strip().split("\n")[0] or type(error).__name__
            raise ResourceError(f"{self} cannot be reached: {said.rstrip('.')}.") from error
