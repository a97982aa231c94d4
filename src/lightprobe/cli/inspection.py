"""inspect: what is in a folder of photos, before an hour is spent on it."""

from pathlib import Path
from typing import Annotated

from lightprobe.cli.options import SceneArg, option
from lightprobe.core.errors import ConfigError, InputError, printable
from lightprobe.scene.inspect import inspect as examine
from lightprobe.scene.overlay import write_overlay_sheet
from lightprobe.scene.plain_inspection import inspect_plain, is_plain

_SheetArg = Annotated[
    Path | None,
    option(aliases=["-o"], metavar="SHEET.png", help="Overlay sheet to write; by default SCENE-overlay.png here."),
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
        if output is not None:
            raise ConfigError(f"{scene} has no cameras to draw an overlay sheet of; leave out the option --output.")
        plain = inspect_plain(scene)
        print("\n".join(plain.lines()))
        _stop_at(scene, plain.problems)
        return
    found = examine(scene)
    print("\n".join(found.lines()))
    if found.photos:
        sheet = output or Path(f"{found.root.name}-overlay.png")
        write_overlay_sheet(found, sheet)
        print(printable(f"sheet    {sheet}"))
    _stop_at(scene, found.problems)


def _stop_at(scene: Path, problems: tuple[str, ...]) -> None:
    """Raise `InputError` when there are problems, so that the command fails."""
    if problems:
        raise InputError(f"{scene} cannot be used as it is: {len(problems)} problem(s), listed above.")
