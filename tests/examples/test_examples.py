"""Every example runs, one after the other, on a run that the first of them has trained on the toy scene."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from lightprobe.imaging import read_hdr
from lightprobe.light.environment import Environment
from tests.export.glb_reader import Glb
from tests.toy_scene import write_toy_scene

EXAMPLES = Path(__file__).parents[2] / "examples"
pytestmark = pytest.mark.long


def run(name: str, *arguments: object) -> str:
    command = [sys.executable, str(EXAMPLES / name), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return write_toy_scene(tmp_path_factory.mktemp("toy") / "scene")


@pytest.fixture(scope="module")
def trained(scene):
    folder = scene.parent / "run"
    said = run("01_train.py", scene, folder, "--draft")
    assert "the lights of 18 photos" in said
    assert (folder / "mesh" / "object.glb").exists()
    return folder


@pytest.mark.parametrize("name", sorted(path.name for path in EXAMPLES.glob("*.py")))
def test_each_says_what_it_shows_and_explains_its_arguments(name):
    text = (EXAMPLES / name).read_text()
    assert text.startswith('"""')
    assert text.split('"""')[1].split("\n")[0] in run(name, "--help")


def test_02_writes_a_map_and_says_what_the_photo_is_worth(scene, trained, tmp_path):
    said = run("02_predict.py", trained, scene / "test" / "test_00.png", "-o", tmp_path / "light.exr")
    assert "light explains" in said
    assert read_hdr(tmp_path / "light.exr").min() >= 0
    assert read_hdr(tmp_path / "light.confidence.exr").max() <= 1


def test_03_shows_the_object_under_a_turned_light(trained, tmp_path):
    environment = sorted((trained / "env").iterdir())[0]
    run("03_relight.py", trained, environment, "-o", tmp_path / "relit", "--turns", 2)
    first, second = (Image.open(tmp_path / "relit" / f"{k:03d}.png") for k in range(2))
    assert first.size == second.size
    assert first.tobytes() != second.tobytes()


def test_04_explains_a_photo_better_than_grey_light(scene, trained, tmp_path):
    said = run("04_solve_light.py", trained, scene / "test" / "test_00.png", "-o", tmp_path / "solved.exr")
    grey, solved = (float(line.split()[-2].rstrip(",")) for line in said.splitlines()[:2])
    assert solved < grey
    assert Environment.load(tmp_path / "solved.exr").resolution == 16


def test_05_leaves_mesh_and_light_for_other_programs(scene, trained, tmp_path):
    said = run("05_export.py", trained, scene / "test" / "test_00.png", "-o", tmp_path / "out")
    files = {path.relative_to(tmp_path / "out").as_posix() for path in map(Path, said.split())}
    assert {"mesh.glb", "env/test_00.exr", "env/test_00.hdr", "test_00.png"} <= files
    assert all((tmp_path / "out" / file).exists() for file in files)
    assert Glb((tmp_path / "out" / "mesh.glb").read_bytes()).document["meshes"]


def test_06_scores_its_own_method_beside_the_others(scene, trained):
    lines = run("06_own_method.py", trained, scene).splitlines()
    assert len(lines) == 2 * 4
    scores = {}
    for line in lines:
        name, score = line.split(":")
        scores.setdefault(name.split(maxsplit=1)[1], []).append(float(score.split()[0]))
    assert sum(scores["sky and ground"]) > sum(scores["constant"])


def test_07_s_cells_run_in_order_and_show_pictures(scene, trained, tmp_path, monkeypatch):
    notebook = json.loads((EXAMPLES / "07_notebook.ipynb").read_text())
    demo = tmp_path / "src" / "lightprobe" / "assets" / "demo" / "test"
    for link, target in (
        (tmp_path / "runs" / "demo", trained),
        (demo / "r_000.png", scene / "test" / "test_00.png"),
    ):
        link.parent.mkdir(parents=True)
        link.symlink_to(target)
    monkeypatch.chdir(tmp_path)
    names, shown = {}, []
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            *before, last = ast.parse("".join(cell["source"])).body
            exec(compile(ast.Module(before, []), "cell", "exec"), names)
            if isinstance(last, ast.Expr):
                shown.append(eval(compile(ast.Expression(last.value), "cell", "eval"), names))
            else:
                exec(compile(ast.Module([last], []), "cell", "exec"), names)
    assert shown[0]._repr_html_().count("data:image/png;base64,") == 2
    assert all(picture._repr_png_().startswith(b"\x89PNG") for picture in shown[:3])
    assert read_hdr(tmp_path / "light.exr").min() >= 0
