"""The tests that need a GPU, run by pytest."""

import re
import subprocess
import sys
from pathlib import Path

from benchmarks.gpu.parts import Setting
from lightprobe.core.errors import ResourceError

ROOT = Path(__file__).parents[2]
_BRIEF = "tests/training/test_recording.py"
_NONE_COLLECTED = 5  # pytest's exit code


def tests_part(setting: Setting) -> None:
    """Run the tests marked `cuda` and write their closing line and every one that failed."""
    where = [_BRIEF] if setting.brief else marked(ROOT / "tests")
    command = [sys.executable, "-m", "pytest", "-q", "-m", "cuda", "-p", "no:cacheprovider", *where]
    done = subprocess.run(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    print(done.stdout)
    setting.write("tests", summary(done.stdout))
    if done.returncode not in (0, _NONE_COLLECTED):
        raise ResourceError(f"pytest -m cuda ended with {done.returncode}.")


def marked(tests: Path) -> list[str]:
    """Return the test files that mark a test `cuda`, and the folders whose conftest.py does, relative to the
    checkout.

    Collecting no others takes less of the GPU's time and asks for no extra that they do not need.
    """
    holding = [
        file for file in sorted(tests.rglob("*.py")) if "mark.cuda" in file.read_text(encoding="utf-8")
    ]
    found = [file.parent if file.name == "conftest.py" else file for file in holding]
    return [str(place.relative_to(tests.parent)) for place in found]


def summary(printed: str) -> list[str]:
    """Return pytest's closing line and a row for each failed test."""
    lines = [re.sub(r"\x1b\[[0-9;]*m", "", line).strip() for line in printed.splitlines() if line.strip()]
    failed = [f"- {line}" for line in lines if line.startswith(("FAILED ", "ERROR "))]
    return [
        f"`pytest -m cuda`: {lines[-1].strip('= ') if lines else 'nothing printed'}",
        *([""] if failed else []),
        *failed,
    ]
