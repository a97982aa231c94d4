"""Preparing plain photos as a scene, alone or as the first step of a run."""

import warnings
from pathlib import Path

from lightprobe.core.errors import LightprobeWarning
from lightprobe.core.run import RunFolder
from lightprobe.preparation import Prepared, PrepareOptions, prepare
from lightprobe.runs.progress import OnProgress, silent

SCENE = "scene"  # the folder in a run that holds what was made of plain photos


def prepare_scene(photos: Path | str, output: Path | str, options: PrepareOptions | None = None, *,
                  on_progress: OnProgress = silent) -> Prepared:  # fmt: skip
    """Make a scene folder of plain photos: cameras, masks, upright frame, prepare.json and contact.png.

    The same call goes on where an interrupted one stopped, and with masks that were corrected in `output`/masks.
    Warns of what may be wrong. Raises `InputError` for photos from which no scene can be made, `ConfigError` for
    options that cannot be used or without the libraries of lightprobe[photos].
    """
    prepared = prepare(Path(photos), Path(output), options or PrepareOptions(), on_progress)
    for sentence in prepared.warnings:
        warnings.warn(sentence, LightprobeWarning, stacklevel=2)
    return prepared


def prepared_in(run: RunFolder, photos: Path, on_progress: OnProgress) -> Path:
    """Return the scene that a run holds of plain photos, after making it or going on with it."""
    return prepare_scene(photos, run.path / SCENE, on_progress=on_progress).folder
