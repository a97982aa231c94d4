"""What is done with a finished run: render, relight, export, and all of it from Python."""

import json
import shutil

import numpy as np
import pytest
import trimesh

from lightprobe.core.errors import ConfigError
from lightprobe.imaging import read_hdr, read_ldr
from lightprobe.render.path_tracer import check_path_tracer
from tests.cli.commands import fails, succeed
from tests.toy_scene import SIZE

PHASES = ("decompose", "distill")


@pytest.mark.slow
def test_render_writes_the_camera_s_picture(trained, tmp_path, capsys):
    scene, run = trained
    record = json.loads(run.scene_file.read_text())["photos"]["test"]["test_01"]["camera"]
    (tmp_path / "camera.json").write_text(json.dumps(record))
    env = run.environment_file("train_00")
    for suffix in ("png", "exr"):
        out = tmp_path / f"view.{suffix}"
        succeed("render", run.path, "--camera", tmp_path / "camera.json", "--env", env, "-o", out)
    many = ["render", run.path, "--camera", scene / "transforms_test.json", "--env", env]
    many += ["-o", tmp_path / "frame.png"]
    fails(many, capsys, ["holds 2 cameras"])
    succeed(*many, "--frame", "test_01")
    assert (tmp_path / "frame.png").read_bytes() == (tmp_path / "view.png").read_bytes()
    color, alpha = read_ldr(tmp_path / "view.png")
    linear = read_hdr(tmp_path / "view.exr")
    assert linear.shape == (SIZE, SIZE, 4)
    assert np.abs(alpha - linear[..., 3]).max() < 0.005
    solid = alpha > 0.99
    assert solid.mean() == pytest.approx(np.pi * (1.25 / np.sqrt(3.2**2 - 1)) ** 2, rel=0.15)
    assert np.abs(np.minimum(linear[solid, :3], 1) - color[solid]).max() < 0.02


def test_relight_writes_turntable_and_test_views(trained, tmp_path):
    _, run = trained
    env = run.environment_file("train_01")
    succeed("relight", run.path, "--env", env, "-o", tmp_path, "--frames", 3, "--side", 24)
    names = sorted(p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*.png"))
    assert names == [*(f"test/test_0{i}.png" for i in range(2)), *(f"turntable/00{i}.png" for i in range(3))]
    assert read_ldr(tmp_path / "turntable" / "001.png")[1].max() == 1


def test_a_path_tracer_makes_the_picture_when_asked(trained, tmp_path):
    scene, run = trained
    view = ["render", run.path, "--camera", scene / "transforms_test.json", "--frame", "test_01"]
    view += ["--env", run.environment_file("train_01"), "-o"]
    try:
        check_path_tracer()
    except ConfigError as missing:
        pytest.skip(str(missing))
    succeed(*view, tmp_path / "fast.exr")
    succeed(*view, tmp_path / "path.exr", "--renderer", "path", "--samples", 64)
    fast, path = (read_hdr(tmp_path / f"{name}.exr") for name in ("fast", "path"))
    solid = (fast[..., 3] > 0.99) & (path[..., 3] > 0.99)
    assert path[solid, :3].mean() == pytest.approx(fast[solid, :3].mean(), rel=0.1)
    assert np.abs(path - fast)[solid].max() > 0


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ([0, "--renderer", "path"], "--samples 0 must be from 1 to 65536"),
        ([16], "--samples 16 is for --renderer path"),
    ],
)
def test_a_number_of_rays_that_makes_no_picture_is_refused(trained, tmp_path, capsys, more, told):
    _, run = trained
    command = ["relight", run.path, "--env", run.environment_file("train_01"), "-o", tmp_path / "new"]
    fails([*command, "--samples", *more], capsys, [told])
    assert not (tmp_path / "new").exists()


@pytest.mark.slow
def test_export_writes_every_environment_twice(trained, tmp_path):
    _, run = trained
    succeed("export", run.path, "-o", tmp_path)
    assert (tmp_path / "mesh.glb").is_file()
    exr, hdr = (read_hdr(tmp_path / "env" / f"train_00{suffix}") for suffix in (".exr", ".hdr"))
    assert np.abs(exr - hdr).max() <= exr.max() / 128


def test_export_tells_of_an_object_at_survey_coordinates(trained, tmp_path, capsys):
    """The mesh is there as exactly as at the origin, and programs of 32 bits are warned of."""
    _, run = trained
    near, far, moved = tmp_path / "near", tmp_path / "far", tmp_path / "run"
    shutil.copytree(run.path, moved)
    record = json.loads((moved / "scene.json").read_text())
    offset = np.array([345678.123, 5812345.678, 112.3])
    record["similarity"]["center"] = (offset + record["similarity"]["center"]).tolist()
    (moved / "scene.json").write_text(json.dumps(record))
    succeed("export", run.path, "-o", near)
    assert "far from their origin" not in capsys.readouterr().err
    succeed("export", moved, "-o", far)
    told = capsys.readouterr().err
    assert "far from their origin" in told
    assert "up to 0.25 units away" in told
    x, y, z = offset
    (here, there) = (trimesh.load_mesh(folder / "mesh.glb", process=False) for folder in (near, far))
    assert there.vertices == pytest.approx(here.vertices + np.array([x, z, -y]), abs=1e-6)
