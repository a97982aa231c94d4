"""README.md keeps its word: its commands and its Python run, one after the other, and its numbers are the records'.

They run on sixteen rendered photos and a training of a few steps. A line of README that names a command or an option
that does not exist fails here.
"""

import json
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from lightprobe.imaging import read_hdr
from tests.toy_scene import TINY_DISTILL, TINY_WITHOUT_TRIALS
from turntable_photos import render, write

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
COMMANDS = [
    line.partition("#")[0].strip()
    for line in re.findall(r"^ {4}(lightprobe .+|pip .+|make .+)", README, re.M)
]
INLINE = re.findall(r"`((?:lightprobe|make|python) [^`]+)`", README)
SERVERS = {
    "view": ["--no-open", "--port", "0"],
    "serve": ["--port", "0"],
}  # commands that go on until they are ended
METHODS = ("constant", "probe-mlp", "solve", "probe-net+optimize")


def lightprobe(folder: Path, *words: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-m", "lightprobe", *words], cwd=folder, capture_output=True, text=True, timeout=600
    )


def serve(folder: Path, words: list[str]) -> None:
    """Run a server until it tells its address, and end it."""
    command = [sys.executable, "-u", "-m", "lightprobe", *words, *SERVERS[words[0]]]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert any("http://127.0.0.1" in line for line in server.stdout)
            server.terminate()  # not SIGINT, which a test run in the background inherits as ignored
            server.communicate(timeout=60)
        finally:
            server.kill()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the files that README speaks of: photos/cup, new.jpg and, later, chair.glb."""
    pytest.importorskip("pycolmap")
    pytest.importorskip("cv2")
    made = tmp_path_factory.mktemp("readme")
    write(render(17, 480, focal=2.0, arc=153), made / "rendered")
    photos = sorted((made / "rendered" / "images").iterdir())
    (made / "photos" / "cup").mkdir(parents=True)
    for photo in photos:
        shutil.copy(photo, made / "photos" / "cup" if photo != photos[8] else made / "new.jpg")
    return made


@pytest.mark.long
def test_the_commands_run_in_order_and_so_does_the_python(folder):
    for command in COMMANDS:
        program, *words = shlex.split(command)
        if program != "lightprobe" or words == ["demo"]:  # which takes minutes
            continue
        if words[0] == "train":
            words += [*TINY_WITHOUT_TRIALS, *TINY_DISTILL]
        if words[0] == "insert":
            shutil.copy(
                folder / "runs" / "cup" / "mesh" / "object.glb", folder / words[words.index("--object") + 1]
            )
        if words[0] in SERVERS:
            serve(folder, words)
            continue
        done = lightprobe(folder, *words)
        assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    named = re.findall(r"`((?:scenes|blender|runs)/[\w./]+\.\w+)`", README)
    assert named
    assert not [name for name in named if not (folder / name).exists()]
    (folder / "light.exr").unlink()
    [program] = re.findall(r"```python\n(.*?)```", README, re.S)
    done = subprocess.run([sys.executable, "-c", program], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[0] in ("good", "doubtful")
    assert read_hdr(folder / "light.exr").shape == (64, 128, 3)


@pytest.mark.long
def test_the_page_can_be_opened(folder):
    pytest.importorskip("uvicorn")
    [words] = [shlex.split(command)[1:] for command in INLINE if command.startswith("lightprobe view")]
    serve(folder, words)


@pytest.mark.slow
@pytest.mark.parametrize("command", ["lightprobe demo", *INLINE])
def test_commands_in_sentences_and_the_demo_are_there(command, tmp_path):
    program, name, *_ = shlex.split(command)
    if program == "make":
        assert re.search(rf"^{name}:", (ROOT / "Makefile").read_text(), re.M)
    elif program == "lightprobe":
        help = lightprobe(tmp_path, name, "--help")
        assert help.returncode == 0, help.stderr
        options = [word for word in shlex.split(command) if word.startswith("--")]
        assert not [option for option in options if option not in help.stdout]


def test_the_installation_names_an_extra_that_is_there():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    named = re.findall(r"\.\[(\w+)\]", README)
    assert named
    assert set(named) <= set(extras)


def test_the_numbers_are_those_of_the_records():
    rows = re.findall(r"^\| (\w+).*? \| (\d.+) \|$", README, re.M)
    assert len(rows) == 8
    for scene, cells in rows:
        scores = json.loads((ROOT / "benchmarks" / "records" / f"{scene}.json").read_text())["scores"]
        kinds, decimals = (
            (("psnr", "ssim"), (2, 3)) if scene == "cape" else (("relit_psnr", "relit_psnr_scaled"), (1, 1))
        )
        for method, cell in zip(METHODS, cells.split(" | "), strict=True):
            means = [
                f"{np.mean(scores[method][kind]):.{n}f}" for kind, n in zip(kinds, decimals, strict=True)
            ]
            assert cell == " / ".join(mean.removeprefix("0") for mean in means), (scene, method)


def test_it_can_be_read_in_one_go():
    assert len(README.splitlines()) <= 120
    assert not re.search(r"\b(?=[0-9a-f]*\d)(?=[0-9a-f]*[a-f])[0-9a-f]{7}\b", README), (
        "commits stand on the results page"
    )
