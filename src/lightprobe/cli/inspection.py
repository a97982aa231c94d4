"""inspect: what is in a folder of photos, before an hour is spent on it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from lightprobe.cli.answer import say
from lightprobe.cli.options import SceneArg, option
from lightprobe.core.errors import ConfigError, InputError, printable
from lightprobe.core.files import refuse_replacing
from lightprobe.scene.inspect import Inspection, PhotoReport
from lightprobe.scene.inspect import inspect as examine
from lightprobe.scene.overlay import write_overlay_sheet
from lightprobe.scene.plain_photos import PlainInspection, inspect_plain, is_plain

_SheetArg = Annotated[
    Path | None,
    option(
        aliases=["-o"], metavar="SHEET.png", help="Overlay sheet to write; by default SCENE-overlay.png here."
    ),
]


def inspect(scene: SceneArg, *, output: _SheetArg = None) -> None:
    """Print what was found and every problem at once, and draw the visual hull's outline over every photo.

    Of photos or a video without cameras it tells whether cameras can be found, and what to photograph next.

    Examples:
      lightprobe inspect photos/cup
      lightprobe inspect cup.mov
      lightprobe inspect photos/cup -o /tmp/sheet.png
    """
    if output is not None and output.suffix.lower() != ".png":
        raise ConfigError(f"Cannot write the overlay sheet as '{output.name}': name it .png.")
    if is_plain(scene):
        if (scene / "config.json").is_file():
            raise InputError(
                f"{scene} is a run and no folder of photos; inspect the scene that it learnt from."
            )
        if output is not None:
            raise ConfigError(f"{scene} has no cameras to draw an overlay sheet of; leave out --output.")
        plain = inspect_plain(scene)
        say("\n".join(plain.lines()), **_values(plain), advice=plain.advice)
        _stop_at(scene, plain.problems)
        return
    found = examine(scene)
    values = {"format": found.format, "splits": {photo.name: photo.split for photo in found.photos}}
    say("\n".join(found.lines()), **_values(found), **values)
    if found.photos:
        sheet = output or Path(f"{found.root.name}-overlay.png")
        refuse_replacing([sheet], found.read_files)
        write_overlay_sheet(found, sheet)
        say(printable(f"sheet    {sheet}"), sheet=sheet)
    _stop_at(scene, found.problems)


def _values(found: Inspection | PlainInspection) -> dict[str, Any]:
    """Return what both kinds of inspection know, as values."""
    photos = [
        {
            "name": photo.name if isinstance(photo, PhotoReport) else photo.path.name,
            "size": (photo.width, photo.height),
        }
        for photo in (*found.photos,)
    ]
    return {"folder": found.root, "photos": photos, "problems": found.problems, "hints": found.hints}


def _stop_at(scene: Path, problems: Sequence[str]) -> None:
    """Raise `InputError` when there are problems, so that the command fails."""
    if problems:
        raise InputError(f"{scene} cannot be used as it is: {len(problems)} problem(s), listed above.")
