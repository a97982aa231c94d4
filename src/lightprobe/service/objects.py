"""The objects of a folder of runs, found by their names in its listing: no name of a request becomes a path."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lightprobe.core.errors import InputError, shown
from lightprobe.core.files import disk_errors
from lightprobe.core.run import RunFolder
from lightprobe.web.errors import UnknownObjectError


@dataclass(frozen=True)
class KnownObject:
    """An object that light can be predicted with."""

    name: str
    run: RunFolder

    def to_json(self) -> dict[str, Any]:
        """Return what the list of objects says of it."""
        return {
            "name": self.name,
            "trained": (self.run.model_folder / "config.json").is_file(),
            "locatable": self.run.views_file.is_file(),
            "calibrated": self.run.calibration_file.is_file(),
        }


class Objects:
    """The runs of a folder whose objects are reconstructed; runs may come and go meanwhile."""

    def __init__(self, folder: Path):
        """Look at `folder`; raise `InputError` where there is none."""
        self._folder = folder.resolve()
        if not self._folder.is_dir():
            raise InputError(
                f"{folder} is no folder of runs; name the folder that holds them, as runs of runs/cup."
            )
        if RunFolder(self._folder).config_file.is_file():
            raise InputError(
                f"{folder} is a run itself; name the folder that holds it: {self._folder.parent}"
            )

    def find(self, name: str) -> KnownObject:
        """Return the object of a name; raise `UnknownObjectError` when there is none."""
        path = self._listing().get(name)
        if path is None or (found := _object(name, path)) is None:
            raise UnknownObjectError(
                f"There is no object '{shown(name)}' here; GET /objects lists their names."
            )
        return found

    def after(self, name: str, most: int) -> tuple[list[KnownObject], str | None]:
        """Return at most `most` objects whose names follow `name`, and the last name unless these are all."""
        found: list[KnownObject] = []
        for key, path in sorted(self._listing().items()):
            if key > name and (one := _object(key, path)) is not None:
                if len(found) == most:
                    return found, found[-1].name
                found.append(one)
        return found, None

    def _listing(self) -> dict[str, Path]:
        """Return the folders by their names; links are not followed, as they could lead anywhere."""
        with disk_errors(self._folder), os.scandir(self._folder) as entries:
            return {
                entry.name: Path(entry.path)
                for entry in entries
                if not entry.name.startswith(".") and entry.is_dir(follow_symlinks=False)
            }


def _object(name: str, path: Path) -> KnownObject | None:
    run = RunFolder(path)
    return KnownObject(name, run) if run.config_file.is_file() and run.asset_file.is_file() else None
