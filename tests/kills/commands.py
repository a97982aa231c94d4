"""The commands that are disturbed, small enough that fifty moments take minutes, and what each must leave."""

import json
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tests.conftest  # noqa: F401  (puts the tools on the path)
from lightprobe.core.partial import PARTIAL
from tests.toy_scene import TINY_DISTILL, TINY_WITHOUT_TRIALS, changed
from tests.view.finished_run import add_model, finished_run
from turntable_photos import render, write

_UNCOMPARED = frozenset({"log.txt", "timings.json", ".lock", "index.html"})  # hold times of day or seconds
_TIMED = frozenset({"seconds", "evaluated", "facts"})  # keys of JSON files that do


@dataclass(frozen=True)
class Command:
    """One command on inputs of its own."""

    name: str
    words: Callable[[Path], list[str]]  # of the folder that it works in
    output: str  # in that folder
    inputs: tuple[
        str, ...
    ]  # of the bench, copied into that folder; those that are the output too are changed


# As few steps as have two checkpoints in every stage: the question is what a kill may meet, not what is learned.
_FIRST = dict.fromkeys(("pass1_iterations", "pass2_iterations", "pass3_iterations", "steps"), 5)
_SIZES = {"lattice_cells": 8, "hull_voxels": 16, "pass1_side": 24, "pass2_side": 24, "pass3_texture_size": 64}
_REST = {
    "hash_levels": 2,
    "hash_finest": 16,
    "sphere_steps": 3,
    "synthetic_lessons": 2,
    "checkpoint_every": 2,
}
_STEPS = changed([*TINY_WITHOUT_TRIALS, *TINY_DISTILL], simulated_photos=2, **_FIRST, **_SIZES, **_REST)


def _train(folder: Path) -> list[str]:
    quick = ["--decompose.unwrap-seconds", "0", "--decompose.no-shadows"]
    return ["train", str(folder / "scene"), "-o", str(folder / "run"), *_STEPS, *quick]


def _predict(folder: Path) -> list[str]:
    photo, camera = folder / "scene" / "test" / "test_00.png", folder / "scene" / "transforms_test.json"
    maps = ["-o", str(folder / "out" / "light.exr"), "--confidence", str(folder / "out" / "seen.exr")]
    return ["predict", str(folder / "run"), str(photo), "--camera", str(camera), *maps]


def _evaluate(folder: Path) -> list[str]:
    return ["eval", str(folder / "run"), "--no-unseen", "--methods", "probe-net", "constant"]


COMMANDS = (
    Command("prepare", lambda f: ["prepare", str(f / "photos"), "-o", str(f / "made")], "made", ("photos",)),
    Command("train", _train, "run", ("scene",)),
    Command("eval", _evaluate, "run", ("scene", "run")),
    Command("export", lambda f: ["export", str(f / "run"), "-o", str(f / "out")], "out", ("scene", "run")),
    Command("predict", _predict, "out", ("scene", "run")),
)


def write_inputs(bench: Path, commands: Sequence[Command] = COMMANDS) -> None:
    """Write photos for prepare, a scene for train, and a run with untrained networks for the other commands."""
    add_model(finished_run(bench))
    if any("photos" in command.inputs for command in commands):
        write(render(10, 360, focal=2.0, arc=90), bench / "turntable")
        shutil.move(bench / "turntable" / "images", bench / "photos")


def lay_out(command: Command, bench: Path, folder: Path) -> None:
    """Put a command's inputs into its folder, emptied before."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name in command.inputs:
        shutil.copytree(bench / name, folder / name)


def contents(folder: Path) -> dict[str, Any]:
    """Return what a command has left, by file: bytes, or the values of a JSON file but for what was timed."""
    return dict(_contents(folder))


def leftovers(folder: Path) -> list[str]:
    """Return the names of files that were begun and never finished."""
    return sorted(path.name for path in folder.rglob(f"{PARTIAL}*")) if folder.is_dir() else []


def _contents(folder: Path) -> Iterator[tuple[str, Any]]:
    for path in sorted(folder.rglob("*")) if folder.is_dir() else []:
        if path.is_file() and path.name not in _UNCOMPARED and PARTIAL not in str(path):
            name = path.relative_to(folder).as_posix()
            is_json = path.suffix == ".json"
            yield name, _untimed(json.loads(path.read_text())) if is_json else path.read_bytes()


def _untimed(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _untimed(inner) for key, inner in value.items() if key not in _TIMED}
    return [_untimed(inner) for inner in value] if isinstance(value, list) else value
