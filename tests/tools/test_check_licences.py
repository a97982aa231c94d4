"""Licences that are not allowed, not told, or brought along in a shared library are found."""

import json
from email.message import Message
from importlib.metadata import Distribution
from pathlib import PurePath

import pytest

from check_licences import Package, bill, closure, faults, is_allowed, libraries, licence, main, project


class Told(Distribution):
    """A package that says of its licence what it is given."""

    def __init__(self, **said: str):
        self._said = Message()
        for key, value in said.items():
            self._said[key.replace("_", "-")] = value

    def read_text(self, filename: str) -> str | None:
        return self._said.as_string() if filename == "METADATA" else None

    def locate_file(self, path):
        return path


@pytest.mark.parametrize(
    ("said", "expression"),
    [
        ({"License_Expression": "MIT AND PSF-2.0"}, "MIT AND PSF-2.0"),
        ({"License": "Apache 2.0"}, "Apache-2.0"),
        (
            {"License": "Copyright, and so on", "Classifier": "License :: OSI Approved :: BSD License"},
            "BSD-3-Clause",
        ),
        ({"Classifier": "License :: OSI Approved :: Odd License"}, "Odd License"),
        ({"License": "ask us"}, None),
    ],
)
def test_what_packages_say_becomes_spdx(said, expression):
    assert licence("any", Told(Name="any", **said)) == expression


def test_an_expression_needs_a_way_of_allowed_licences():
    for expression in ("MIT", "GPL-3.0-only OR MIT", "Apache-2.0 WITH LLVM-exception AND MIT"):
        assert is_allowed(expression)
    for expression in ("MIT AND GPL-3.0-only", "AGPL-3.0-only", "(MIT)"):
        assert not is_allowed(expression)


def test_each_fault_is_a_sentence():
    packages = [
        Package("good", "1", "MIT", (), {}),
        Package("silent", "1", None, (), {}),
        Package("copyleft", "1", "GPL-3.0-only", (), {}),
        Package("bringing", "1", "MIT", (), {"libx265.so": "GPL-2.0-or-later"}),
        Package("av", "1", "BSD-3-Clause", (), {"libx265.so": "GPL-2.0-or-later"}),
    ]
    assert [sentence.split()[0] for sentence in faults(packages)] == ["silent", "copyleft", "bringing"]


def test_shared_libraries_are_known_by_their_names():
    files = ["a/libx264-d6.so.165", "a/libavif-1.so", "a/libavcodec.dll", "a/libx264.txt", "a/libpng.so"]
    assert libraries(map(PurePath, files)) == {
        "libx264-d6.so.165": "GPL-2.0-or-later",
        "libavcodec.dll": "LGPL-2.1-or-later",
    }


def test_extras_of_the_project_are_followed_and_others_named(tmp_path):
    (tmp_path / "pyproject.toml").write_text(
        '[project]\nname = "a"\ndependencies = ["b>=1"]\n[project.optional-dependencies]\n'
        'dev = ["a[more]", "c"]\nmore = ["d; python_version > \'3\'"]\nother = ["e"]\n'
    )
    requirements, left_out = project(tmp_path / "pyproject.toml")
    assert [line.split(";")[0].split(">")[0] for line in requirements] == ["b", "c", "d"]
    assert left_out == {"other"}


def test_a_bill_names_packages_and_what_needs_what():
    packages = [
        Package("a", "1.0+cpu", "MIT", ("b",), {}),
        Package("b", "2", "ISC", (), {"libx.so": "GPL-2.0"}),
    ]
    found = bill(packages)
    assert found["dependencies"][0] == {"ref": "pkg:pypi/a@1.0", "dependsOn": ["pkg:pypi/b@2"]}
    assert found["components"][0]["licenses"] == [{"expression": "MIT"}]
    assert found["components"][1]["properties"] == [{"name": "shared library", "value": "libx.so: GPL-2.0"}]


@pytest.mark.slow
def test_what_this_project_needs_is_allowed(tmp_path, capsys):
    assert main(["--bill", str(tmp_path / "bill.json")]) == 0, capsys.readouterr().out
    names = {
        component["name"] for component in json.loads((tmp_path / "bill.json").read_text())["components"]
    }
    assert {"torch", "numpy", "fastapi", "pytest"} <= names


def test_a_missing_package_is_named():
    assert closure(["no-such-package-here"]) == ([], ["no-such-package-here"])
