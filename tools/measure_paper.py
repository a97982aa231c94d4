"""Measures steps and memory of `--preset paper` on a scene, and writes the projected length of a full run.

    python tools/measure_paper.py SCENE [--photos 8] [--steps 24] [--device cpu] [--page docs/paper-preset.md]

A few steps of each pass and of Phase II are trained at full size on some of the scene's photos. The lines
between the page's marks are replaced; without --page they are printed. `--note` adds a sentence on the
circumstances.
"""

import argparse
import sys
from pathlib import Path

from lightprobe.core.device import resolve_device
from lightprobe.core.errors import LightprobeError
from lightprobe.core.files import write_bytes
from lightprobe.scene import load_scene
from speed.paper import full_size, measure, replaced, rows, small


def main() -> None:
    """Read the command line, measure and write."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scene", type=Path)
    parser.add_argument("--photos", type=int, default=8, help="training photos looked at")
    parser.add_argument("--steps", type=int, default=24, help="of each pass, at least as many as photos")
    parser.add_argument("--device", default="cpu", help="auto, cpu or cuda")
    parser.add_argument("--page", type=Path, help="page whose marked lines are replaced")
    parser.add_argument("--note", default="", help="one sentence on the circumstances")
    parser.add_argument("--brief", action="store_true", help="small sizes, to see that all of it works")
    given = parser.parse_args()
    try:
        made = small() if given.brief else full_size()
        device = resolve_device(given.device)
        costs = measure(load_scene(given.scene), made, given.photos, given.steps, device)
        text = "\n".join(rows(costs, made, given.note)) + "\n"
        if given.page is not None:
            write_bytes(given.page, replaced(given.page.read_text(encoding="utf-8"), text).encode())
    except LightprobeError as error:
        sys.exit(str(error))
    print(text if given.page is None else f"Page: {given.page}")


if __name__ == "__main__":
    main()
