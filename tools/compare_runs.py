"""Say whether two runs hold the same results to the last bit: object, lights, networks, predictions, scores.

    python tools/compare_runs.py RUN OTHER

Compares every tensor of mesh/ and model/, every map of env/ and predictions/, every picture and GLB by its
bytes, and the scores of metrics.json but for what was timed. Checkpoints, logs, timings and reports are left
out: they may take another form while results stay. Prints one line for everything that differs, and ends with
1 when anything does, with 2 when there is nothing to compare.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.core.checkpoint import load_tensors
from lightprobe.core.errors import LightprobeError
from lightprobe.imaging import read_hdr

FOLDERS = ("mesh", "env", "model", "predictions", "oracle")
_TIMED = frozenset({"seconds"})
_LEFT_OUT = frozenset({"checkpoints", "report", "timings.json"})
_LEAVES = {".safetensors", ".exr", ".hdr", ".json"}


def results(run: Path) -> dict[str, Path]:
    """Return the files of a run that hold results, by their names within it."""
    found = {"metrics.json": run / "metrics.json"} if (run / "metrics.json").is_file() else {}
    for folder in FOLDERS:
        for path in sorted((run / folder).rglob("*")):
            name = path.relative_to(run)
            if path.is_file() and not _LEFT_OUT.intersection(name.parts):
                found[name.as_posix()] = path
    return found


def differences(run: Path, other: Path) -> Iterator[str]:
    """Yield a line for each result that only one of the runs has, or that differs between them."""
    ours, theirs = results(run), results(other)
    for name in sorted(ours.keys() ^ theirs.keys()):
        yield f"{name}: only in {run if name in ours else other}"
    for name in sorted(ours.keys() & theirs.keys()):
        for line in _different(ours[name], theirs[name]):
            yield f"{name}: {line}"


def _different(path: Path, other: Path) -> Iterator[str]:
    if path.suffix not in _LEAVES:
        if path.read_bytes() != other.read_bytes():
            yield "other bytes"
        return
    ours, theirs = _leaves(path), _leaves(other)
    for name in sorted(ours.keys() ^ theirs.keys()):
        yield f"{name} only in one"
    for name in sorted(ours.keys() & theirs.keys()):
        if not _same(ours[name], theirs[name]):
            yield f"{name} {_distance(ours[name], theirs[name])}"


def _leaves(path: Path) -> dict[str, Any]:
    """Return what a file holds by name: tensors, a map, or the values of JSON but for what was timed."""
    if path.suffix == ".safetensors":
        return {name: tensor.numpy() for name, tensor in load_tensors(path).items()}
    if path.suffix == ".json":
        return dict(_values("", json.loads(path.read_text())))
    return {"map": read_hdr(path)}


def _values(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            if key not in _TIMED:
                yield from _values(f"{name}.{key}".lstrip("."), inner)
    elif isinstance(value, list):
        for place, inner in enumerate(value):
            yield from _values(f"{name}[{place}]", inner)
    else:
        yield name, value


def _same(ours: Any, theirs: Any) -> bool:
    if isinstance(ours, np.ndarray):
        return (
            ours.dtype == theirs.dtype and ours.shape == theirs.shape and ours.tobytes() == theirs.tobytes()
        )
    return bool(ours == theirs)


def _distance(ours: Any, theirs: Any) -> str:
    if not isinstance(ours, np.ndarray):
        return f"{ours} and {theirs}"
    if ours.shape != theirs.shape or ours.dtype != theirs.dtype:
        return f"{ours.shape} {ours.dtype} and {theirs.shape} {theirs.dtype}"
    return f"differs by up to {np.abs(ours.astype(np.float64) - theirs.astype(np.float64)).max():.3g}"


def main(words: Sequence[str] | None = None) -> int:
    """Read the command line, compare, and return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path, metavar="RUN")
    parser.add_argument("other", type=Path, metavar="OTHER")
    options = parser.parse_args(words)
    for run in (options.run, options.other):
        if not results(run):
            print(f"{run} holds no results of a run.", file=sys.stderr)
            return 2
    try:
        found = list(differences(options.run, options.other))
    except (LightprobeError, ValueError) as error:
        print(f"The runs cannot be compared: {error}", file=sys.stderr)
        return 2
    print("\n".join(found) if found else f"The same: {len(results(options.run))} files.")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
