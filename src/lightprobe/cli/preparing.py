"""prepare: plain photos in, a scene folder out."""

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from lightprobe.cli.answer import say
from lightprobe.cli.options import Seed, option
from lightprobe.cli.progress import Meter
from lightprobe.core.errors import printable
from lightprobe.core.files import shell_word
from lightprobe.preparation import PrepareOptions
from lightprobe.runs.preparing import prepare_scene

_Photos = Annotated[
    Positional[Path], option(metavar="PHOTOS", help="Folder with photos and no cameras, or a video.")
]
_Output = Annotated[
    Path, option(aliases=["-o"], metavar="SCENE", help="Scene folder to make or to go on with.")
]
_Hint = Annotated[
    str | None,
    option(
        metavar="PHOTO=MASK.png",
        help="The object in one photo: a mask file, or a box x0,y0,x1,y1 in its pixels.",
    ),
]
_Up = Annotated[
    str | None, option(metavar="x,y,z", help="Up, in the axes of --up-photo: x right, y up, z to you.")
]
_UpPhoto = Annotated[str | None, option(metavar="PHOTO", help="A photo held level: its vertical axis is up.")]
_Height = Annotated[
    float | None, option(metavar="LENGTH", help="Height of the object, in the unit you want.")
]


def prepare(
    photos: _Photos,
    *,
    output: _Output,
    hint: _Hint = None,
    up: _Up = None,
    up_photo: _UpPhoto = None,
    height: _Height = None,
    seed: Seed = 0,
) -> None:
    """Find cameras, masks and an upright frame for a plain folder of photos or a video, and write a scene to
    train on.

    Look at contact.png in the scene. A wrong mask can be painted over in masks/; the same command then goes
    on with it.

    Examples:
      lightprobe prepare photos/cup -o scenes/cup
      lightprobe prepare cup.mov -o scenes/cup
      lightprobe prepare photos/cup -o scenes/cup --hint IMG_12.jpg=820,400,2100,1900
      lightprobe prepare photos/cup -o scenes/cup --hint IMG_12.jpg=cup.png --up-photo IMG_3.jpg --height 0.12
    """
    with Meter() as meter:
        options = PrepareOptions(hint, up, up_photo, height, seed)
        prepared = prepare_scene(photos, output, options, on_progress=meter.update)
    report = prepared.report
    lines = [
        f"photos   {report['registered']} of {report['total']} have cameras: {report['kept']['reconstruction']}",
        f"masks    {report['registered'] - len(report['doubtful_masks'])} of {report['registered']} are sure",
        f"up       {report['up']}",
        f"look at  {output / 'contact.png'}",
        f"Next: lightprobe train {shell_word(output)} -o RUN",
    ]
    say("\n".join(printable(line) for line in lines), scene=output, **report)
