"""What a wheel lacks, or holds too much, is named; so is a Python that is not here."""

import ast
import sys
import zipfile
from pathlib import Path

import pytest

import check_wheel
from check_wheel import FailureError, check_content, is_there


@pytest.fixture
def wheel(tmp_path, monkeypatch):
    """Return a function that makes a wheel of given files for a project of two."""
    (tmp_path / "pyproject.toml").write_text('[project]\nversion = "1.0.0"\n')
    monkeypatch.setattr(check_wheel, "ROOT", tmp_path)
    monkeypatch.setattr(
        check_wheel, "_done", lambda words, folder: "src/lightprobe/a.py\nsrc/lightprobe/b.exr\n"
    )

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


@pytest.mark.slow
def test_modules_that_import_an_extra_at_their_head_are_named_as_such():
    source = Path(check_wheel.__file__).parents[1] / "src"
    extras = {
        "av",
        "drjit",
        "fastapi",
        "fsspec",
        "mitsuba",
        "pillow_heif",
        "pxr",
        "pyarrow",
        "pycolmap",
        "ray",
        "rawpy",
    }
    unnamed = []
    for path in source.rglob("*.py"):
        module = ".".join(path.relative_to(source).with_suffix("").parts)
        if module.startswith(check_wheel.WITH_EXTRAS):
            continue
        for statement in ast.parse(path.read_text()).body:
            names = [alias.name for alias in statement.names] if isinstance(statement, ast.Import) else []
            names += [statement.module or ""] if isinstance(statement, ast.ImportFrom) else []
            unnamed += [f"{module} imports {name}" for name in names if name.partition(".")[0] in extras]
    assert unnamed == []
