"""What the command `bench` adds to `runs.bench`: the program's own commands, and its options."""

import pytest

from lightprobe.cli import bench, main
from lightprobe.core.errors import ConfigError, ResourceError
from lightprobe.runs.bench import Step


@pytest.fixture
def folders(tmp_path):
    (tmp_path / "data" / "cup").mkdir(parents=True)
    names = {"data": "data", "output": "out", "results": "R.md", "records": "records"}
    return {option: tmp_path / name for option, name in names.items()}


def test_commands_are_named_and_given_to_the_program(folders, monkeypatch, capsys):
    given = []
    monkeypatch.setattr(main, "main", lambda words: given.append(words) or 2)
    with pytest.raises(ResourceError, match=r"failed.*: cup training\.$"):
        bench.bench(scenes=("cup",), steps=(Step.RUN,), **folders)
    run = folders["output"] / "runs" / "cup"
    assert given == [
        ["train", str(folders["data"] / "cup"), "-o", str(run), "--preset", "quick", "--seed", "0"]
    ]
    printed = capsys.readouterr().out
    assert f"lightprobe {' '.join(given[0])}\n" in printed
    assert f"Results: {folders['results']}\n" in printed


def test_an_interruption_ends_the_benchmark(folders, monkeypatch):
    monkeypatch.setattr(main, "main", lambda words: 130)
    with pytest.raises(KeyboardInterrupt):
        bench.bench(scenes=("cup",), **folders)


def test_the_pages_alone_need_records(folders, monkeypatch):
    monkeypatch.setattr(main, "main", lambda words: pytest.fail("a command was run"))
    with pytest.raises(ConfigError, match="--records"):
        bench.bench(tables_only=True, **folders)
