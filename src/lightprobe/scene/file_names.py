"""Files of a scene by the paths that camera files of other programs, systems and machines write.

A path is taken as it is written; else with slashes for backslashes; else whatever its letter case and Unicode
form; else by its end, where its beginning is a place on another machine. Each only where one file fits. A path
that is written in a file never leads out of the scene's folder; links that lie in the folder are followed.
"""

import os
import re
import unicodedata
import warnings
from collections.abc import Sequence
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from lightprobe.core.errors import InputError, LightprobeWarning, shown
from lightprobe.core.files import inside

_PLACES = ("", "images")  # of the scene folder, that paths may start from
_LONGEST_END = 16  # parts of a path that are looked for
_SHOWN = 3  # files that a sentence names


class SceneFiles:
    """The files of a scene folder, to be found by what one camera file writes."""

    def __init__(self, root: Path, source: Path, *, places: Sequence[str] = _PLACES):
        """Look for files in folder `root`, from each of its folders `places` in this order."""
        self._root, self._source = Path(root), source
        self._entries: dict[Path, list[str]] = {}
        self._places = [
            folder
            for place in places
            for folder in ([self._root / place] if (self._root / place).is_dir() else self._folders([place]))
        ]
        self._moved: dict[str, Path] = {}  # paths of other places, and what they are taken for

    @property
    def folder(self) -> Path:
        """The folder that paths are meant to start from."""
        return self._places[0]

    def find(self, written: str, suffixes: Sequence[str] = ("",)) -> Path | None:
        """Return the file that a path means, which may lack one of `suffixes`, or None where there is none.

        Raises `InputError` for a path that is no path or leads out of the folder, and where several files fit.
        """
        text = slashed(written)
        is_away = _is_absolute(text)
        for spelling in dict.fromkeys([written, text, unquote(text)]):
            if (found := self._exact(spelling, suffixes, refuse=not is_away)) is not None:
                return found
        if not is_away and (found := self._folded(PurePosixPath(text).parts, suffixes)) is not None:
            return found
        found = self._by_end(text, suffixes, fewest=1 if is_away else 2)
        if found is not None:
            self._moved[written] = found
        elif is_away and not Path(os.path.normpath(text)).is_relative_to(self._root):
            raise InputError(
                f"{self._source} names '{shown(written)}', which lies outside {self._root}; use paths inside the scene "
                "folder."
            )
        return found

    def key(self, written: str, suffixes: Sequence[str] = ("",)) -> str:
        """Return what paths of one file have in common: the file found, else the path in one spelling."""
        try:
            found = self.find(written, suffixes)
        except InputError:  # told where the file is asked for
            found = None
        return fold(os.path.normpath(slashed(written))) if found is None else str(found)

    def missing(self, written: str) -> str:
        """Return, for a sentence about a path without a file, what lies at its place instead; or nothing."""
        parts = PurePosixPath(slashed(written)).parts
        for place in (place.joinpath(*parts) for place in self._places):
            if place.is_symlink():
                return f"; it is a link to '{shown(os.readlink(place))}', where no file is"
            if place.is_dir():
                return "; it is a folder"
        stem = fold(PurePosixPath(parts[-1]).stem) if parts else ""
        folders = [folder for place in self._places for folder in self._folders(parts[:-1], place)]
        for folder in folders:
            alike = [name for name in self._list(folder) if stem and fold(PurePosixPath(name).stem) == stem]
            if alike:
                return f"; the folder holds {_listed(alike)}"
        return "" if folders else f"; there is no folder '{shown('/'.join(parts[:-1]))}'"

    def warn_of_moved(self) -> None:
        """Warn of paths of another place that were taken for files of this folder, if there were any."""
        if not self._moved:
            return
        written, found = next(iter(self._moved.items()))
        count = f"{len(self._moved)} paths" if len(self._moved) > 1 else "a path"
        warnings.warn(
            f"{self._source} names {count} of another place, such as '{shown(written)}', which is taken for "
            f"{shown(str(found))}.",
            LightprobeWarning,
            stacklevel=2,
        )

    def _exact(self, text: str, suffixes: Sequence[str], *, refuse: bool) -> Path | None:
        """Return the file at a path as written, from the first of the places that has it."""
        for place in self._places:
            for suffix in suffixes:
                try:
                    guess = inside(place, text + suffix, source=self._source, follow_links=True)
                except InputError:
                    if refuse:
                        raise
                    return None
                if guess.is_file():
                    return guess
        return None

    def _folded(self, parts: Sequence[str], suffixes: Sequence[str]) -> Path | None:
        """Return the file of a path whatever the letter case and Unicode form; refuse several."""
        if ".." in parts or not parts:
            return None
        wanted = {fold(parts[-1] + suffix) for suffix in suffixes}
        for place in self._places:
            folders = self._folders(parts[:-1], place)
            found = [
                folder / name for folder in folders for name in self._list(folder) if fold(name) in wanted
            ]
            found = [file for file in found if file.is_file()]
            if len(found) > 1:
                names = {unicodedata.normalize("NFC", parts[-1] + suffix) for suffix in suffixes}
                found = [f for f in found if unicodedata.normalize("NFC", f.name) in names] or found
            if len(found) > 1:
                files = [file.relative_to(self._root).as_posix() for file in found]
                raise InputError(
                    f"{self._source} names '{shown('/'.join(parts))}', which could be {_listed(files)}; write one of them."
                )
            if found:
                return found[0]
        return None

    def _by_end(self, text: str, suffixes: Sequence[str], *, fewest: int) -> Path | None:
        """Return the file of the longest end of a path, of `fewest` parts or more, that the folder has."""
        parts = [part for part in re.sub(r"^[A-Za-z]:", "", text).split("/") if part not in ("", ".")]
        above = max((place for place, part in enumerate(parts) if part == ".."), default=-1)
        parts = parts[above + 1 :][-_LONGEST_END:]
        for start in range(len(parts) - fewest + 1):
            end = parts[start:]
            found = self._exact("/".join(end), suffixes, refuse=False) or self._folded(end, suffixes)
            if found is not None:
                return found
        return None

    def _folders(self, parts: Sequence[str], start: Path | None = None) -> list[Path]:
        """Return the folders that a path leads to from `start`, whatever the letter case and Unicode form."""
        folders = [start or self._root]
        for part in parts:
            if part == "..":
                return []
            folders = [
                folder / name for folder in folders for name in self._list(folder) if fold(name) == fold(part)
            ]
        return folders

    def _list(self, folder: Path) -> list[str]:
        """Return the names in a folder, none where it cannot be listed."""
        if folder not in self._entries:
            try:
                self._entries[folder] = sorted(os.listdir(folder))
            except (OSError, ValueError):
                self._entries[folder] = []
        return self._entries[folder]


def slashed(written: str) -> str:
    """Return a path with slashes only, and without the scheme of an address `file:`."""
    address = re.match(r"file:(//(localhost)?(?=/))?", written, re.IGNORECASE)
    text = unquote(written[address.end() :]) if address else written
    text = text.strip().replace("\\", "/")
    return text[1:] if re.match(r"/[A-Za-z]:/", text) else text


def _is_absolute(text: str) -> bool:
    return text.startswith("/") or re.match(r"[A-Za-z]:", text) is not None


def fold(name: str) -> str:
    """Return what spellings of a name have in common that file systems take for one."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def _listed(names: Sequence[str]) -> str:
    some = [f"'{shown(name)}'" for name in names[:_SHOWN]]
    rest = [f"{len(names) - _SHOWN} more"] if len(names) > _SHOWN else []
    *first, last = some + rest
    return f"{', '.join(first)} and {last}" if first else last
