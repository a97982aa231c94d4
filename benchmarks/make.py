"""Make the benchmark scenes: nine objects of nine kinds, each in a studio and on tables, with all that is true of them.

    python -m benchmarks make DATA [--objects urn duck] [--forms studio] [--jobs 2] [--tiny]

urn        glazed, patterned             engine   toy in gloss paint          can     saturated plastic
statuette  matte cloth and skin          tankard  brushed metal               duck    wood (untouched)
radio      matte, boxy                   helmet   dark gloss (untouched)      trolley thin bars and wheels

DATA/NAME          64 training and 12 test photos of 320 pixels, each under a light of its own, cut out
DATA/NAME-shoot    66 telephone photos on six tables and 12 on four others, uncut, true cameras and masks
Both hold eight views under two more lights (relight/) and, for scoring, true lights, and in the studio materials and
normals. No choice of this program was made on an object that is called untouched; it is scored once per version.

Lights are computed, or three photographed ones (CC0, Poly Haven); rooms have textures on which features can be found.
Nothing is downloaded. A second call goes on where the first stopped. `SHA256SUMS` in every scene lists what was made;
equal machines make equal files, others may differ in last bits. Needs the extra `path` and an LLVM library newer than
15. --tiny: 6 + 2 photos of 64 pixels or so, for a look.
"""

import hashlib
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks import command_line
from benchmarks.shoot import DESIGNS, KINDS
from benchmarks.workers import begin, check_jobs, side_by_side
from lightprobe.core.files import write_bytes
from lightprobe.render.path_tracer import check_path_tracer

UNTOUCHED = frozenset({"helmet", "duck"})
FORMS = ("studio", "shoot")
_SUMS = "SHA256SUMS"


@dataclass(frozen=True)
class Sizes:
    """How large the scenes are."""

    photos: int = 64
    test: int = 12
    side: int = 320  # of a studio's photos
    samples: int = 256  # of their pixels
    atlas: int = 2048
    shoot: dict[str, Any] = field(default_factory=dict)  # changes of `shoot.folder.Settings`


_TINY_SHOOT = {"places": 2, "photos": 3, "test_places": 1, "test_photos": 2, "width": 96, "samples": 8}
TINY = Sizes(6, 2, 64, 16, 512, _TINY_SHOOT)


def checksums(folder: Path) -> str:
    """Return a line `SHA-256  path` for every file of a scene but the list itself, as `sha256sum` writes them."""
    lines = []
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.name != _SUMS:
            lines.append(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.relative_to(folder)}\n")
    return "".join(lines)


def scene_name(name: str, form: str) -> str:
    """Return what the folder of an object in a form is called."""
    return name if form == "studio" else f"{name}-{form}"


def make(data: Path, form: str, name: str, sizes: Sizes) -> str:
    """Make a scene in `data`, unless it is whole, and return its name."""
    folder = data / scene_name(name, form)
    if (folder / _SUMS).exists():
        return folder.name
    import demo_scene.dataset as studio  # starts Mitsuba, so only when it is needed
    from benchmarks.shoot.folder import Settings
    from benchmarks.shoot.models import textured
    from benchmarks.shoot.objects import make_object
    from benchmarks.shoot.scenes import write_studio, write_tables
    from benchmarks.shoot.tracing import use_one_thread

    use_one_thread()
    seed = DESIGNS.index(name)  # no two objects share a light
    settings = studio.Settings(seed, sizes.side, sizes.samples, sizes.photos, sizes.test)
    model = textured(make_object(name, seed), sizes.atlas)
    if form == "studio":
        write_studio(folder, name, model, settings)
    else:
        shoot = Settings(name, KINDS, seed=seed, atlas=sizes.atlas, **sizes.shoot)
        write_tables(folder, shoot, model, settings, lambda line: print(f"{name}: {line}", flush=True))
    write_bytes(folder / _SUMS, checksums(folder).encode())
    return folder.name


def main(words: Sequence[str]) -> None:
    """Make the scenes that the command line names."""
    parser = command_line(__doc__)
    parser.add_argument("data", type=Path, metavar="DATA")
    parser.add_argument("--objects", nargs="+", choices=DESIGNS, default=DESIGNS, metavar="NAME")
    parser.add_argument("--forms", nargs="+", choices=FORMS, default=FORMS)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--tiny", action="store_true")
    given = parser.parse_args(words)
    check_jobs(given.jobs)
    check_path_tracer()
    begin(given.data, {"tiny": given.tiny}, "scenes of other sizes")
    sizes = TINY if given.tiny else Sizes()
    calls = [(given.data, form, name, sizes) for name in given.objects for form in given.forms]
    start = time.monotonic()
    for done, scene in enumerate(side_by_side(make, calls, given.jobs), start=1):
        minutes = (time.monotonic() - start) / 60
        print(f"{done} of {len(calls)} scenes after {minutes:.0f} minutes: {scene}", flush=True)
