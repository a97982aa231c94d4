"""Public functions on tensors that name no shape are found, and nothing else is."""

import pytest

import check_shapes

FINE = '''
def turned(values: "np.ndarray", others: list[Tensor]) -> np.ndarray:
    """Return the pixels (6, R, R, 3), turned."""

def named(values: dict[str, Tensor]) -> Callable[[], Tensor]:
    """Return the same."""

def _hidden(values: Tensor) -> Tensor: ...

class Points:
    """Points."""

    position: Tensor  # (N, 3)

    @property
    def first(self) -> Tensor:
        """The first of them."""
        return self.position[0]
'''

BAD = '''
def plain(values: Tensor) -> float:
    """Return the sum of the values (all of them), see (below)."""

def silent(values: Tensor | None, *, other: "Tensor | None" = None) -> float: ...

class Points:
    """Points without shapes."""

    def all(self, *values: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return them."""
'''


def test_functions_that_name_no_shape_are_found_and_no_others(tmp_path, capsys):
    (tmp_path / "fine.py").write_text(FINE)
    (tmp_path / "_hidden.py").write_text(BAD)
    assert check_shapes.main([str(tmp_path)]) == 0
    assert capsys.readouterr().out == ""
    (tmp_path / "bad.py").write_text(BAD)
    assert check_shapes.main([str(tmp_path)]) == 1
    found = [line.split(": ")[1].split()[0] for line in capsys.readouterr().out.splitlines()]
    assert found == ["plain", "silent", "Points.all"]


SHAPES = "(P, 3);(N,);();[..., 3];(*index.shape, C);(H, 2H, 3);(6 (R + 1)^2, 4);of any\n shape;as in `View.project`"
NONE = ";(bool);(N);(see below);of the same shape;`points`;as they are"


@pytest.mark.parametrize(
    ("words", "names"), [*((w, True) for w in SHAPES.split(";")), *((w, False) for w in NONE.split(";"))]
)
def test_what_names_a_shape(words, names):
    assert check_shapes.names_shapes(f"Return the points {words}, all of them.") is names


@pytest.mark.slow
def test_the_package_names_its_shapes(capsys):
    assert check_shapes.main([]) == 0, capsys.readouterr().out
