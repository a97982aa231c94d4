"""COLMAP's folders as programs write them: lines that lack, several models, names of any kind."""

import shutil

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.scene.colmap import find_model
from lightprobe.scene.frame import Problems
from lightprobe.scene.loading import read_folder
from tests.scene.worlds import quaternion, views, write_colmap_model

COUNT = 5
SHOTS = views(COUNT, size=(40, 30))
FILES = [f"view_{i}.png" for i in range(COUNT)]


def photo(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGBA", (40, 30), (9, 9, 9, 255)).save(path)


def write(root, *, folder="sparse/0", files=FILES, binary=False, count=COUNT):
    for name in files:
        photo(root / "images" / name)
    (root / folder).mkdir(parents=True, exist_ok=True)
    write_colmap_model(root / folder, files[:count], SHOTS[:count], binary=binary)
    return root


def positions(root):
    found = [photo for _, photo in read_folder(root, Problems()).all_photos()]
    return np.array([photo.camera.position for photo in sorted(found, key=lambda photo: photo.image_path)])


EXPECTED = np.array([view.position for view in SHOTS])


def image_lines(files=FILES):
    for i, (view, file) in enumerate(zip(SHOTS, files, strict=True)):
        pose = " ".join(repr(float(value)) for value in (*quaternion(view.rotation), *view.translation))
        yield f"{i + 1} {pose} {i + 7} {file}"


@pytest.mark.parametrize(
    "gaps",
    [
        [""] * COUNT,
        ["\n"] * COUNT,
        ["\n\n"] * COUNT,
        ["", "\n", "", "\n", ""],
        ["1.5 2.5 -1\n", "", "1 2 3 4 5 6\n", "\n", ""],
        ["\t\n"] * COUNT,
        ["# nothing seen\n"] * COUNT,
    ],
)
def test_lines_of_points_may_be_missing(tmp_path, gaps):
    root = write(tmp_path / "scene")
    text = "".join(f"{line}\n{gap}" for line, gap in zip(image_lines(), gaps, strict=True))
    (root / "sparse/0/images.txt").write_text(text)
    np.testing.assert_allclose(positions(root), EXPECTED, atol=1e-12)


@pytest.mark.parametrize("line", ["1 2", "1.5 2.5 point", "x y 3", "1 2 3 4"])
def test_a_line_that_is_neither_points_nor_an_image(tmp_path, line):
    root = write(tmp_path / "scene")
    first, *others = image_lines()
    (root / "sparse/0/images.txt").write_text("\n".join([first, line, *others]) + "\n")
    with pytest.raises(InputError, match=r"images\.txt line 2 is no list of points .*nor an image"):
        positions(root)
    problems = Problems(collect=True)
    assert len(read_folder(root, problems).all_photos()) == COUNT
    assert len(problems.messages) == 1


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("parent", ["sparse", "colmap/sparse"])
def test_the_largest_of_several_models_is_read_and_said(tmp_path, binary, parent):
    root = write(tmp_path / "scene", folder=f"{parent}/0", binary=binary, count=2)
    write(root, folder=f"{parent}/1", binary=not binary)
    write(root, folder=f"{parent}/10", binary=binary, count=3)
    said = (
        rf"holds 3 COLMAP models: the largest, {parent}/1 with 5 photos, is read, and not {parent}/0 with 2, "
    )
    with pytest.warns(LightprobeWarning, match=said):
        np.testing.assert_allclose(positions(root), EXPECTED, atol=1e-12)


@pytest.mark.filterwarnings("error")
def test_a_model_that_was_named_is_read(tmp_path):
    root = write(tmp_path / "scene", count=3)
    write(root, folder="sparse/1")
    assert len(positions(root / "sparse/0")) == 3


def test_of_equal_models_the_first_is_read(tmp_path):
    root = write(tmp_path / "scene", folder="sparse/1")
    write(root, folder="sparse/0")
    with pytest.warns(LightprobeWarning, match="the largest, sparse/0 with 5 photos"):
        positions(root)


def test_a_broken_model_beside_a_sound_one(tmp_path):
    root = write(tmp_path / "scene", folder="sparse/1", count=2)
    (root / "sparse/0").mkdir()
    (root / "sparse/0/images.bin").write_bytes(b"\xff" * 3)
    assert find_model(root) == root / "sparse/1"


def test_numbered_folders_without_models(tmp_path):
    """COLMAP leaves empty folders of reconstructions that failed."""
    root = write(tmp_path / "scene", folder="sparse")
    (root / "sparse/0").mkdir()
    assert find_model(root) == root / "sparse"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("whole", ["bin", "txt"])
def test_half_a_model_of_one_kind_beside_a_whole_one_of_the_other(tmp_path, whole):
    root = write(tmp_path / "scene", binary=True)
    write(root, binary=False)
    (root / "sparse/0" / f"images.{'txt' if whole == 'bin' else 'bin'}").unlink()
    np.testing.assert_allclose(positions(root), EXPECTED, atol=1e-6)


NAMES = {
    "spaces": "my photo  {}.png",
    "folders": "left cam/day 1/{}.png",
    "images/ in the name": "images/{}.png",
    "backslashes": "left\\{}.png",
    "capitals": "LEFT/{}.PNG",
    "umlauts": "Gerät/ü {}.png",
    "a number first": "12 34 {}.png",
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("kind", NAMES)
def test_names(tmp_path, kind, binary):
    written = [NAMES[kind].format(i) for i in range(COUNT)]
    root = write(tmp_path / "scene", binary=binary)
    shutil.rmtree(root / "images")
    for name in written:
        place = name.replace("\\", "/").lower() if kind in ("backslashes", "capitals") else name
        photo(root / "images" / place.removeprefix("images/"))
    write_colmap_model(root / "sparse/0", written, SHOTS, binary=binary)
    np.testing.assert_allclose(positions(root), EXPECTED, atol=1e-12)


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("C:\\shoot\\images\\{}", None),
        ("/home/ann/shoot/images/{}", None),
        ("../{}", "lies outside"),
        ("/etc/{}.conf", "lies outside"),
        ("{}.jpg", "is not in .*images; the folder holds"),
    ],
)
def test_paths_of_another_machine(tmp_path, written, said):
    files = [f"view_{i}" + (".png" if said is None else "") for i in range(COUNT)]
    root = write(tmp_path / "scene")
    write_colmap_model(root / "sparse/0", [written.format(file) for file in files], SHOTS, binary=False)
    if said is None:
        with pytest.warns(LightprobeWarning, match="names 5 paths of another place"):
            np.testing.assert_allclose(positions(root), EXPECTED, atol=1e-12)
    else:
        with pytest.raises(InputError, match=said):
            positions(root)


def test_images_in_capitals(tmp_path):
    root = write(tmp_path / "scene")
    (root / "images").rename(root / "Images")
    np.testing.assert_allclose(positions(root), EXPECTED, atol=1e-12)
