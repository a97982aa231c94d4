"""What a command answers to people, and with --json to programs."""

import json
import math
import os
import subprocess
import sys
from enum import Enum
from pathlib import Path

import numpy as np
import pytest
import torch

from lightprobe.cli.answer import answering, is_for_programs, keep, plain_values, say, say_one
from lightprobe.cli.main import main
from lightprobe.core.errors import InputError, LightprobeError


def command() -> None:
    print("a library's own words")
    say("Report: page", report=Path("page"))
    keep(mean=float("nan"))
    for name in ("a", "b"):
        say_one("photos", f"Photo: {name}", {"name": name})


def test_people_get_lines(capsys):
    with answering(as_object=False):
        command()
        assert not is_for_programs()
    assert capsys.readouterr().out == "a library's own words\nReport: page\nPhoto: a\nPhoto: b\n"


def test_programs_get_one_object_and_nothing_else(capsys):
    with answering(as_object=True):
        command()
        assert is_for_programs()
    printed = capsys.readouterr()
    assert json.loads(printed.out) == {
        "report": "page",
        "mean": None,
        "photos": [{"name": "a"}, {"name": "b"}],
    }
    assert printed.err == "a library's own words\n"


def test_an_error_is_in_the_object_with_what_was_said_before(capsys):
    def fail():
        with answering(as_object=True):
            say("one", one=1)
            raise InputError("No such photo.")

    with pytest.raises(InputError):
        fail()
    assert json.loads(capsys.readouterr().out) == {"one": 1, "error": "No such photo."}


@pytest.mark.parametrize(
    ("raised", "sentence"),
    [
        (MemoryError(), "Out of memory: "),
        (KeyError("abc"), "Unexpected error, please report it"),
        (KeyboardInterrupt(), "Interrupted."),
    ],
)
def test_whatever_goes_wrong_leaves_a_sentence(raised, sentence, capsys):
    with pytest.raises((LightprobeError, KeyboardInterrupt)), answering(as_object=True):
        raise raised
    assert json.loads(capsys.readouterr().out)["error"].startswith(sentence)


@pytest.mark.parametrize(("code", "printed"), [(0, ""), (2, "cannot be understood")])
def test_help_is_no_answer_and_a_command_line_that_cannot_be_read_is_one(code, printed, capsys):
    with pytest.raises(SystemExit), answering(as_object=True):
        raise SystemExit(code)
    out = capsys.readouterr().out
    assert printed in (json.loads(out)["error"] if code else out + printed)
    assert bool(out) == bool(code)


def test_a_command_within_a_command_does_not_mix_with_it(capsys):
    with answering(as_object=True):
        with answering(as_object=False):
            say("inner", inner=1)
        say("outer", outer=1)
    printed = capsys.readouterr()
    assert json.loads(printed.out) == {"outer": 1}
    assert printed.err == "inner\n"


def test_every_kind_of_value_has_a_form():
    class Color(Enum):
        RED = "red"

    values = {
        Color.RED: (np.float32(0.5), torch.ones(2), np.int64(3)),
        "path": Path("a/b"),
        "inf": math.inf,
        "no": None,
    }
    assert plain_values(values) == {"red": [0.5, [1.0, 1.0], 3], "path": "a/b", "inf": None, "no": None}
    with pytest.raises(TypeError):
        plain_values(object())


def test_names_that_no_terminal_can_show_are_escaped():
    name = os.fsdecode(b"out\xe9")
    program = 'import sys; from lightprobe.cli.main import program; sys.argv = ["lightprobe", "--version"]; program()'
    told = {**os.environ, "PYTHONIOENCODING": "utf-8:strict"}
    command = [sys.executable, "-c", f"{program}; print({name!r})"]
    done = subprocess.run(command, capture_output=True, env=told, check=True)
    assert b"out\\udce9" in done.stdout


@pytest.mark.parametrize("chosen", [None, "3"])
def test_numpy_computes_on_one_thread_unless_a_person_chooses(chosen):
    names = "os.environ['OPENBLAS_NUM_THREADS'], 'numpy' in sys.modules"
    program = 'import os, sys; from lightprobe.cli.main import program; sys.argv = ["lightprobe", "--version"]; program()'
    told = {key: value for key, value in os.environ.items() if key != "OPENBLAS_NUM_THREADS"}
    told |= {} if chosen is None else {"OPENBLAS_NUM_THREADS": chosen}
    command = [sys.executable, "-c", f"{program}; print({names})"]
    done = subprocess.run(command, capture_output=True, env=told, check=True, text=True)
    assert done.stdout.splitlines()[1] == f"{chosen or '1'} False"  # NumPy looks when it is imported


def test_an_answer_is_json_in_any_encoding():
    script = "from lightprobe.cli.answer import answering, say\nwith answering(as_object=True): say('', name='caf\\u00e9')"
    told = {**os.environ, "PYTHONIOENCODING": "ascii:backslashreplace"}
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, env=told, check=True)
    assert json.loads(done.stdout) == {"name": "café"}


def test_errors_of_the_program_come_as_sentence_and_object(tmp_path, capsys):
    assert main(["report", str(tmp_path), "--json"]) == 2
    printed = capsys.readouterr()
    assert printed.err == f"lightprobe: {json.loads(printed.out)['error']}\n"
    assert "is not a run folder" in printed.err
