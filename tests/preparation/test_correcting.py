"""A click or a painted mask in one photo corrects the masks of all, and can be taken back."""

import json
from dataclasses import replace

import numpy as np
import pytest
import scipy

from lightprobe.core.errors import InputError
from lightprobe.imaging import read_mask, write_mask
from lightprobe.preparation import correcting
from lightprobe.preparation.cache import Cache
from lightprobe.preparation.correcting import click_mask, correct_masks, forget_correction
from lightprobe.preparation.corrections import Change, Corrections, clicked_region, corrected
from lightprobe.preparation.labelled import masks_of
from lightprobe.preparation.mask_report import mask_warnings
from lightprobe.preparation.undistortion import small_mask
from lightprobe.scene.consistency import overlap
from tests.preparation.labelled_scene import BLOCK, HALF, LID, labelled_scene, shown_at, written_mask

pytest.importorskip("cv2")
TOP = np.array([0, 0, HALF[2] - LID / 2])


@pytest.fixture
def scene(tmp_path):
    return tmp_path, *labelled_scene(tmp_path)


def masks(folder):
    return {path.stem: read_mask(path) >= 0.5 for path in (folder / "masks").iterdir()}


def files(folder):
    return {path.name: path.read_bytes() for path in (folder / "masks").iterdir()}


def report(folder):
    return json.loads((folder / "prepare.json").read_text())


def agreement_with(truth, found):
    return {photo: overlap(found[f"p_{photo}"], mask) for photo, mask in truth.items()}


def beside(labelled, photo):
    """Return where a photo shows the block and no box."""
    return shown_at(labelled, photo, BLOCK.mean(axis=0))


def test_a_click_on_what_is_not_the_object_takes_it_out_of_all_masks(scene):
    folder, labelled, truth = scene
    before, stages = agreement_with(truth, masks(folder)), []
    click_mask(folder, "p_1", beside(labelled, 1), False, stages.append)
    after = agreement_with(truth, masks(folder))
    assert stages == ["finding what belongs together", "cutting all photos", "writing masks"]
    assert all(after[photo] > before[photo] - 0.005 for photo in truth)
    assert np.mean(list(after.values())) > np.mean(list(before.values())) + 0.02
    assert report(folder)["masks_corrected"] == ["p_1"]


def test_a_click_on_what_is_missing_brings_it_into_all_masks(scene):
    folder, labelled, truth = scene
    before = agreement_with(truth, masks(folder))
    click_mask(folder, "p_0", shown_at(labelled, 0, TOP), True, lambda stage: None)
    after = agreement_with(truth, masks(folder))
    assert all(after[photo] > before[photo] + 0.03 for photo in truth)
    assert np.mean(list(after.values())) > np.mean(list(before.values())) + 0.06


def test_what_was_corrected_in_a_photo_can_be_taken_back(scene):
    folder, labelled, _ = scene
    before = files(folder)
    click_mask(folder, "p_1", beside(labelled, 1), False, lambda stage: None)
    assert files(folder) != before
    forget_correction(folder, "p_1", lambda stage: None)
    assert files(folder) == before
    assert report(folder)["masks_corrected"] == []


def test_a_painted_mask_stays_as_it_is_and_the_others_follow(scene):
    folder, _, truth = scene
    before = agreement_with(truth, masks(folder))
    write_mask(folder / "masks" / "p_1.png", truth[1].astype(np.float32))
    correct_masks(folder, lambda stage: None)
    found = masks(folder)
    assert np.array_equal(found["p_1"], truth[1])
    after = agreement_with(truth, found)
    assert np.mean(list(after.values())) > np.mean(list(before.values())) + 0.05
    written = files(folder)
    correct_masks(folder, lambda stage: None)
    assert files(folder) == written


def test_a_click_into_a_painted_mask_changes_it_around_the_click_alone(scene):
    folder, labelled, truth = scene
    painted = truth[1] | masks(folder)["p_1"]
    write_mask(folder / "masks" / "p_1.png", painted.astype(np.float32))
    correct_masks(folder, lambda stage: None)
    click_mask(folder, "p_1", beside(labelled, 1), False, lambda stage: None)
    after = masks(folder)["p_1"]
    assert overlap(after, truth[1]) > 0.97
    assert not (after & ~painted).any()


def test_a_click_on_what_is_as_it_should_be_is_one_sentence_and_changes_nothing(scene):
    folder, labelled, _ = scene
    before = files(folder)
    with pytest.raises(InputError, match="inside of the mask already"):
        click_mask(folder, "p_0", shown_at(labelled, 0, np.zeros(3)), True, lambda stage: None)
    with pytest.raises(InputError, match="outside of the mask already"):
        click_mask(folder, "p_0", (0, 1), False, lambda stage: None)
    with pytest.raises(InputError, match="p_9 has no camera"):
        click_mask(folder, "p_9", (0, 1), False, lambda stage: None)
    assert files(folder) == before


def test_what_is_said_of_cameras_stays_and_what_is_said_of_masks_is_said_anew(scene):
    folder, _, _ = scene
    told = report(folder)
    told["mask_stability"]["p_0"] = 0.5
    told["doubtful_masks"] = ["p_0"]
    told["warnings"] += mask_warnings(told)
    assert len(told["warnings"]) == 2
    (folder / "prepare.json").write_text(json.dumps(told))
    correct_masks(folder, lambda stage: None)
    assert report(folder)["warnings"] == told["warnings"][:1]
    assert report(folder)["mask_stability"]["p_0"] > 0.9


def test_right_additions_do_not_make_a_scene_doubtful_and_the_grid_grows_once(scene):
    folder, labelled, truth = scene
    for photo in (0, 1, 3, 4):
        write_mask(folder / "masks" / f"p_{photo}.png", truth[photo].astype(np.float32))
    changes = {
        photo: Change.painted(labelled.labelling.shapes[photo], truth[photo]) for photo in (0, 1, 3, 4)
    }
    grid = corrected(labelled.labelling, labelled.views, changes).hull.occupancy
    assert len(grid) == 1.5 * len(labelled.labelling.hull.occupancy)
    correct_masks(folder, lambda stage: None)
    assert report(folder)["doubtful_masks"] == []
    assert len(report(folder)["warnings"]) == 1


def test_a_mask_that_is_painted_while_others_are_written_is_not_lost(scene):
    folder, labelled, truth = scene

    def paint(stage):
        if stage == "writing masks":
            write_mask(folder / "masks" / "p_3.png", truth[3].astype(np.float32))

    click_mask(folder, "p_1", beside(labelled, 1), False, paint)
    correct_masks(folder, lambda stage: None)
    assert np.array_equal(masks(folder)["p_3"], truth[3])
    assert report(folder)["masks_corrected"] == ["p_1", "p_3"]


def test_a_mask_that_the_user_gave_stays_as_fine_as_it_is(tmp_path):
    labelled, _ = labelled_scene(tmp_path, given=2)
    path = tmp_path / "masks" / "p_2.png"
    before = path.read_bytes()
    click_mask(tmp_path, "p_1", beside(labelled, 1), False, lambda stage: None)
    assert path.read_bytes() == before


def straightened(labelled, found):
    """Return masks of photos, by name, in their pinholes' pictures."""
    cameras = {f"p_{photo}": view.camera for photo, view in labelled.views.items()}
    return {name: small_mask(mask, cameras[name]) for name, mask in found.items()}


def test_clicks_are_of_the_photo_as_its_lens_took_it(tmp_path, monkeypatch):
    labelled, truth = labelled_scene(tmp_path, k=-0.5)
    before, places = agreement_with(truth, straightened(labelled, masks(tmp_path))), []

    def region(color, evidence, mask, at, is_object):
        places.append(at)
        return clicked_region(color, evidence, mask, at, is_object)

    monkeypatch.setattr(correcting, "clicked_region", region)
    clicked, camera = beside(labelled, 1), labelled.views[1].camera
    click_mask(tmp_path, "p_1", clicked, False, lambda stage: None)
    pinhole = camera.project(BLOCK.mean(axis=0)[None])[0, :2] / (camera.width, camera.height)
    assert places[0] == pytest.approx(tuple(pinhole), abs=1e-6)
    assert np.abs(pinhole - clicked).max() > 0.005
    after = agreement_with(truth, straightened(labelled, masks(tmp_path)))
    assert np.mean(list(after.values())) > np.mean(list(before.values())) + 0.02


def test_a_mask_painted_on_a_photo_through_a_lens_stays_and_the_others_follow(tmp_path):
    labelled, truth = labelled_scene(tmp_path, k=-0.5)
    before = agreement_with(truth, straightened(labelled, masks(tmp_path)))
    mine = written_mask(labelled, 1, truth[1])
    assert overlap(mine >= 0.5, truth[1]) < 0.97  # the lens is seen
    write_mask(tmp_path / "masks" / "p_1.png", mine)
    correct_masks(tmp_path, lambda stage: None)
    np.testing.assert_allclose(read_mask(tmp_path / "masks" / "p_1.png"), mine, atol=0.003)
    after = agreement_with(truth, straightened(labelled, masks(tmp_path)))
    assert after[1] > 0.98
    assert np.mean(list(after.values())) > np.mean(list(before.values())) + 0.05


def test_a_mask_that_is_only_saved_anew_hardly_changes_another(tmp_path):
    """Painted masks are of the photo's pixels: taken for the pinhole's, all of the outline would be a correction."""
    labelled_scene(tmp_path, k=-0.5)
    before = masks(tmp_path)
    path = tmp_path / "masks" / "p_1.png"
    write_mask(path, 0.98 * read_mask(path))
    correct_masks(tmp_path, lambda stage: None)
    assert report(tmp_path)["masks_corrected"] == ["p_1"]
    assert min(overlap(mask, before[name]) for name, mask in masks(tmp_path).items()) > 0.99


def test_a_mask_that_the_user_gave_of_a_photo_through_a_lens_stays_as_fine_as_it_is(tmp_path):
    labelled, _ = labelled_scene(tmp_path, given=2, k=-0.5)
    path = tmp_path / "masks" / "p_2.png"
    before = path.read_bytes()
    click_mask(tmp_path, "p_1", beside(labelled, 1), False, lambda stage: None)
    assert path.read_bytes() == before


def test_clicks_of_another_size_are_used_and_a_damaged_file_of_cameras_costs_no_mask(scene):
    folder, labelled, _ = scene
    click_mask(folder, "p_1", beside(labelled, 1), False, lambda stage: None)
    kept = folder / ".prepare" / "clicked" / "p_1.png"
    write_mask(kept, read_mask(kept)[::2, ::2])
    click_mask(folder, "p_1", (0.05, 0.05), True, lambda stage: None)
    before = files(folder)
    cameras = json.loads((folder / "transforms.json").read_text())
    cameras["frames"][0]["h"] = 1e999
    (folder / "transforms.json").write_text(json.dumps(cameras))
    with pytest.raises(InputError, match=r"transforms\.json is not as prepare wrote it"):
        forget_correction(folder, "p_1", lambda stage: None)
    del cameras["frames"][0]
    (folder / "transforms.json").write_text(json.dumps(cameras))
    with pytest.raises(InputError, match="lacks the photo p_0"):
        forget_correction(folder, "p_1", lambda stage: None)
    assert files(folder) == before


def test_a_folder_that_prepare_did_not_make_is_left_alone(tmp_path):
    with pytest.raises(InputError, match="no scene that prepare made"):
        click_mask(tmp_path, "a", (0.5, 0.5), True, lambda stage: None)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("damage", ["labelling", "color", "report"])
def test_a_scene_without_what_was_kept_is_one_sentence(scene, damage):
    folder, _, _ = scene
    if damage == "report":
        (folder / "prepare.json").write_text(json.dumps({**report(folder), "warnings": 3}))
    else:
        (folder / ".prepare" / {"labelling": "labels.npz", "color": "photo-p_2.npz"}[damage]).unlink()
    before = files(folder)
    with pytest.raises(InputError, match=r"give its prepare command once more|prepare the scene anew"):
        click_mask(folder, "p_0", (0.5, 0.5), False, lambda stage: None)
    assert files(folder) == before


def test_the_mask_of_a_hint_brings_what_all_photos_lose_and_no_rim_of_it(scene, tmp_path):
    _, labelled, truth = scene
    loose = scipy.ndimage.binary_dilation(truth[1], iterations=2)
    hinted = {**labelled.views, 1: replace(labelled.views[1], given=loose, fixed=False)}
    before = masks_of(labelled, Corrections(), Cache(tmp_path / "a")).masks
    after = masks_of(replace(labelled, views=hinted), Corrections(), Cache(tmp_path / "b")).masks
    better = [overlap(after[photo], mask) - overlap(before[photo], mask) for photo, mask in truth.items()]
    assert np.mean(better) > 0.05
    assert not Change.hinted(before[1], scipy.ndimage.binary_dilation(before[1], iterations=2)).added.any()


def test_what_is_added_lies_where_votes_nearly_sufficed(scene):
    _, labelled, truth = scene
    found = labelled.labelling
    centers = found.hull.centers(np.ones_like(found.hull.occupancy))
    lid = (np.abs(centers) <= HALF).all(axis=1).reshape(found.hull.occupancy.shape)
    widest = replace(found.hull, occupancy=found.hull.occupancy | lid)
    change = Change.painted(found.shapes[1] & truth[1], truth[1])

    def stray(labelling):
        grid = corrected(labelling, labelled.views, {1: change}).hull.occupancy
        more = (len(grid) - len(lid)) // 2
        return (grid[(slice(more, -more),) * 3] & ~widest.occupancy).sum()

    assert stray(replace(found, widest=widest)) < 0.2 * stray(found)
