"""insert: a virtual object put into a photo."""

import sys
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from lightprobe.cli.answer import keep, say
from lightprobe.cli.options import Device, FoundCameraArg, MaskArg, RunArg, numbers, option
from lightprobe.jobs.insertion import insert_object

_PhotoArg = Annotated[Positional[Path], option(metavar="PHOTO", help="Photo of the run's object.")]
_ThingArg = Annotated[
    Path, option(metavar="OBJECT.glb", help="The virtual object: binary glTF 2.0 with its textures inside.")
]
_OutputArg = Annotated[
    Path,
    option(
        aliases=["-o"],
        metavar="OUT.png",
        help="The picture; OUT.beauty.exr, .shadow.exr, .mask.exr go with it.",
    ),
]
_AtArg = Annotated[
    str | None,
    option(
        metavar="X,Y",
        help="Pixel at which the virtual object stands, from the upper left; else beside the run's.",
    ),
]
_ScaleArg = Annotated[
    float | None,
    option(
        metavar="S",
        help="Its height relative to the known object's; else as in its file, where that is plausible.",
    ),
]
_TurnArg = Annotated[
    float, option(metavar="DEG", help="Turn it about the vertical, anticlockwise seen from above.")
]
_EnvArg = Annotated[
    Path | None,
    option(
        metavar="ENV", help="Light as predict writes it, .exr or .hdr; else it is predicted from the photo."
    ),
]


def insert(
    run: RunArg,
    photo: _PhotoArg,
    *,
    object: _ThingArg,
    output: _OutputArg,
    at: _AtArg = None,
    scale: _ScaleArg = None,
    turn: _TurnArg = 0.0,
    env: _EnvArg = None,
    camera: FoundCameraArg = None,
    mask: MaskArg = None,
    device: Device = "auto",
) -> None:
    """Put an object of your own beside the run's in a photo: lit as the photo is, with shadows and the photo's grain.

    It stands on the ground that the run's object stands on. The picture is a PNG of the photo's size; its layers are
    linear OpenEXR files: picture = photo x shadow x (1 - mask) + beauty. Of a cut-out photo the picture is one, too.

    Examples:
      lightprobe insert runs/cup new.jpg --object chair.glb -o with_chair.png
      lightprobe insert runs/cup new.jpg --object chair.glb -o with_chair.png --at 812,640 --scale 0.8 --turn 30
      lightprobe insert runs/cup new.jpg --object chair.glb -o with_chair.png --env light.exr --camera new.json
    """
    place = None if at is None else numbers(at, "--at", "a pixel as X,Y, such as 812,640", (2,))
    found = insert_object(
        run,
        photo,
        object,
        output,
        at=None if place is None else (place[0], place[1]),
        scale=scale,
        turn=turn,
        env=env,
        camera=camera,
        mask=mask,
        device=device,
    )
    x, y = found.at
    located = None if found.location is None else found.location.located
    keep(**{**vars(found), "location": None if located is None else located.to_json()})
    say(
        f"Picture: {found.picture} (foot at {x:.0f},{y:.0f}; height x {found.scale:.2f}; {found.seconds:.1f} s)"
    )
    say(f"Layers: {found.beauty}, {found.shadow}, {found.mask}")
    for sentence in found.warnings:
        print(f"lightprobe: warning: {photo}: {sentence}", file=sys.stderr)
