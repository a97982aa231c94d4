"""The objects of a folder of runs, found by their names in its listing: no name of a request becomes a path."""

import os
from pathlib import Path

from pydantic import BaseModel

from lightprobe.core.errors import InputError, shown
from lightprobe.core.files import disk_errors
from lightprobe.core.run import RunFolder
from lightprobe.web.errors import RefusedError


class ObjectEntry(BaseModel):
    """An object that light can be predicted with."""

    name: str
    trained: bool
    """Whether it has a model; without one the light is only solved for."""
    locatable: bool
    """Whether photos without a camera can be taken at once."""
    calibrated: bool
    """Whether the brightness of its maps is the true one."""

    @staticmethod
    def of(run: RunFolder) -> "ObjectEntry":
        """Return what a run says of its object."""
        return ObjectEntry(
            name=run.path.name,
            trained=(run.model_folder / "config.json").is_file(),
            locatable=run.views_file.is_file(),
            calibrated=run.calibration_file.is_file(),
        )


class ObjectList(BaseModel):
    """Objects in the order of their names."""

    objects: list[ObjectEntry]
    next: str | None
    """What to give as `after` for the objects that follow; null: there are none."""


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

    def find(self, name: str) -> RunFolder:
        """Return the run of an object; raise `RefusedError` (404) when there is none."""
        run = RunFolder(self._folder / name) if name in self._names() else None
        if run is None or not _is_reconstructed(run):
            raise RefusedError(
                404, f"There is no object '{shown(name)}' here; GET /objects lists their names."
            )
        return run

    def after(self, name: str, most: int) -> ObjectList:
        """Return at most `most` objects whose names follow `name`."""
        runs = (RunFolder(self._folder / one) for one in self._names() if one > name)
        found = [ObjectEntry.of(run) for run in runs if _is_reconstructed(run)]
        return ObjectList(objects=found[:most], next=found[most - 1].name if len(found) > most else None)

    def _names(self) -> list[str]:
        """Return the names of the folders, sorted; links are not followed, as they could lead anywhere."""
        with disk_errors(self._folder), os.scandir(self._folder) as entries:
            folders = (entry.name for entry in entries if entry.is_dir(follow_symlinks=False))
            return sorted(name for name in folders if not name.startswith("."))


def _is_reconstructed(run: RunFolder) -> bool:
    return run.config_file.is_file() and run.asset_file.is_file()
