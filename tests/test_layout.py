"""Tests stand beside what they test, and share what they share through modules that are no tests."""

import ast
from pathlib import Path

ROOT = Path(__file__).parent


def imported(path: Path) -> set[str]:
    """Return the last names of all modules that a file imports, or imports from."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name.rsplit(".", 1)[-1] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {(node.module or "").rsplit(".", 1)[-1], *(alias.name for alias in node.names)}
    return found


def test_no_test_imports_from_another():
    """What two of them need would be found by neither's reader, and runs again wherever it is imported."""
    tests = {path.stem for path in ROOT.rglob("test_*.py")}
    borrowed = {str(path.relative_to(ROOT)): imported(path) & tests for path in ROOT.rglob("test_*.py")}
    assert {path: names for path, names in borrowed.items() if names} == {}
