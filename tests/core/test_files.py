import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lightprobe.core import partial
from lightprobe.core.errors import ConfigError, InputError
from lightprobe.core.files import (
    append_text,
    filled_folder,
    inside,
    named_file,
    refuse_replacing,
    write_bytes,
)
from lightprobe.core.run import RunFolder

LEFTOVER = ".partial-lightprobe-abcd_123"


@pytest.mark.parametrize(
    "name", ["../x", "/etc/x", "..", ".", "", "a/b", "a/", "/", "x\0y", "\ud800", "./x", "a/../b", "x" * 252]
)
def test_only_the_plain_name_of_a_file_becomes_a_path(tmp_path, name):
    with pytest.raises(InputError, match="plain name"):
        named_file(tmp_path, name, ".exr")
    with pytest.raises(InputError, match="plain name"):
        RunFolder(tmp_path).environment_file(name)


@pytest.mark.skipif(sys.platform == "win32", reason="has no such permissions")
def test_files_and_folders_have_the_permissions_that_the_user_gives_new_ones(tmp_path):
    code = (
        "import os, sys; os.umask(0o077); from pathlib import Path; from lightprobe.core.files import *; "
        "write_bytes(Path(sys.argv[1]) / 'file', b'x')\n"
        "with atomic_folder(Path(sys.argv[1]) / 'folder'): pass"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=True)
    assert [(tmp_path / name).stat().st_mode & 0o777 for name in ("file", "folder")] == [0o600, 0o700]


def test_unusual_names_are_names():
    for name in ("a b", "ä..b", "...", ".hidden", "12:30", "x" * 200):
        assert named_file(Path("f"), name, ".exr") == Path("f") / f"{name}.exr"


KILLED = """
import os, signal, sys
from pathlib import Path
from lightprobe.core.files import atomic_path, filled_folder
with filled_folder(Path(sys.argv[1])) as folder, atomic_path(Path(sys.argv[1]) / "light.exr") as file:
    (folder / "mesh.glb").write_text("half")
    file.write_text("half")
    if sys.argv[2] == "wait":
        print("ready", flush=True)
        sys.stdin.read()
    os.kill(os.getpid(), signal.SIGKILL)
"""


def start(folder: Path, *arguments: str) -> subprocess.Popen:
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    return subprocess.Popen([sys.executable, "-c", KILLED, str(folder), *arguments], text=True, **pipes)


def test_the_next_call_clears_what_a_killed_one_left(tmp_path):
    start(tmp_path, "die").wait()
    assert len(os.listdir(tmp_path)) == 2
    assert all(name.startswith(".") for name in os.listdir(tmp_path))
    write_bytes(tmp_path / "light.exr", b"whole")
    assert os.listdir(tmp_path) == ["light.exr"]


def test_what_a_living_writer_or_somebody_else_has_stays(tmp_path):
    others = {".partial-x.exr", ".partial-lightprobe-SHOUTING", ".partial-lightprobe-abcd_123x", "notes.txt"}
    for name in others:
        (tmp_path / name).write_text("mine")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "kept").write_text("mine")
    (tmp_path / LEFTOVER).symlink_to(tmp_path / "elsewhere")
    writer = start(tmp_path, "wait")
    assert writer.stdout.readline() == "ready\n"
    before = set(os.listdir(tmp_path))
    write_bytes(tmp_path / "another", b"whole")
    assert set(os.listdir(tmp_path)) == before | {"another"}
    writer.stdin.close()
    writer.wait()
    write_bytes(tmp_path / "another", b"whole")
    assert set(os.listdir(tmp_path)) == others | {"another", "elsewhere", LEFTOVER}
    assert os.listdir(tmp_path / "elsewhere") == ["kept"]


def test_a_run_s_cleaning_leaves_the_files_of_a_living_writer(tmp_path):
    """`predict` writes into a run without holding it."""
    run = RunFolder.create(tmp_path)
    writer = start(tmp_path / "predictions", "wait")
    assert writer.stdout.readline() == "ready\n"
    with run.writing():
        assert len(list((tmp_path / "predictions").iterdir())) == 2
    writer.kill()
    writer.wait()
    with run.writing():
        assert list((tmp_path / "predictions").iterdir()) == []


def test_a_folder_fills_at_once_or_not_at_all(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".git").write_text("mine")
    with filled_folder(tmp_path / "out") as folder:
        (folder / "env").mkdir()
        (folder / "env" / "a.exr").write_text("light")
        assert os.listdir(tmp_path / "out") != ["env"]
    assert sorted(os.listdir(tmp_path / "out")) == [".git", "env"]
    with pytest.raises(InputError), filled_folder(tmp_path / "new") as folder:
        named_file(folder, "..")
    assert not (tmp_path / "new").exists()


def test_nothing_is_appended_through_a_link(tmp_path):
    (tmp_path / "precious").write_text("mine\n")
    (tmp_path / "log.txt").symlink_to(tmp_path / "precious")
    with pytest.raises(OSError, match=r"log\.txt"):
        append_text(tmp_path / "log.txt", "text")
    assert (tmp_path / "precious").read_text() == "mine\n"


@pytest.mark.slow
def test_many_writers_of_one_folder_do_not_take_each_other_s_files(tmp_path):
    code = (
        "import sys\nfrom pathlib import Path\nfrom lightprobe.core.files import write_bytes\n"
        "for i in range(150):\n    write_bytes(Path(sys.argv[1]) / f'{sys.argv[2]}-{i}', b'x')"
    )
    writers = [subprocess.Popen([sys.executable, "-c", code, str(tmp_path), name]) for name in "abc"]
    began = time.monotonic()
    assert [writer.wait() for writer in writers] == [0, 0, 0], time.monotonic() - began
    assert len(os.listdir(tmp_path)) == 450


def test_what_is_read_is_not_replaced(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    photo, other = Path("a.exr"), tmp_path / "b.exr"
    refuse_replacing([other, None], [photo, None])
    with pytest.raises(ConfigError, match="one of the files that are read"):
        refuse_replacing([tmp_path / "sub" / ".." / "a.exr"], [photo])
    with pytest.raises(ConfigError, match="Two of the files"):
        refuse_replacing([other, Path("b.exr")], [photo])


def test_without_locks_only_the_holder_of_a_run_clears_leftovers(tmp_path, monkeypatch):
    monkeypatch.setattr(partial, "fcntl", None)
    (tmp_path / LEFTOVER).write_text("its writer may be alive")
    write_bytes(tmp_path / "a", b"whole")
    assert sorted(os.listdir(tmp_path)) == [LEFTOVER, "a"]
    partial.clear_run(tmp_path)
    assert os.listdir(tmp_path) == ["a"]


def test_links_are_followed_only_where_they_may_be(tmp_path):
    root, elsewhere = tmp_path / "scene", tmp_path / "disk"
    root.mkdir()
    elsewhere.mkdir()
    (elsewhere / "a.png").write_text("x")
    (root / "images").symlink_to(elsewhere)
    (root / "loop").symlink_to("loop")
    with pytest.raises(InputError, match="lies outside"):
        inside(root, "images/a.png", source=root)
    assert inside(root, "images/a.png", source=root, follow_links=True) == root.resolve() / "images" / "a.png"
    for written in ("../disk/a.png", "images/../../disk/a.png", str(elsewhere / "a.png")):
        with pytest.raises(InputError, match="lies outside"):
            inside(root, written, source=root, follow_links=True)
    for written in ("loop", "images/\0/../../../x", "x" * 5000):
        with pytest.raises(InputError, match="is no file name"):
            inside(root, written, source=root, follow_links=True)
