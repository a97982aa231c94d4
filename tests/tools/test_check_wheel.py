"""What a wheel lacks, or holds too much, is named; so is a Python that is not here."""

import sys
import zipfile

import pytest

import check_wheel
from check_wheel import FailureError, check_content, is_there


@pytest.fixture
def wheel(tmp_path, monkeypatch):
    """Return a function that makes a wheel of given files for a project of two."""
    (tmp_path / "pyproject.toml").write_text('[project]\nversion = "1.0.0"\n')
    monkeypatch.setattr(check_wheel, "ROOT", tmp_path)
    monkeypatch.setattr(check_wheel, "_done", lambda words, folder: "src/lightprobe/a.py\nsrc/lightprobe/b.exr\n")

    def made(*names, name="lightprobe-1.0.0-py3-none-any.whl"):
        with zipfile.ZipFile(tmp_path / name, "w") as archive:
            for inner in names:
                archive.writestr(inner, "")
        return tmp_path / name

    return made


def test_a_whole_wheel_passes(wheel):
    check_content(wheel("lightprobe/a.py", "lightprobe/b.exr", "lightprobe-1.0.0.dist-info/METADATA"))


@pytest.mark.parametrize(
    ("names", "more", "words"),
    [
        (["lightprobe/a.py"], {}, "lacks lightprobe/b.exr"),
        (["lightprobe/a.py", "lightprobe/b.exr", "tests/c.py"], {}, "holds tests/c.py"),
        ([], {"name": "lightprobe-0.9.0-py3-none-any.whl"}, "not called after version 1.0.0"),
    ],
)
def test_another_wheel_is_refused(wheel, names, more, words):
    with pytest.raises(FailureError, match=words):
        check_content(wheel(*names, **more))


def test_a_python_is_there_when_it_runs():
    assert is_there(sys.executable)
    assert not is_there("python9.9")
    assert not is_there("false")
