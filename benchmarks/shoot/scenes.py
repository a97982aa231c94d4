"""Whole benchmark scenes of a model: in a studio, and on tables with relit views beside the telephone's photos."""

from collections.abc import Callable
from pathlib import Path

import demo_scene.dataset as studio
from demo_scene.textures import Model
from lightprobe.core.files import atomic_folder

from .folder import Settings, Shoot

_TABLE = 0.1  # sine of the elevation from which an object on a table is looked at


def write_studio(folder: Path, name: str, model: Model, settings: studio.Settings) -> None:
    """Photograph a model in a studio, every photo under a light of its own, unless `folder` exists."""
    if not folder.exists():
        with atomic_folder(folder) as temporary:
            studio.write_scene(temporary, settings, name, model)


def write_tables(
    folder: Path, settings: Settings, model: Model, relit: studio.Settings, say: Callable[[str], None]
) -> None:
    """Photograph an object on tables, and its `model` from above under two more lights, of which all is known.

    Without test places in `settings` test photos are of a studio, too, with true materials and normals.
    """
    Shoot(folder, settings, say).write()
    writer = studio.Writer(folder, relit, model)
    if settings.test_places == 0:
        studio.write_split(writer, "test", relit.test, 1000, _TABLE)
    studio.write_relight(writer, 2000, _TABLE)
