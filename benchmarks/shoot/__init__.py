"""Make a simulated photo shoot: an object carried from place to place, photographed by a telephone; with its truth.

    python -m benchmarks shoot NAME OUT_DIR [--places 6 --photos 11 --width 960 --samples 64 --seed 0] [--tiny]

NAME    one of the nine objects of `python -m benchmarks make`, such as radio, urn or trolley; or
        terrace  the radio in the open, under the sun
        market   the urn among strangers who move from photo to photo
        random   another object for every seed

The folder is a scene with true cameras and masks; train/ by itself is what a user would bring. Given again, the command
goes on with the photos that are missing; equal options make equal shoots. Needs the extra `path` and an LLVM
library newer than 15. `benchmarks/shoot/folder.py` says what the files hold.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from benchmarks import command_line
from lightprobe.core.errors import ConfigError
from lightprobe.render.path_tracer import check_path_tracer

KINDS = ("room", "yard", "hall", "room", "sun")  # of places, in turns
DESIGNS = ("urn", "statuette", "radio", "engine", "tankard", "helmet", "can", "duck", "trolley")
SHOOTS = {
    **{name: (name, KINDS, False) for name in (*DESIGNS, "random")},
    "terrace": ("radio", ("sun",), False),
    "market": ("urn", ("yard", "hall", "room"), True),
}
_LEAST = {
    "places": 1,
    "photos": 1,
    "test_places": 0,
    "test_photos": 1,
    "width": 64,
    "samples": 4,
    "atlas": 128,
}
_TINY = {
    "places": 2,
    "photos": 6,
    "test_places": 1,
    "test_photos": 2,
    "width": 200,
    "samples": 8,
    "atlas": 512,
}


def main(words: Sequence[str]) -> None:
    """Read the command line and make the shoot."""
    parser = command_line(__doc__)
    parser.add_argument("name", choices=SHOOTS, metavar="NAME")
    parser.add_argument("folder", type=Path, metavar="OUT_DIR")
    for name in ("seed", *_LEAST):
        parser.add_argument(f"--{name.replace('_', '-')}", type=int, default=argparse.SUPPRESS)
    parser.add_argument(
        "--tiny", action="store_true", help="12 + 2 photos, 200 pixels wide, unless said otherwise"
    )
    given = vars(parser.parse_args(words))
    name, folder, tiny = given.pop("name"), given.pop("folder"), given.pop("tiny")
    for option, least in _LEAST.items():
        if given.get(option, least) < least:
            raise ConfigError(
                f"--{option.replace('_', '-')} {given[option]} is too few; give {least} or more."
            )
    if given.get("seed", 0) < 0:
        raise ConfigError(f"--seed {given['seed']} is negative; give 0 or more.")
    check_path_tracer()
    from .folder import Settings, Shoot  # starts Mitsuba, so only when it is needed
    from .tracing import use_one_thread

    use_one_thread()
    what, kinds, crowd = SHOOTS[name]
    settings = replace(Settings(what, kinds, crowd), **((_TINY if tiny else {}) | given))
    Shoot(folder, settings, lambda line: print(line, flush=True)).write()
