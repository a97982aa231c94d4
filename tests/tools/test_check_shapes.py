"""Public functions on tensors that name no shape are found, and nothing else is."""

import pytest

import check_shapes

FINE = '''
from torch import Tensor
import numpy as np

def rows(values: Tensor) -> Tensor:
    """Return the rows (K, 3) of values (N, 3)."""

def number(values: list[Tensor]) -> float:
    """Return the sum of scalars ()."""

def turned(values: "np.ndarray") -> np.ndarray:
    """Return the pixels (6, R, R, 3), turned."""

def pointer(values: Tensor) -> None:
    """Take what comes as in `Surface`."""

def curve(values: Tensor) -> Tensor:
    """Return the curve at values of any shape."""

def named(values: dict[str, Tensor]) -> dict[str, Tensor]:
    """Return the same."""

def caller(call: Callable[[], Tensor]) -> None:
    """Call it."""

def _hidden(values: Tensor) -> Tensor: ...

class Points:
    """Points."""

    position: Tensor  # (N, 3)

    @property
    def first(self) -> Tensor:
        """The first of them."""
        return self.position[0]

class _Hidden:
    def values(self) -> Tensor: ...
'''

BAD = '''
from torch import Tensor

def plain(values: Tensor) -> float:
    """Return the sum of the values (all of them), see (below)."""

def silent(values: Tensor | None) -> float: ...

def optional(*, values: "Tensor | None" = None) -> float:
    """Return the sum of values."""

class Points:
    """Points without shapes."""

    position: Tensor

    @property
    def first(self) -> Tensor:
        """The first of them."""
        return self.position[0]

    def all(self, *values: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return them."""
'''


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "fine.py").write_text(FINE)
    (tmp_path / "_hidden.py").write_text(BAD)
    return tmp_path


def test_functions_that_name_shapes_pass(folder, capsys):
    assert check_shapes.main([str(folder)]) == 0
    assert capsys.readouterr().out == ""


def test_functions_that_name_none_are_found(folder, capsys):
    (folder / "bad.py").write_text(BAD)
    assert check_shapes.main([str(folder)]) == 1
    lines = capsys.readouterr().out.splitlines()
    found = [line.split(": ")[1].split()[0] for line in lines]
    assert found == ["plain", "silent", "optional", "Points.first", "Points.all"]
    assert lines[0].startswith(f"{folder / 'bad.py'}:4: plain takes or returns")


@pytest.mark.parametrize(
    "docstring",
    [
        "(P, 3)",
        "(N,)",
        "()",
        "[..., 3]",
        "(...)",
        "(*index.shape, C)",
        "(H, 2H, 3)",
        "(6 (R + 1)^2, 4)",
        "(K + 384, 3)",
        "(H, W, 1 | 2 | 3)",
        "(entries,)",
        "of any shape",
        "as `View`",
        "as in `View.project`",
        "like `colors`",
    ],
)
def test_what_names_a_shape(docstring):
    assert check_shapes.names_shapes(f"Return the points {docstring}, all of them.")


@pytest.mark.parametrize(
    "docstring", ["", "(bool)", "(N)", "(see below)", "of the same shape", "`points`", "as they are"]
)
def test_what_names_none(docstring):
    assert not check_shapes.names_shapes(f"Return the points {docstring}, all of them.")


@pytest.mark.slow
def test_the_package_names_its_shapes(capsys):
    assert check_shapes.main([]) == 0, capsys.readouterr().out
