"""Progress with the time left: in a terminal, in a notebook and in a log."""

import os
import re
import subprocess
import sys
import types

import pytest

import lightprobe
from lightprobe.cli import progress


class FakeNotebook(types.ModuleType):
    """Stands in for IPython in a kernel, and keeps what is shown."""

    def __init__(self, config):
        super().__init__("IPython")
        self.cells = []
        display = types.ModuleType("IPython.display")
        display.HTML = lambda text: text
        display.display = self.show
        self.display = display
        self.get_ipython = lambda: types.SimpleNamespace(config=config)

    def show(self, text, display_id):
        self.cells.append([text])
        return types.SimpleNamespace(update=self.cells[-1].append)


def as_notebook(monkeypatch, config) -> FakeNotebook:
    fake = FakeNotebook(config)
    monkeypatch.setitem(sys.modules, "IPython", fake)
    monkeypatch.setitem(sys.modules, "IPython.display", fake.display)
    return fake


def test_a_notebook_s_cell_is_changed_in_place(monkeypatch, capsys):
    fake = as_notebook(monkeypatch, {"IPKernelApp": {}})
    now = iter(range(0, 1000, 10))
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(now))
    with lightprobe.Meter() as meter:
        meter.update("<pass 1>", 1, 3)
        meter.update("<pass 1>", 2, 3, "loss <b>")
        meter.update("pass 2", 1, 1)
    assert len(fake.cells) == 1
    last = fake.cells[0][-1]
    assert '<progress value="2" max="3">' in last
    assert "&lt;pass 1&gt;" in last
    assert "2 of 3, 0:" in last
    assert "left loss &lt;b&gt;" in last
    assert "pass 2" in last
    assert capsys.readouterr() == ("", "")


def test_fast_steps_do_not_flood_a_notebook(monkeypatch):
    fake = as_notebook(monkeypatch, {"IPKernelApp": {}})
    monkeypatch.setattr(progress.time, "monotonic", lambda: 100.0)
    with lightprobe.Meter() as meter:
        for done in range(1, 1001):
            meter.update("lessons", done, 1000)
    assert len(fake.cells[0]) <= 4
    assert "1000 of 1000" in fake.cells[0][-1]


@pytest.mark.parametrize("config", [{}, None])
def test_elsewhere_lines_go_to_standard_error(monkeypatch, capsys, config):
    """IPython in a terminal is no notebook."""
    if config is not None:
        as_notebook(monkeypatch, config)
    with lightprobe.Meter() as meter:
        meter.update("pass 1", 1, 2)
        meter.update("pass 1", 2, 2, "loss 0.1")
    printed = capsys.readouterr()
    assert printed.err == "pass 1: 2 of 2, 0:00 left loss 0.1\n"
    assert printed.out == ""


def test_the_time_left_waits_for_a_second_step_and_may_be_hours(monkeypatch, capsys):
    now = iter([0.0, 20.0, 20.0, 20.0, 56.0, 56.0, 56.0])
    monkeypatch.setattr("time.monotonic", lambda: next(now))
    with lightprobe.Meter() as meter:
        meter.update("pass 1", 1, 401)
        meter.update("pass 1", 2, 401)
    assert capsys.readouterr().err == "pass 1: 1 of 401\npass 1: 2 of 401, 3:59:24 left\n"


@pytest.mark.parametrize(("variable", "colored"), [("FORCE_COLOR", True), ("NO_COLOR", False)])
def test_a_terminal_has_a_bar_with_colours_unless_they_are_not_wanted(monkeypatch, capsys, variable, colored):
    for name, value in (("TERM", "xterm-256color"), ("TTY_COMPATIBLE", "1"), (variable, "1")):
        monkeypatch.setenv(name, value)
    with lightprobe.Meter() as meter:
        meter.update("pass 1", 1, 2)
    printed = capsys.readouterr().err
    assert "1/2" in printed
    assert (re.search(r"\x1b\[[\d;]*3[0-8][\d;]*m", printed) is not None) is colored


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs a terminal of POSIX")
@pytest.mark.parametrize(("variables", "colored"), [({}, True), ({"NO_COLOR": "1"}, False)])
def test_help_is_coloured_on_a_terminal_unless_it_is_not_wanted(variables, colored):
    import pty

    program = "import sys; from lightprobe.cli.main import main; sys.exit(main(['inspect', '--help']))"
    ours, theirs = pty.openpty()
    kept = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR")}
    environment = {**kept, "TERM": "xterm-256color", **variables}
    subprocess.run([sys.executable, "-c", program], stdout=theirs, env=environment, check=True)
    os.close(theirs)
    with os.fdopen(ours, "rb", buffering=0) as terminal:
        assert (b"\x1b[" in terminal.read(100_000)) is colored
