"""Build the wheel, install it into a bare virtual environment of each Python named, and use it there.

    python tools/check_wheel.py [--pythons python3.11 python3.12 python3.13] [--extras photos] [--demo]

The wheel is built from the files that git tracks, so that nothing that only lies about gets into it. In each
environment: `--version`, `--help`, every module imported, a map written and read, the bundled scene
inspected, and with `--demo` the whole of `lightprobe demo`, which takes minutes. Versions are those of
constraints.txt. Where a Python is not there, the index is asked whether every package has a wheel for it
(`pip install --dry-run`). Ends with 1 when anything fails.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
PYTHONS = ("python3.11", "python3.12", "python3.13")
# packages and modules that cannot be imported without an extra
WITH_EXTRAS = (
    "lightprobe.view",
    "lightprobe.service",
    "lightprobe.web",
    "lightprobe.fleet",
    "lightprobe.render.gltf_bsdf",
)
_USE = f"""
import importlib, pkgutil, sys
import lightprobe
failed = []
for module in pkgutil.walk_packages(lightprobe.__path__, "lightprobe."):
    if module.name.startswith({WITH_EXTRAS}) or "triton" in module.name or "blender" in module.name:
        continue
    try:
        importlib.import_module(module.name)
    except Exception as error:
        failed.append(module.name + ": " + repr(error))
assert not failed, failed
assert "site-packages" in lightprobe.__file__, lightprobe.__file__
import numpy
from lightprobe.light.environment import Environment
Environment.from_panorama(numpy.ones((16, 32, 3), numpy.float32)).save("light.exr")
assert abs(float(Environment.load("light.exr").texels.mean()) - 1) < 1e-3
"""


class FailureError(Exception):
    """Something that the wheel must do, and does not."""


def build(folder: Path) -> Path:
    """Return the wheel, built in `folder` from the tracked files."""
    source = folder / "source"
    names = _done(["git", "ls-files", "-z"], ROOT).split("\0")
    for name in filter(None, names):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, source / name)
    _done([sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(folder), str(source)], folder)
    return next(folder.glob("lightprobe-*.whl"))


def check_content(wheel: Path) -> None:
    """Raise `FailureError` unless the wheel has version, licences and assets, and nothing of tests or tools."""
    names = zipfile.ZipFile(wheel).namelist()
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    if not wheel.name.startswith(f"lightprobe-{version}-py3-none-any"):
        raise FailureError(f"{wheel.name} is not called after version {version}")
    tracked = _done(["git", "ls-files", "src/lightprobe"], ROOT).split()
    missing = {name.removeprefix("src/") for name in tracked} - {*names}
    if missing:
        raise FailureError(f"{wheel.name} lacks {', '.join(sorted(missing)[:5])}")
    odd = [name for name in names if not name.startswith(("lightprobe/", "lightprobe-"))]
    if odd:
        raise FailureError(f"{wheel.name} holds {', '.join(odd[:5])}")


def is_there(python: str) -> bool:
    """Return whether a Python runs; a version manager's stand-in for one may lie on the path without it."""
    try:
        return subprocess.run([python, "--version"], capture_output=True).returncode == 0
    except OSError:
        return False


def check_python(python: str, wheel: Path, folder: Path, extras: Sequence[str], *, demo: bool) -> None:
    """Install the wheel for a Python and use it; raise `FailureError` for what does not work."""
    environment, target = folder / Path(python).name, f"{wheel}[{','.join(extras)}]" if extras else str(wheel)
    _done([python, "-m", "venv", str(environment)], folder)
    here, program = str(environment / "bin" / "python"), str(environment / "bin" / "lightprobe")
    _done([here, "-m", "pip", "install", "-q", "-c", str(ROOT / "constraints.txt"), target], folder)
    if _done([program, "--version"], folder).strip() not in wheel.name:
        raise FailureError("--version does not tell the wheel's")
    _done([program, "--help"], folder)
    _done([here, "-c", _USE], folder)
    package = _done([here, "-c", "import lightprobe; print(lightprobe.__path__[0])"], folder).strip()
    _done([program, "inspect", str(Path(package) / "assets" / "demo")], folder)
    if demo:
        _done([program, "demo", "-o", str(folder / "demo")], folder)


def check_index(python: str) -> None:
    """Raise `FailureError` unless every package has a wheel, at its version, for a Python that is not here."""
    version = Path(python).name.removeprefix("python")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    words = [sys.executable, "-m", "pip", "install", "-q", "--dry-run", "--ignore-installed"]
    words += ["--only-binary=:all:", "--python-version", version, "--target", "nowhere"]
    words += ["-c", str(ROOT / "constraints.txt")]
    _done([*words, *project["dependencies"], *project["optional-dependencies"]["photos"]], ROOT)


def _done(words: Sequence[str], folder: Path) -> str:
    """Return what a command prints, run in `folder` and without this repository on Python's path."""
    settings = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(words, cwd=folder, env=settings, capture_output=True, text=True)
    if done.returncode != 0:
        said = done.stderr.strip()[-800:]
        raise FailureError(f"{' '.join(words[:6])[:200]} ends with {done.returncode}: {said}")
    return done.stdout


def main(words: Sequence[str] | None = None) -> int:
    """Read the command line, check, and return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--pythons", nargs="+", default=PYTHONS, metavar="PYTHON")
    parser.add_argument("--extras", nargs="*", default=[], metavar="EXTRA")
    parser.add_argument("--demo", action="store_true", help="run lightprobe demo, too")
    given = parser.parse_args(words)
    failed = False
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wheel = build(folder)
        check_content(wheel)
        print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.1f} MB", flush=True)
        for python in given.pythons:
            there = is_there(python)
            try:
                if there:
                    check_python(python, wheel, folder, given.extras, demo=given.demo)
                else:
                    check_index(python)
                print(
                    f"{python}: {'works' if there else 'is not here, but has wheels of all packages'}",
                    flush=True,
                )
            except FailureError as error:
                failed = True
                print(f"{python}: {error}", flush=True)
            for left in (folder / Path(python).name, folder / "demo"):
                shutil.rmtree(left, ignore_errors=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
