"""Progress with the time left: in a terminal and in a log."""

import os
import re
import subprocess
import sys

import pytest

import lightprobe


def test_without_a_terminal_lines_go_to_standard_error(capsys):
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
