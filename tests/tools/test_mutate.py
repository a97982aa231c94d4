"""Mutants of sources, and tests that notice them or do not."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from mutation.changes import changes
from mutation.page import page
from mutation.plan import Plan, drawn
from mutation.trial import Outcome

TOOLS = Path(__file__).parents[2] / "tools"
MODULE = '''"""Areas."""


def area(a: float, b: float = 2.0) -> float:
    """Return the area of a rectangle, 0 for one that is turned inside out."""
    if a < 0:
        return 0.0
    return a * b
'''
TEST = """from toy.area import area


def test_area():
    assert area(3.0, 5.0) == 15.0
    assert area(-1.0, 5.0) == 0.0
"""
JUDGE = """
import sys
from pathlib import Path
from mutation.plan import Plan, drawn
from mutation.trial import judged

plan = Plan(Path(sys.argv[1]))
for mutant in drawn(plan, ["toy"], 99, 0)[0]:
    print(mutant.change.line, mutant.change.after, judged(plan, mutant).name, sep="|")
"""


def test_every_kind_of_code_is_changed_and_text_is_not():
    made = {(change.before, change.after) for change in changes(MODULE)}
    assert made == {
        ("2.0", "3.0"),
        ("a < 0", "a <= 0"),
        ("0", "1"),
        ("0.0", "1.0"),
        ("a * b", "a / b"),
    }


@pytest.mark.parametrize(
    ("source", "after"),
    [
        ("not x", "x"),
        ("-x", "x"),
        ("x and y", "x or y"),
        ("x if y else z", "z if y else x"),
        ("x is None", "x is not None"),
        ("x.clamp(min=y)", "x"),
        ("True", "False"),
        ("x // y", "x * y"),
        ("x in y", "x not in y"),
    ],
)
def test_an_expression_is_changed(source, after):
    assert [change.after for change in changes(source)] == [after]


def test_what_is_no_step_of_a_value_stays():
    assert changes("torch.exp(x)") == []
    assert changes("def f(x: int = y) -> 'list[1]': ...") == []


@pytest.fixture
def project(tmp_path) -> Path:
    for path, text in (
        ("src/toy/area.py", MODULE),
        ("src/toy/__init__.py", ""),
        ("tests/test_area.py", TEST),
    ):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text(text)
    return tmp_path


def judgements(project: Path) -> dict[str, str]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(project / "src"), str(TOOLS)])}
    done = subprocess.run(
        [sys.executable, "-c", JUDGE, project],
        env=environment,
        cwd=project,
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert done.returncode == 0, done.stderr
    rows = [line.split("|") for line in done.stdout.splitlines()]
    return {after: outcome for _, after, outcome in rows}


@pytest.mark.long
def test_tests_kill_what_they_check_and_survivors_show_what_they_do_not(project):
    outcomes = judgements(project)
    assert outcomes["a / b"] == outcomes["1.0"] == "KILLED"
    assert outcomes["3.0"] == outcomes["a <= 0"] == "SURVIVED"  # the default, and the edge itself
    (project / "tests/test_area.py").write_text(TEST.replace("15.0", "16.0"))
    assert set(judgements(project).values()) == {"BROKEN"}


def test_mutants_are_drawn_by_the_seed_and_tests_found_by_their_imports(project):
    plan = Plan(project)
    (first, total), (again, _), (other, _) = (drawn(plan, ["toy"], 3, seed) for seed in (0, 0, 1))
    assert total == 5
    assert first == again
    assert first != other
    assert plan.tests("toy.area") == ([project / "tests/test_area.py"], [])
    (project / "tests/test_other.py").write_text(TEST)
    assert plan.tests("toy.area")[1] == [project / "tests/test_other.py"]


def test_the_page_lists_survivors_and_shares(project):
    mutants, total = drawn(Plan(project), ["toy"], 4, 0)
    outcomes = list(
        zip(mutants, [Outcome.KILLED, Outcome.HUNG, Outcome.SURVIVED, Outcome.KILLED], strict=True)
    )
    text = page(outcomes, total, ["toy"], 0)
    assert "| toy | 4 | 3 | 75 % |" in text
    assert f"- {mutants[2].place}: {mutants[2].change}" in text
    assert text.count("area.py:") == 1
