"""Defects of the program, exhausted memory, interruptions and warnings: what of them a person reads."""

import warnings

import numpy as np
import pytest

from lightprobe.cli.main import main
from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.core.run import RunFolder
from tests.cli.commands import fails
from tests.toy_scene import write_toy_scene


@pytest.fixture
def scene(tmp_path):
    return write_toy_scene(tmp_path / "scene", train=8, test=1)


def test_a_defect_of_the_program_names_the_log_with_its_traceback(scene, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("lightprobe.runs.phases.decompose", lambda *a: 1 // 0)
    run = RunFolder(tmp_path / "run")
    code = fails(["fit", scene, "-o", run.path, "--device", "cpu"], capsys, ["ZeroDivisionError", "log.txt"])
    assert code == 70
    assert "Traceback" in run.log_file.read_text()


@pytest.mark.slow
def test_interruption_and_exhausted_memory(scene, tmp_path, capsys, monkeypatch):
    def stop(*arguments, **options):
        raise KeyboardInterrupt

    def exhaust(*arguments):
        raise MemoryError

    monkeypatch.setattr("lightprobe.runs.phases.decompose", stop)
    arguments = ["fit", scene, "-o", tmp_path / "run", "--device", "cpu"]
    assert fails(arguments, capsys, ["interrupted", "same command"]) == 130
    monkeypatch.setattr("lightprobe.cli.using.export_run", stop)
    assert fails(["export", tmp_path / "run", "-o", tmp_path / "out"], capsys, ["interrupted."]) == 130
    monkeypatch.setattr("lightprobe.runs.phases.decompose", exhaust)
    assert fails(arguments, capsys, ["Out of memory"]) == 4

    def allocate(*arguments):
        raise RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried to allocate 9 bytes.")

    monkeypatch.setattr("lightprobe.runs.phases.decompose", allocate)
    assert fails(arguments, capsys, ["Out of memory"]) == 4


def test_tracebacks_go_to_a_new_private_file(scene, tmp_path, capsys, monkeypatch):
    """Whatever lies in the temporary folder: the file's name cannot be guessed, and no link is followed."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    (tmp_path / "precious").write_text("mine")
    (tmp_path / "temporary" / "lightprobe-error.txt").symlink_to(tmp_path / "precious")
    monkeypatch.setattr("lightprobe.runs.training.load_checked_scene", lambda *a: 1 // 0)
    for _ in range(2):
        assert (
            fails(["fit", scene, "-o", tmp_path / "run"], capsys, ["ZeroDivisionError", "lightprobe-error-"])
            == 70
        )
    files = [path for path in (tmp_path / "temporary").iterdir() if not path.is_symlink()]
    assert [path.stat().st_mode & 0o777 for path in files] == [0o600, 0o600]
    assert all("Traceback" in path.read_text() for path in files)
    assert (tmp_path / "precious").read_text() == "mine"


def test_a_log_that_is_a_link_is_not_written_through(scene, tmp_path, capsys, monkeypatch):
    run = RunFolder.create(tmp_path / "run")
    (tmp_path / "precious").write_text("mine")
    run.log_file.symlink_to(tmp_path / "precious")
    monkeypatch.setattr("lightprobe.runs.phases.decompose", lambda *a: 1 // 0)
    fails(["fit", scene, "-o", run.path, "--device", "cpu"], capsys, ["log.txt"])
    assert (tmp_path / "precious").read_text() == "mine"


def test_warnings_of_libraries_are_not_for_the_user(scene, tmp_path, capsys, monkeypatch):
    """Nothing stands around the sentence; our own warnings still come through."""
    monkeypatch.setattr("sys.warnoptions", [])

    def warn(*arguments):
        np.log(np.array(-1.0))
        warnings.warn("an old function", DeprecationWarning, stacklevel=1)
        raise InputError("This is the sentence.")

    monkeypatch.setattr("lightprobe.runs.training.load_checked_scene", warn)
    with warnings.catch_warnings(record=True) as seen:
        fails(["fit", scene, "-o", tmp_path / "run"], capsys, ["This is the sentence."])
    assert seen == []

    def warn_too(*arguments):
        warnings.warn("Photos are upside down.", LightprobeWarning, stacklevel=1)
        raise InputError("This is the sentence.")

    monkeypatch.setattr("lightprobe.runs.training.load_checked_scene", warn_too)
    assert main(["fit", str(scene), "-o", str(tmp_path / "run")]) == InputError.exit_code
    said = capsys.readouterr().err.splitlines()
    assert said == ["lightprobe: warning: Photos are upside down.", "lightprobe: This is the sentence."]
