import json

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.scene.consistency import overlap
from lightprobe.scene.inspect import Inspection, inspect
from lightprobe.scene.overlay import (
    GAP,
    HULL_COLOR,
    MASK_COLOR,
    PAPER,
    Cell,
    contact_sheet,
    outline,
    write_overlay_sheet,
)
from tests.scene.worlds import (
    names,
    picture,
    views,
    write_blender,
    write_nerd,
    write_nerfstudio,
)

COUNT = 18


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return inspect(write_nerd(tmp_path_factory.mktemp("good") / "scene", views(COUNT)))


@pytest.mark.slow
def test_a_good_scene(good):
    assert good.problems == good.hints == ()
    assert good.mean_iou > 0.85
    assert len(good.photos) == COUNT
    text = "\n".join(good.lines())
    for fact in (
        "(nerd layout)",
        "16 train, 2 test, 0 relight",
        "72 x 60 (18)",
        "not in the files",
        "no problems",
    ):
        assert fact in text


@pytest.mark.slow
def test_hull_and_masks_disagree_where_the_pose_is_wrong(tmp_path):
    """One photo of eighteen has the pose of another; it alone is named."""
    root = write_nerd(tmp_path / "scene", views(COUNT))
    rows = np.load(root / "poses_bounds.npy")
    rows[5] = rows[12]
    np.save(root / "poses_bounds.npy", rows)
    found = inspect(root)
    assert found.problems == ()
    assert len(found.hints) == 1
    assert found.hints[0].startswith("Mask or camera of 1 of 18 photos (view_05: IoU ")


@pytest.mark.slow
def test_one_inverted_mask_is_named(tmp_path):
    root = write_nerd(tmp_path / "scene", views(COUNT))
    path = root / "masks" / "view_07.png"
    Image.fromarray(255 - np.asarray(Image.open(path))).save(path)
    found = inspect(root)
    assert len(found.hints) == 1
    assert found.hints[0].startswith("The masks of 1 of 18 photos (view_07) look inverted")


@pytest.mark.slow
def test_all_masks_inverted(tmp_path):
    root = write_nerd(tmp_path / "scene", views(COUNT))
    for name in names(COUNT):
        path = root / "masks" / f"{name}.png"
        Image.fromarray(255 - np.asarray(Image.open(path))).save(path)
    found = inspect(root)
    assert len(found.problems) == 1
    assert found.problems[0].startswith("The masks of all 18 photos look inverted")


def test_one_sound_photo_is_not_enough_to_judge(tmp_path):
    root = write_nerd(tmp_path / "scene", views(3))
    Image.new("L", (5, 5), 255).save(root / "masks" / "view_01.png")
    found = inspect(root)
    assert len(found.problems) == 2
    assert found.problems[1].endswith("1 sound training photos; two or more are needed.")
    assert found.hints == ()


@pytest.mark.slow
def test_wrong_axes_through_the_whole_inspection(tmp_path):
    root = write_nerfstudio(tmp_path / "scene", views(COUNT, size=(64, 64)))
    data = json.loads((root / "transforms.json").read_text())
    for frame in data["frames"]:
        frame["transform_matrix"] = (np.array(frame["transform_matrix"]) @ np.diag([1, -1, -1, 1])).tolist()
    (root / "transforms.json").write_text(json.dumps(data))
    found = inspect(root)
    assert any("look like OpenCV's" in problem for problem in found.problems)
    assert any("look like OpenCV's" in line for line in found.lines())


def test_overlap():
    a, b = np.zeros((2, 4), bool), np.zeros((2, 4), bool)
    assert overlap(a, b) == 1
    a[0, :3], b[0, 1:] = True, True
    assert overlap(a, b) == 0.5


def test_first_twenty_problems_and_their_count(tmp_path):
    found = Inspection(tmp_path, "nerd", (), None, tuple(f"problem {i}" for i in range(25)), ())
    lines = found.lines()
    assert "25 problems, the first 20:" in lines
    assert sum(line.startswith("  problem") for line in lines) == 20


def test_unreadable_scene_is_reported_not_raised(tmp_path):
    found = inspect(tmp_path)
    assert found.format is None
    assert found.mean_iou is None
    assert "1 problem:" in found.lines()
    with pytest.raises(InputError, match="no sound photo"):
        write_overlay_sheet(found, tmp_path / "sheet.png")


def test_overlay_sheet(good, tmp_path):
    write_overlay_sheet(good, tmp_path / "sheet.png")
    sheet = np.asarray(Image.open(tmp_path / "sheet.png"))
    for color in (MASK_COLOR, HULL_COLOR):
        assert (sheet == color).all(axis=-1).sum() > 50
    assert [path.name for path in tmp_path.iterdir()] == ["sheet.png"]


@pytest.mark.slow
def test_outlines_without_a_hull(tmp_path):
    """Two photos whose masks share no point have no hull, but they can still be looked at."""
    root = write_blender(tmp_path / "scene", views(16))
    for i in range(15):
        color, mask = picture(views(16)[i])
        Image.fromarray(np.dstack([color, np.roll(mask, 36 * (i % 2), axis=1)])).save(
            root / "train" / f"r_{i}.png"
        )
    found = inspect(root)
    write_overlay_sheet(found, tmp_path / "sheet.png")
    assert len(found.photos) == 16


def test_an_outline_is_as_wide_as_asked_and_leaves_the_border_of_the_picture():
    shape = np.zeros((9, 9), bool)
    shape[:, 2:7] = True
    assert np.flatnonzero(outline(shape)[4]).tolist() == [2, 6]
    assert np.flatnonzero(outline(shape, 2)[0]).tolist() == [2, 3, 5, 6]


def test_pictures_stand_in_the_middle_of_their_cells_below_the_head():
    red = Cell("red", np.full((10, 20, 3), (255, 0, 0), np.uint8), (255, 255, 255))
    sheet = np.asarray(contact_sheet([red] * 5, side=40, letters=30, font=11, head=7))
    rows, columns = np.nonzero((sheet == (255, 0, 0)).all(-1))
    assert len(rows) == 5 * 10 * 20
    assert (rows.min(), columns.min()) == (7 + GAP + 15, GAP + 10)
    assert tuple(sheet[0, 0]) == PAPER
    assert len(np.unique(columns)) == 4 * 20  # at least four cells stand side by side


def test_a_caption_is_cut_and_stands_below_its_picture_in_its_color():
    picture = np.zeros((40, 40, 3), np.uint8)
    long, short = (
        np.asarray(contact_sheet([Cell("x" * n, picture, (0, 255, 0))], side=40, letters=5, font=11))
        for n in (30, 5)
    )
    assert np.array_equal(long, short)
    assert np.nonzero((long[..., 1] > 200) & (long[..., 0] < 24))[0].min() > GAP + 40
