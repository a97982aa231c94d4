"""One mutant, imported in place of its module in a forked process, and the tests that it has to survive."""

import functools
import importlib.abc
import importlib.machinery
import importlib.util
import os
import signal
import sys
import time
from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from types import ModuleType

from mutation.plan import Mutant, Plan

_PATIENCE = 4.0  # times what the tests take without a mutation, after which a mutant counts as hanging
_GRACE = 20.0  # seconds more
_PASSED, _NOTHING = 0, 5  # exit codes of pytest: all passed, and no tests chosen


class Outcome(Enum):
    """What became of a mutant."""

    KILLED = "killed"
    HUNG = "hung"
    SURVIVED = "SURVIVED"
    BROKEN = "broken"  # the tests fail without it


def judged(plan: Plan, mutant: Mutant) -> Outcome:
    """Return what tests say of a mutant: its module's own ones, then quick ones of others that import the
    module.
    """
    own, others = plan.tests(mutant.module)
    for files, marks in ((own, "not cuda"), (others, "not cuda and not slow and not long")):
        if not files:
            continue
        usual = _seconds_without(tuple(files), marks)
        if usual is None:
            return Outcome.BROKEN
        code = _run(files, marks, mutant, _PATIENCE * usual + _GRACE)
        if code is None:
            return Outcome.HUNG
        if code not in (_PASSED, _NOTHING):
            return Outcome.KILLED
    return Outcome.SURVIVED


@functools.cache
def _seconds_without(files: tuple[Path, ...], marks: str) -> float | None:
    """Return how long tests take without a mutation, None when one fails."""
    start = time.monotonic()
    code = _run(files, marks, None, float("inf"))
    return time.monotonic() - start if code in (_PASSED, _NOTHING) else None


def _run(files: Sequence[Path], marks: str, mutant: Mutant | None, limit: float) -> int | None:
    """Return pytest's exit code in a process of its own, None when it took longer than `limit` seconds."""
    _import_libraries()
    child = os.fork()
    if child == 0:
        code = 1
        try:
            os.setsid()  # whatever the tests start ends with them
            code = _tested(files, marks, mutant)
        finally:
            os._exit(code)
    end = time.monotonic() + limit
    while time.monotonic() < end:
        finished, status = os.waitpid(child, os.WNOHANG)
        if finished:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.05)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return None


def _tested(files: Sequence[Path], marks: str, mutant: Mutant | None) -> int:
    import pytest

    quiet = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(quiet, stream)
    if mutant is not None:
        sys.meta_path.insert(0, _InPlace(mutant.module, mutant.change.source))
    options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:randomly", "-m", marks]
    return int(pytest.main([*options, *map(str, files)]))


@functools.cache
def _import_libraries() -> None:
    """Import, without threads, what takes long and is never mutated, once for all forks."""
    os.environ |= {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    for name in ("numpy", "torch", "scipy.sparse", "scipy.spatial", "numba", "pytest", "hypothesis"):
        importlib.import_module(name)


class _InPlace(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Gives a module another source than its file's."""

    def __init__(self, name: str, source: str):
        self._name, self._source = name, source

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Return the spec of the one module."""
        if fullname != self._name:
            return None
        found = importlib.machinery.PathFinder.find_spec(fullname, path)
        spec = importlib.util.spec_from_loader(fullname, self, origin=None if found is None else found.origin)
        if spec is not None and found is not None:
            spec.has_location = True  # so that it has a __file__, beside which it may look for others
        return spec

    def exec_module(self, module: ModuleType) -> None:
        """Run the mutant."""
        exec(compile(self._source, f"<mutant of {self._name}>", "exec"), module.__dict__)
