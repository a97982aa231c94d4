"""What a person reads when something is wrong: one sentence, no traceback, and nothing is half-written."""

import errno
import json
import os
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from lightprobe.core.errors import InputError
from lightprobe.core.run import RunFolder
from lightprobe.imaging import write_png
from lightprobe.scene import load_photo
from tests.cli.commands import fails
from tests.toy_scene import write_toy_scene


@pytest.fixture
def scene(tmp_path):
    return write_toy_scene(tmp_path / "scene", train=8, test=1)


def edit_json(path: Path, change) -> None:
    value = json.loads(path.read_text())
    change(value)
    path.write_text(json.dumps(value))


def png_header(width: int, height: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


def empty_folder(scene):
    for path in sorted(scene.rglob("*"), reverse=True):
        path.unlink() if path.is_file() else path.rmdir()


def missing_folder(scene):
    empty_folder(scene)
    scene.rmdir()


def broken_json(scene):
    (scene / "transforms_train.json").write_text('{"frames": [\n')


def missing_photo(scene):
    (scene / "train" / "train_01.png").unlink()


def nan_pose(scene):
    def change(value):
        value["frames"][1]["transform_matrix"][0][3] = float("nan")

    edit_json(scene / "transforms_train.json", change)


def mirrored_pose(scene):
    def change(value):
        for row in value["frames"][2]["transform_matrix"]:
            row[0] = -row[0]

    edit_json(scene / "transforms_train.json", change)


def outside_path(scene):
    edit_json(scene / "transforms_train.json", lambda v: v["frames"][0].update(file_path="../../etc/passwd"))


def no_focal_length(scene):
    def change(value):
        del value["fl_x"], value["fl_y"]

    edit_json(scene / "transforms_train.json", change)


def truncated_jpeg(scene):
    from PIL import Image

    Image.fromarray(np.full((40, 40, 3), 128, np.uint8)).save(scene / "train" / "train_01.jpg")
    data = (scene / "train" / "train_01.jpg").read_bytes()
    (scene / "train" / "train_01.jpg").write_bytes(data[: len(data) // 2])
    write_png(scene / "mask.png", np.ones((40, 40, 3)))
    files = {"file_path": "train/train_01.jpg", "mask_path": "mask.png"}
    edit_json(scene / "transforms_train.json", lambda v: v["frames"][1].update(files))


def enormous_png(scene):
    (scene / "train" / "train_01.png").write_bytes(png_header(60_000, 60_000))


def empty_mask(scene):
    write_png(scene / "train" / "train_01.png", np.ones((40, 40, 3)), np.zeros((40, 40)))


def wrong_mask_size(scene):
    write_png(scene / "mask.png", np.ones((20, 30, 3)))
    edit_json(scene / "transforms_train.json", lambda v: v["frames"][1].update(mask_path="mask.png"))


# damage -> words that the sentence must contain: the place, then what is wrong with it
BAD_SCENES = {
    missing_folder: ["scene", "does not exist"],
    empty_folder: ["scene", "is empty"],
    broken_json: ["transforms_train.json", "line 2"],
    missing_photo: ["transforms_train.json", "train/train_01", "does not exist"],
    nan_pose: ["transforms_train.json", "train/train_01", "NaN"],
    mirrored_pose: ["transforms_train.json", "train/train_02", "mirrored"],
    outside_path: ["transforms_train.json", "outside"],
    no_focal_length: ["transforms_train.json", "focal length"],
    truncated_jpeg: ["train_01.jpg"],
    enormous_png: ["train_01.png", "60000 x 60000"],
    empty_mask: ["train_01.png", "no object"],
    wrong_mask_size: ["mask.png", "30 x 20", "40 x 40"],
}


@pytest.mark.parametrize("damage", BAD_SCENES, ids=lambda damage: damage.__name__)
def test_a_bad_scene_is_one_sentence_and_leaves_nothing(scene, tmp_path, capsys, damage):
    damage(scene)
    code = fails(["train", scene, "-o", tmp_path / "run", "--device", "cpu"], capsys, BAD_SCENES[damage])
    assert code == 2
    assert not (tmp_path / "run").exists()


def test_a_full_disk_is_one_sentence_and_leaves_nothing(scene, tmp_path, capsys, monkeypatch):
    """Every flush to the disk fails, as it does when the last block is taken."""

    def full(handle):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    code = fails(["train", scene, "-o", tmp_path / "run", "--device", "cpu"], capsys, ["disk is full", "run"])
    assert code == 4
    assert [path.name for path in (tmp_path / "run").rglob("*") if path.is_file()] == []


def test_commands_on_something_that_is_no_run(tmp_path, capsys):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.txt").write_text("x")
    for command in (["distill"], ["eval"], ["export", "-o", tmp_path / "out"]):
        words = ["photos", "not a run folder", "lightprobe train"]
        fails([command[0], tmp_path / "photos", *command[1:]], capsys, words)
    assert not (tmp_path / "out").exists()


def test_export_before_fit_says_so(tmp_path, capsys):
    run = RunFolder.create(tmp_path / "run")
    for command in (["export", "-o", tmp_path / "out"], ["distill"]):
        fails([command[0], run.path, *command[1:]], capsys, ["Phase I has not finished", "lightprobe train"])
    assert not (tmp_path / "out").exists()


def test_what_an_evaluation_cannot_use_is_told_before_it_begins(tmp_path, capsys):
    run = RunFolder.create(tmp_path / "run")
    (tmp_path / "folder.json").mkdir()
    for output in ("numbers.txt", "folder.json"):
        fails(["eval", run.path, "-o", tmp_path / output], capsys, [output, "ends in .json"])
    kept = run.config_file.read_bytes()
    fails(["eval", run.path, "-o", run.config_file], capsys, ["config.json is a file of"])
    assert run.config_file.read_bytes() == kept
    run.metrics_file.write_text('{"default_method": "solve"}')
    fails(["eval", run.path, "-o", run.metrics_file], capsys, ["metrics.json is a file of"])
    fails(["eval", run.path, "--slow-photos", "0"], capsys, ["--slow-photos cannot be 0"])


def test_a_prediction_needs_a_photo_and_its_mask(tmp_path, capsys):
    run = RunFolder.create(tmp_path / "run")
    fails(["predict", run.path], capsys, ["No photo is named"])
    write_png(tmp_path / "a.png", np.ones((8, 8, 3)))
    pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 3], [0, 0, 0, 1]]
    camera = {"camera_to_world": pose, "fx": 8, "fy": 8, "cx": 4, "cy": 4, "width": 8, "height": 8}
    (tmp_path / "c.json").write_text(json.dumps(camera))
    (tmp_path / "masks").mkdir()
    asked = ["predict", run.path, tmp_path / "a.png", "--camera", tmp_path / "c.json"]
    fails([*asked, "--mask", tmp_path / "masks"], capsys, ["masks/a.png", "does not exist"])
    with pytest.raises(InputError, match=r"a\.png has no mask.*--mask"):
        load_photo(tmp_path / "a.png", tmp_path / "c.json")


def test_files_of_two_exports_are_not_mixed(tmp_path, capsys):
    run = RunFolder.create(tmp_path / "run")
    write_png(tmp_path / "out" / "old.png", np.zeros((2, 2, 3)))
    for command in (["export"], ["relight", "--env", tmp_path / "e.exr"]):
        fails([command[0], run.path, *command[1:], "-o", tmp_path / "out"], capsys, ["out is not empty"])


def test_bad_environments_of_the_user_cost_no_phase(scene, tmp_path, capsys):
    arguments = ["train", scene, "-o", tmp_path / "run", "--device", "cpu", "--hdri", tmp_path / "maps"]
    fails(arguments, capsys, ["maps", "not a folder"])
    (tmp_path / "maps").mkdir()
    fails(arguments, capsys, ["maps", "no .exr or .hdr"])
    assert fails([*arguments, "--preset", "paper"], capsys, ["--hdri changes nothing"]) == 3
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["fly"], ["no command 'fly'", "--help"]),
        (["fit", "SCENE", "-o", "RUN", "--device", "tpu"], ["tpu"]),
        (["fit", "SCENE", "-o", "RUN", "--decompose.texture-size", "0"], ["texture_size", "at least 2"]),
        (["fit", "SCENE", "-o", "RUN", "--device", "mps"], ["mps", "not supported"]),
        (
            ["train", "SCENE", "-o", "RUN", "--distill.light-resolution", "12"],
            ["light_resolution", "power of two"],
        ),
        (["inspect", "SCENE", "-o", "sheet.jpg"], ["sheet.jpg", ".png"]),
        (["render", "RUN", "--camera", "c", "--env", "e.exr", "-o", "out.gif"], [".gif", ".png or .exr"]),
    ],
)
def test_bad_options_are_one_sentence(scene, tmp_path, capsys, arguments, words):
    given = [
        str(scene) if a == "SCENE" else str(tmp_path / a) if a in ("RUN", "out.gif") else a for a in arguments
    ]
    fails(given, capsys, words)
