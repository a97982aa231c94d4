"""Train Phase I on a population of random objects and score what came out, for choices that have to hold for any object.

    python -m benchmarks population SCENES RESULTS [--objects 0 1 2] [--jobs 2] [--set NAME=VALUE ...]

Object k is drawn from seed k: bodies, knobs, bars and wheels of one to six materials. Even ones are photographed in a
studio (48 photos of 160 pixels, each under a light of its own), odd ones on five tables (9 photos of each, 256 pixels
wide, by a telephone; true cameras and masks). Eight photos and eight relit views of every object, with its true
materials, are for scoring. Objects 0 to 23 are for choices; 24 to 35 are scored once, when all choices are made.

Scenes and scores that are there already are not made anew: a second call goes on where the first one stopped, and the
same SCENES serve any number of RESULTS. `--set` changes fields of `DecomposeConfig`, whose sizes are scaled down from
`--preset quick`. Lights are read by least squares: with the object, with the true one, and a grey map; errors of
spheres are those of `evaluation.three_spheres`. Needs the extra `path` and an LLVM library newer than 15.
"""

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks import command_line
from benchmarks.object import changed, read_lights
from benchmarks.object import measure as measure_object
from benchmarks.shoot import KINDS
from benchmarks.workers import begin, check_jobs, side_by_side
from lightprobe.core.config import DecomposeConfig, Method, reconstruction
from lightprobe.core.errors import ConfigError
from lightprobe.core.files import read_json, write_json
from lightprobe.evaluation.oracle import true_asset
from lightprobe.evaluation.three_spheres import SPHERES
from lightprobe.models import Decomposition
from lightprobe.render.path_tracer import check_path_tracer
from lightprobe.scene import load_scene

OBJECTS = 24  # for choices
UNTOUCHED = 12  # more
# form, and how bad a value is
COLUMNS: dict[str, tuple[str, Callable[[float], float]]] = {
    "roughness_mae": (".3f", float),
    "metallic_mae": (".3f", float),
    "base_color_psnr_scaled": (".1f", lambda value: -value),
    "base_color_ratio": (".2f", lambda value: abs(math.log(value))),
    "normal_degrees": (".1f", float),
    "relight_psnr": (".1f", lambda value: -value),
    "relight_psnr_scaled": (".1f", lambda value: -value),
    "over_true": (".2f", float),
    "over_grey": (".2f", float),
    "disagreement": (".4f", float),
    "seconds": (".0f", float),
}


@dataclass(frozen=True)
class Sizes:
    """How large the scenes are."""

    photos: int = 48  # on tables a few less, as many for each place
    test: int = 8
    side: int = 160  # of a studio's photos
    samples: int = (
        96  # of their pixels; a quarter of it on tables, where all around the object is traced, too
    )
    places: int = 5
    width: int = 256  # of photos on tables


def scaled() -> DecomposeConfig:
    """Return `quick`'s settings with fewer and smaller steps: minutes for an object on one core."""
    return replace(
        reconstruction.quick(),
        pass1_iterations=420,
        pass2_iterations=150,
        pass3_iterations=0,
        lattice_cells=48,
        hull_voxels=80,
        max_faces=8000,
        texture_size=256,
        light_solve_pixels=2048,
        trial_steps=64,
        checkpoint_every=70,
    )


def name_of(number: int) -> str:
    """Return the name of an object: how it is photographed, and its number."""
    return f"{'table' if number % 2 else 'studio'}-{number:02d}"


def make_scene(folder: Path, number: int, sizes: Sizes) -> None:
    """Make the scene of an object and score its lights as its true object tells them, unless that is there."""
    if (folder / "truth.json").exists():
        return
    import demo_scene.dataset as studio  # starts Mitsuba, so only when it is needed
    from benchmarks.shoot.folder import Settings
    from benchmarks.shoot.models import textured
    from benchmarks.shoot.objects import make_object
    from benchmarks.shoot.scenes import write_studio, write_tables
    from benchmarks.shoot.tracing import use_one_thread

    use_one_thread()
    settings = studio.Settings(number, sizes.side, sizes.samples, sizes.photos, sizes.test)
    model = textured(make_object("random", number), 1024)
    if number % 2 == 0:
        write_studio(folder, "random", model, settings)
    else:
        tables: dict[str, Any] = {
            "places": sizes.places,
            "photos": sizes.photos // sizes.places,
            "test_places": 0,
        }
        camera: dict[str, Any] = {"width": sizes.width, "samples": sizes.samples // 4, "atlas": 1024}
        shoot = Settings("random", KINDS, seed=number, **tables, **camera)
        write_tables(folder, shoot, model, settings, lambda line: None)
    scene = load_scene(folder)
    true, device = Decomposition(true_asset(scene), {}, scene.similarity), torch.device("cpu")
    grey = read_lights(true, scene, device, Method.CONSTANT)
    write_json(folder / "truth.json", {"true": read_lights(true, scene, device), "grey": grey})


def measure(scenes: Path, results: Path, number: int, changes: Sequence[str]) -> str:
    """Make an object's scene, train on it and write its scores, unless they are there; return its name."""
    folder, file = scenes / name_of(number), results / f"{name_of(number)}.json"
    make_scene(folder, number, Sizes())
    if not file.exists():
        scores = measure_object(folder, changed(scaled(), changes), torch.device("cpu"), seed=0)
        write_json(file, scores | read_json(folder / "truth.json"))
    return folder.name


def read_results(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the scores of every object that has any, by name."""
    return {path.stem: read_json(path) for path in sorted(folder.glob("*-[0-9][0-9].json"))}


def summary(scores: dict[str, Any]) -> dict[str, float]:
    """Return an object's row of the table."""
    true, grey = (np.array([scores[whose][name] for name in SPHERES]) for whose in ("true", "grey"))
    own = np.array([scores[name] for name in SPHERES])
    ratios = {"over_true": float(np.mean(own / true)), "over_grey": float(np.mean(own[:2] / grey[:2]))}
    return {name: scores[name] for name in COLUMNS if name in scores} | ratios


def table(rows: dict[str, dict[str, float]]) -> str:
    """Return the scores of the objects as Markdown, with their medians and the means of the worst three."""
    lines = ["| object | " + " | ".join(COLUMNS) + " |", "| --- |" + " ---: |" * len(COLUMNS)]
    for name, row in rows.items():
        lines.append(f"| {name} | " + " | ".join(format(row[c], f) for c, (f, _) in COLUMNS.items()) + " |")
    for label, of in (
        ("median", np.median),
        ("mean of the worst three", lambda values: np.mean(values[-3:])),
    ):
        cells = []
        for column, (form, worse) in COLUMNS.items():
            values = sorted((row[column] for row in rows.values()), key=worse)
            cells.append(format(float(of(values)), form))
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(words: Sequence[str]) -> None:
    """Measure the objects that the command line names and print the table of all results."""
    parser = command_line(__doc__)
    parser.add_argument("scenes", type=Path, metavar="SCENES")
    parser.add_argument("results", type=Path, metavar="RESULTS")
    parser.add_argument("--objects", type=int, nargs="*", default=list(range(OBJECTS)), metavar="NUMBER")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE")
    given = parser.parse_args(words)
    if wrong := [k for k in given.objects if not 0 <= k < OBJECTS + UNTOUCHED]:
        raise ConfigError(f"There is no object {wrong[0]}; there are 0 to {OBJECTS + UNTOUCHED - 1}.")
    check_jobs(given.jobs)
    changed(scaled(), given.set)
    check_path_tracer()
    begin(given.results, {"settings": list(given.set)}, "scores of other settings")
    given.scenes.mkdir(parents=True, exist_ok=True)
    calls = [(given.scenes, given.results, number, given.set) for number in given.objects]
    for done, name in enumerate(side_by_side(measure, calls, given.jobs), start=1):
        print(f"{done} of {len(calls)}: {name}", flush=True)
    print(table({name: summary(scores) for name, scores in read_results(given.results).items()}))
