"""From rendered photos of a turned object to a scene that loads, with structure from motion and all."""

import json
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from benchmarks.prepare import compare, mask_overlaps, written_cameras
from lightprobe.core.errors import InputError
from lightprobe.core.files import write_json
from lightprobe.imaging import read_mask, write_png
from lightprobe.preparation import PrepareOptions, prepare
from lightprobe.preparation.labelled import Labelled, Masks
from lightprobe.preparation.mask_report import hint_overlaps
from lightprobe.preparation.masks import Cutting
from lightprobe.preparation.output import _lost, _warnings, finished
from lightprobe.preparation.voxel_labelling import View
from lightprobe.scene import load_scene
from lightprobe.scene.camera import Camera
from tests.preparation.ring import SIZE, ball_points, ring_cameras
from tests.preparation.ring import photographed as photographed_ring
from turntable_photos import render, write

pytest.importorskip("pycolmap")
pytest.importorskip("cv2")


@pytest.fixture(scope="module")
def photographed(tmp_path_factory):
    """Photos of an object that was turned before a still background, each under another light, and their
    scene.
    """
    folder = tmp_path_factory.mktemp("turntable")
    write(render(16, 480, focal=2.0, arc=144), folder)
    steps = []
    prepared = prepare(folder / "images", folder / "scene", on_progress=lambda *step: steps.append(step))
    return folder, prepared, steps


@pytest.mark.long
def test_a_turned_object_is_reconstructed_and_the_trap_is_named(photographed):
    folder, prepared, steps = photographed
    report = prepared.report
    assert report["registered"] >= 15
    for stage in ("scene: photos", "scene: masks"):
        told = [step[1:] for step in steps if step[0] == stage]
        assert told == [(done, report["registered"]) for done in range(1, report["registered"] + 1)]
    for path in (prepared.folder / "images").iterdir():
        assert path.read_bytes() == (folder / "images" / path.name).read_bytes()
    assert report["trap"].startswith("Trap: the background stands still")
    true = {
        n: Camera.from_json(v, source=n)
        for n, v in json.loads((folder / "true_cameras.json").read_text()).items()
    }
    turned, moved = compare(written_cameras(prepared.folder), true)
    assert np.median(turned) < 2.0
    assert np.median(moved) < 4.0
    masks = {name: folder / "true_masks" / f"{name}.png" for name in true}
    assert mask_overlaps(prepared.folder, masks).mean() > 0.85
    assert (prepared.folder / "contact.png").stat().st_size > 10_000
    scene = load_scene(prepared.folder)
    assert len(scene.train) + len(scene.test) == report["registered"]


@pytest.mark.slow
def test_the_scene_stands_upright(photographed):
    _, prepared, _ = photographed
    cameras = list(written_cameras(prepared.folder).values())
    assert (
        min(camera.camera_to_world[2, 1] for camera in cameras) > 0.85
    )  # all are held level, 25 degrees from above
    assert max(abs(camera.camera_to_world[2, 0]) for camera in cameras) < 0.03


@pytest.mark.long
def test_the_same_command_goes_on_and_keeps_a_corrected_mask(photographed):
    folder, prepared, first = photographed
    path = prepared.folder / "masks" / "p_003.png"
    mine = np.zeros((480, 480, 3))
    mine[140:340, 160:320] = 1
    write_png(path, mine, srgb=False)
    steps = []
    again = prepare(folder / "images", prepared.folder, on_progress=lambda *step: steps.append(step))
    assert again.report["masks_corrected"] == ["p_003"]
    assert np.array_equal(read_mask(path) >= 0.5, mine[..., 0] == 1)
    assert any(step[0] == "matches" for step in first)
    assert not any(step[0] == "matches" for step in steps)  # kept
    done = []
    third = prepare(folder / "images", prepared.folder, on_progress=lambda *step: done.append(step))
    assert third.report["masks_corrected"] == ["p_003"]
    assert done == []  # nothing was left to do


def write_photos(folder, pictures):
    folder.mkdir()
    for index, picture in enumerate(pictures):
        Image.fromarray(picture).save(folder / f"{index}.jpg", quality=90)
    return folder


def test_photos_that_show_nothing_in_common_are_one_sentence(tmp_path):
    rng = np.random.default_rng(0)
    noise = [
        np.kron(rng.integers(0, 256, (30, 30, 3), np.uint8), np.ones((4, 4, 1), np.uint8)) for _ in range(4)
    ]
    with pytest.raises(InputError, match="No cameras were found"):
        prepare(write_photos(tmp_path / "photos", noise), tmp_path / "scene")
    assert not (tmp_path / "scene" / "transforms.json").exists()


def test_photos_without_anything_on_them_are_one_sentence(tmp_path):
    flat = [np.full((90, 120, 3), 100 + 5 * i, np.uint8) for i in range(5)]
    with pytest.raises(InputError, match="No cameras were found"):
        prepare(write_photos(tmp_path / "photos", flat), tmp_path / "scene")


def test_an_output_with_other_files_is_refused(tmp_path):
    photos = write_photos(tmp_path / "photos", [np.full((90, 120, 3), 10 * i, np.uint8) for i in range(5)])
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letter.txt").write_text("keep")
    with pytest.raises(Exception, match="not made by prepare"):
        prepare(photos, tmp_path / "mine")
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["letter.txt"]


@pytest.mark.slow
def test_another_process_cannot_prepare_the_same_scene(photographed, tmp_path):
    from lightprobe.core.errors import ResourceError
    from lightprobe.core.files import locked_file

    folder, _, _ = photographed
    (tmp_path / ".prepare").mkdir()
    with (
        locked_file(tmp_path / ".prepare" / "lock", "busy"),
        pytest.raises(ResourceError, match="being prepared"),
    ):
        prepare(folder / "images", tmp_path, PrepareOptions())
    shutil.rmtree(tmp_path / ".prepare")


@pytest.mark.parametrize("content", ["[0]", "3", '"a"'])
def test_a_damaged_record_of_masks_is_one_sentence(tmp_path, content):
    (tmp_path / ".prepare").mkdir()
    (tmp_path / ".prepare" / "written.json").write_text(content)
    write_json(tmp_path / "prepare.json", {"key": "k"})
    write_json(tmp_path / "transforms.json", {})
    with pytest.raises(InputError, match=r"written\.json is damaged.*prepare the scene anew"):
        finished(tmp_path, "k")


def test_photos_of_another_reconstruction_are_told_from_photos_that_fit_nothing():
    photos = [SimpleNamespace(name=f"{i}.png", checksum=i) for i in range(5)]
    features, _, solution = photographed_ring(ring_cameras(5), ball_points(120))
    seen = [SimpleNamespace(sharpness=1.0, features=each) for each in features]
    fit = SimpleNamespace(explained=1.0)
    kept = SimpleNamespace(apart=((1, 2, 3), (3, 4)), solution=solution, share={}, agreement={}, fit=fit)
    choice = SimpleNamespace(kept=kept, trap=None)
    view = View(ring_cameras(1)[0], np.zeros((SIZE, SIZE, 3), np.uint8), None, False)
    labelled = Labelled({0: "0.png", 1: "1.png"}, {0: view, 1: view}, None)
    cutting = Cutting(choice, labelled, Masks({}, {}, {}), None)
    lost = _lost(photos, seen, {}, cutting)
    assert lost["2.png"].startswith("fits 1.png and 1 more, apart")
    assert lost["3.png"].startswith("fits 1.png and 1 more")  # the larger of its two
    assert lost["4.png"].startswith("fits 3.png, apart")
    warnings = _warnings(photos, cutting, SimpleNamespace(doubt=None))
    assert next(text for text in warnings if "fit together" in text).startswith(
        "2 photos, such as 2.png, fit together"
    )


def test_a_found_mask_is_held_against_the_hint_that_it_came_from():
    hint, found = np.zeros((2, SIZE, SIZE), bool)
    hint[20:100, 40:80] = True
    found[60:100, 40:80] = True  # without the upper half
    views = {
        i: View(camera, np.zeros((SIZE, SIZE, 3), np.uint8), None, False)
        for i, camera in enumerate(ring_cameras(3))
    }
    views[1] = View(views[1].camera, views[1].color, hint, False)
    views[2] = View(views[2].camera, views[2].color, hint, True)  # given, not found: nothing to compare
    masks = Masks(dict.fromkeys(views, found), {}, {})
    assert hint_overlaps(Labelled({}, views, None), masks) == {1: pytest.approx(0.5)}
