"""view: runs in the browser."""

from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, Positional

from lightprobe.cli.options import Device, option
from lightprobe.view import serve
from lightprobe.view.server import PORT

_Folders = Annotated[
    Positional[tuple[Path, ...]],
    option(
        metavar="RUN...",
        help="Run folders; scenes that prepare made, or folders of photos, to draw masks in.",
    ),
]
_Port = Annotated[int, option(metavar="N", help="Port of the page; 0 takes a free one.")]
_Lan = Annotated[
    FlagCreatePairsOff[bool],
    option(
        help="Let a phone in the same network open it, by a QR code; without encryption, for networks you trust."
    ),
]
_Open = Annotated[bool, option(help="Open the page in this machine's browser.")]


def view(
    runs: _Folders, *, port: _Port = PORT, lan: _Lan = False, open: _Open = True, device: Device = "auto"
) -> None:
    """Show runs on a page in the browser: the object under any light, the light in a photo, a training,
    masks.

    The page works offline and is reachable from this machine alone, unless --lan is given. What is uploaded
    lies in a temporary folder that goes when the command ends (Ctrl-C).

    Examples:
      lightprobe view runs/cup
      lightprobe view runs/cup runs/vase --port 9000 --no-open
      lightprobe view runs/cup --lan
      lightprobe view scenes/cup
    """
    serve(runs, port=port, lan=lan, browser=open, device=device)
