"""Which mutants there are, and which tests are to kill them."""

import ast
import functools
import random
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mutation.changes import Change, changes


@dataclass(frozen=True)
class Mutant:
    """A module with one change."""

    module: str
    path: Path  # from the project's root
    change: Change

    @property
    def place(self) -> str:
        """File and line."""
        return f"{self.path}:{self.change.line}"


@dataclass(frozen=True)
class Plan:
    """The project in the folder `root`, its sources and tests."""

    root: Path

    def modules(self, package: str) -> list[tuple[str, Path]]:
        """Return the modules of a package by name, with their files from the root, in order."""
        folder = self.root / "src" / Path(*package.split("."))
        files = sorted(path for path in folder.rglob("*.py") if path.name != "__init__.py")
        return [(".".join(path.relative_to(self.root / "src").with_suffix("").parts), path) for path in files]

    def tests(self, module: str) -> tuple[list[Path], list[Path]]:
        """Return the module's own files of tests, at most one, and those of others that import it."""
        parts = module.split(".")[1:]
        own = self.root / "tests" / Path(*parts[:-1]) / f"test_{parts[-1]}.py"
        others = [path for path, names in self._imports() if module in names and path != own]
        return [own] if own.is_file() else [], others

    def _imports(self) -> list[tuple[Path, frozenset[str]]]:
        return [(path, _imported(path)) for path in sorted((self.root / "tests").rglob("test_*.py"))]


@functools.cache
def _imported(path: Path) -> frozenset[str]:
    """Return the modules that a file imports, whole or in part."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    return frozenset(names)


def drawn(plan: Plan, packages: Sequence[str], count: int, seed: int) -> tuple[list[Mutant], int]:
    """Return `count` of the packages' mutants, drawn at random and sorted by place, and how many there are."""
    every = [
        Mutant(module, path.relative_to(plan.root), change)
        for package in packages
        for module, path in plan.modules(package)
        for change in changes(path.read_text())
    ]
    chosen = random.Random(seed).sample(range(len(every)), min(count, len(every)))
    return [every[k] for k in sorted(chosen)], len(every)
