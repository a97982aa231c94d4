"""Paths and names in the spellings of other programs, systems and machines: found, or one sentence.

Every photo has a size of its own, by which it is known again.
"""

import json
import unicodedata
import warnings
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.scene import read_camera
from lightprobe.scene.file_names import SceneFiles, slashed
from lightprobe.scene.frame import Problems, Split
from lightprobe.scene.loading import read_folder
from tests.scene.worlds import expected_camera, views, write_colmap_model

STORED = ["images/a.png", "images/b.png", "images/c.png"]


def store(root: Path, stored=STORED) -> Path:
    """Write photos of 32 x 32, 33 x 33, ... pixels."""
    for number, name in enumerate(stored):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        Image.new("RGBA", (32 + number,) * 2, (9, 9, 9, 255)).save(root / name)
    return root


def write(root: Path, written, *, encoding="utf-8", **top) -> Path:
    pose = np.eye(4)
    frames = [{"file_path": name, "transform_matrix": pose.tolist()} for name in written]
    text = json.dumps({"camera_angle_x": 0.7, **top, "frames": frames}, ensure_ascii=False)
    (root / "transforms.json").write_text(text, encoding=encoding)
    return root


def sizes(root: Path) -> list[int]:
    """Return the widths of the photos that are read, in order."""
    return sorted(photo.camera.width for _, photo in read_folder(root, Problems()).all_photos())


def sentence(root: Path) -> str:
    with pytest.raises(InputError) as caught:
        read_folder(root, Problems())
    message = str(caught.value)
    assert "\n" not in message
    assert message.endswith(".")
    return message


WRITTEN = {
    "slashes": "images/{}.png",
    "dot": "./images/{}.png",
    "backslashes": "images\\{}.png",
    "dot and backslashes": ".\\images\\{}.png",
    "mixed": "images\\..\\images/{}.png",
    "without extension": "images\\{}",
    "capitals": "Images/{}.PNG",
    "the folder left out": "{}.png",
    "blanks around": " images/{}.png\n",
    "percent signs": "images%2F{}.png",
}
AWAY = {
    "drive": "C:\\Users\\Ann\\shoot 1\\images\\{}.png",
    "drive with slashes": "D:/shoot/images/{}.png",
    "drive and capitals": "D:/shoot/IMAGES/{}.Png",
    "server": "\\\\nas\\shoot\\images\\{}.png",
    "absolute": "/home/ann/shoot/images/{}.png",
    "absolute, flat": "/content/drive/MyDrive/{}.png",
    "address": "file:///home/ann/my%20shoot/images/{}.png",
    "address of a drive": "file:///C:/shoot/images/{}.png",
    "up and down again": "/home/ann/photos/../shoot/images/{}.png",
    "from another folder": "data/shoot/images/{}.png",
}


@pytest.mark.parametrize("kind", WRITTEN)
def test_spellings_of_a_path(tmp_path, kind):
    write(store(tmp_path / "scene"), [WRITTEN[kind].format(name) for name in "abc"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert sizes(tmp_path / "scene") == [32, 33, 34]


@pytest.mark.parametrize("kind", AWAY)
def test_paths_of_another_place_are_taken_by_their_end_and_said(tmp_path, kind):
    written = [AWAY[kind].format(name) for name in "abc"]
    write(store(tmp_path / "scene"), written)
    with pytest.warns(
        LightprobeWarning, match=r"names 3 paths of another place, such as '.*images/a\.png\.$"
    ):
        assert sizes(tmp_path / "scene") == [32, 33, 34]


def test_an_absolute_path_into_the_scene_is_no_other_place(tmp_path):
    root = store(tmp_path / "scene")
    write(root, [str(root / name) for name in STORED])
    (tmp_path / "link").symlink_to(root)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert sizes(root) == sizes(tmp_path / "link") == [32, 33, 34]


def test_two_folders_of_another_place_that_lie_in_one_here(tmp_path):
    """Both names end alike: neither is silently the other's photo."""
    write(store(tmp_path / "scene"), ["/x/left/a.png", "/x/right/a.png", "images/b.png"])
    with pytest.warns(LightprobeWarning):
        assert "images/a.png is named twice" in sentence(tmp_path / "scene")


@pytest.mark.parametrize("form", ["NFC", "NFD"])
def test_unicode_forms(tmp_path, form):
    stored = [f"Fotos/Gerät {name}ñ.png" for name in "abc"]
    other = {"NFC": "NFD", "NFD": "NFC"}[form]
    root = store(tmp_path / "scene", [unicodedata.normalize(form, name) for name in stored])
    write(root, [unicodedata.normalize(other, name) for name in stored])
    assert sizes(root) == [32, 33, 34]


def test_letter_case_that_two_photos_fit(tmp_path):
    root = store(tmp_path / "scene", ["images/a.png", "images/A.png", "images/b.png", "images/c.png"])
    assert sizes(write(root, ["images/a.png", "images/A.png", "images/b.png"])) == [32, 33, 34]
    assert sizes(write(root, ["IMAGES/A.png", "images/b.png", "images/c.png"])) == [33, 34, 35]
    said = "names 'images/a.PNG', which could be 'images/A.png' and 'images/a.png'; write one of them."
    assert said in sentence(write(root, ["images/b.png", "images/a.PNG"]))


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("images/a.jpg", "names the photo 'images/a.jpg', which does not exist; the folder holds 'a.png'."),
        ("images/B.jpeg", "does not exist; the folder holds 'b.png'."),
        ("pictures/a.png", "does not exist; there is no folder 'pictures'."),
        ("images/z.png", "names the photo 'images/z.png', which does not exist."),
        ("../a.png", "names '../a.png', which lies outside"),
        ("..\\..\\a.png", "which lies outside"),
        ("images\\..\\..\\a.png", "which lies outside"),
        ("/etc/hostname", "names '/etc/hostname', which lies outside"),
        ("C:\\Windows\\win.ini", "names 'C:\\Windows\\win.ini', which lies outside"),
        ("C:\\x\\..\\..\\win.ini", "which lies outside"),
        ("file:///etc/hostname", "names 'file:///etc/hostname', which lies outside"),
    ],
)
def test_what_is_not_found(tmp_path, written, said):
    store(tmp_path, ["a.png"])
    root = write(store(tmp_path / "scene"), ["images/b.png", "images/c.png", written])
    assert said in sentence(root)


def test_no_photo_at_all_is_one_sentence(tmp_path):
    root = write(store(tmp_path / "scene"), [f"frames/{number}.png" for number in range(9)])
    problems = Problems(collect=True)
    read_folder(root, problems)
    (problem,) = problems.messages
    assert (
        "names 9 photos, none of which exists, such as 'frames/0.png'; there is no folder 'frames';"
        in problem
    )


def test_a_name_without_extension_that_two_photos_fit(tmp_path):
    root = store(tmp_path / "scene")
    Image.new("RGB", (8, 8)).save(root / "images/a.jpg")
    said = "names the photo 'images/a' without an extension, and a.jpg and a.png are both there"
    assert said in sentence(write(root, ["images/b", "images/a"]))
    assert sizes(write(root, ["images/b", "images/a.png", "images/c"])) == [32, 33, 34]


def test_masks_and_truth_are_found_as_photos_are(tmp_path):
    root = store(tmp_path / "scene", [*STORED, "masks/a.png", "masks/B.png"])
    (root / "truth").mkdir()
    (root / "truth/env.exr").write_bytes(b"x")
    write(root, STORED)
    data = json.loads((root / "transforms.json").read_text())
    written = ("masks\\a.png", "D:\\shoot\\masks\\b.PNG", None)
    for frame, mask in zip(data["frames"], written, strict=True):
        frame |= {"mask_path": mask, "env_path": "Truth\\ENV.exr"}
    (root / "transforms.json").write_text(json.dumps(data))
    with pytest.warns(LightprobeWarning, match="a path of another place"):
        photos = sorted(
            (photo for _, photo in read_folder(root, Problems()).all_photos()), key=lambda p: p.name
        )
    masks = [photo.mask_path and photo.mask_path.name for photo in photos]
    assert masks == ["a.png", "B.png", None]
    assert {photo.truth.environment for photo in photos} == {root / "truth/env.exr"}
    data["frames"][2]["mask_path"] = "masks/a.jpg"
    (root / "transforms.json").write_text(json.dumps(data))
    assert "names the mask 'masks/a.jpg', which does not exist; the folder holds 'a.png'." in sentence(root)


def test_a_link_to_nothing_and_a_folder_in_place_of_a_photo(tmp_path):
    root = store(tmp_path / "scene")
    (root / "images/d.png").symlink_to(tmp_path / "gone/d.png")
    (root / "images/e.png").mkdir()
    said = sentence(write(root, ["images/a.png", "images/d.png"]))
    assert f"does not exist; it is a link to '{tmp_path}/gone/d.png', where no file is." in said
    assert "does not exist; it is a folder." in sentence(write(root, ["images/a.png", "images/e.png"]))


# Lists of photos


@pytest.mark.parametrize("frames", ["images/{}.png", "images\\{}.png", "./images/{}", AWAY["drive"]])
@pytest.mark.parametrize("listed", ["images/{}.png", "images\\{}.png", "./Images\\{}.PNG", AWAY["absolute"]])
@pytest.mark.parametrize("lists", [("test",), ("train", "test"), ("train", "val")])
@pytest.mark.filterwarnings("ignore:.*of another place")
def test_lists_know_photos_however_they_are_written(tmp_path, frames, listed, lists):
    chosen = {"train": "ab", "test": "c", "val": "c"}
    names = {f"{split}_filenames": [listed.format(name) for name in chosen[split]] for split in lists}
    root = write(store(tmp_path / "scene"), [frames.format(name) for name in "abc"], **names)
    photos = read_folder(root, Problems()).photos
    assert [len(photos[split]) for split in (Split.TRAIN, Split.TEST)] == [2, 1]
    assert photos[Split.TEST][0].camera.width == 34


def test_a_list_of_other_photos(tmp_path):
    root = write(store(tmp_path / "scene"), STORED, test_filenames=["images/x.png", "y.png"])
    said = (
        "no name in 'test_filenames', such as 'images/x.png', is the 'file_path' of a frame; correct the list"
    )
    assert said in sentence(root)
    write(root, STORED, test_filenames=["images/x.png", "images/c.png"])
    with pytest.warns(
        LightprobeWarning, match=r"1 of 2 names in 'test_filenames' are .*such as 'images/x\.png'"
    ):
        assert len(read_folder(root, Problems()).photos[Split.TEST]) == 1


# Byte order marks


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_encodings_of_json(tmp_path, encoding):
    names = [f"images/{name}ü.png" for name in "abc"]
    root = write(store(tmp_path / "scene", names), names, encoding=encoding)
    assert sizes(root) == [32, 33, 34]


def test_text_of_no_encoding(tmp_path):
    root = write(store(tmp_path / "scene"), ["images/ü.png"], encoding="latin-1")
    assert "transforms.json cannot be read as text" in sentence(root)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_encodings_of_colmap_text(tmp_path, encoding, end):
    root = store(tmp_path / "scene")
    shots = views(3, size=(32, 32))
    write_colmap_model(root, ["a.png", "b.png", "c.png"], shots, binary=False)
    for name in ("cameras.txt", "images.txt"):
        text = (root / name).read_text().split("\n", 1)[1]  # without the comment at its head
        (root / name).write_bytes(text.replace("\n", end).encode(encoding))
    photos = sorted(read_folder(root, Problems()).all_photos(), key=lambda photo: photo[1].name)
    for (_, photo), view in zip(photos, shots, strict=True):
        expected = expected_camera(view).camera_to_world
        np.testing.assert_allclose(photo.camera.camera_to_world, expected, atol=1e-12)


# Links


@pytest.mark.parametrize("kind", ["folder", "files", "scene", "one folder of two"])
def test_links_that_were_put_into_the_scene_are_followed(tmp_path, kind):
    root, disk = tmp_path / "scene", tmp_path / "disk"
    stored = [name.replace("images/", "images/left/") for name in STORED]
    store(disk, stored)
    root.mkdir()
    if kind == "folder":
        (root / "images").symlink_to(disk / "images")
    elif kind == "one folder of two":
        (root / "images").mkdir()
        (root / "images" / "left").symlink_to(disk / "images" / "left")
    elif kind == "files":
        (root / "images" / "left").mkdir(parents=True)
        for name in stored:
            (root / name).symlink_to(disk / name)
    else:
        root.rmdir()
        root.symlink_to(disk)
    write(root, stored)
    assert sizes(root) == [32, 33, 34]
    images = [photo.image_path for _, photo in read_folder(root, Problems()).all_photos()]
    assert all(path.is_relative_to(root.resolve()) for path in images)


def test_masks_may_be_links(tmp_path):
    root, disk = store(tmp_path / "scene"), store(tmp_path / "disk", ["a.png", "b.png", "c.png"])
    (root / "masks").symlink_to(disk)
    write(root, STORED)
    masks = {photo.mask_path for _, photo in read_folder(root, Problems()).all_photos()}
    assert masks == {root / "masks" / f"{name}.png" for name in "abc"}


def test_a_written_path_does_not_climb_out_through_a_link(tmp_path):
    """`link/..` is the folder beside the link's target for the system, and the scene for a reader."""
    root = store(tmp_path / "scene")
    store(tmp_path / "disk", ["deep/x.png", "secret.png"])
    (root / "link").symlink_to(tmp_path / "disk/deep")
    assert "link/../secret.png', which does not exist" in sentence(
        write(root, ["images/a.png", "images/b.png", "link/../secret.png"])
    )
    assert "lies outside" in sentence(write(root, ["images/a.png", "link/../../disk/secret.png"]))


# One photo's camera out of a file


def test_the_camera_of_a_photo_whose_path_has_backslashes(tmp_path):
    root = store(tmp_path / "scene")
    write(root, ["images\\a.png", "images\\b.png"], w=32, h=32)
    data = json.loads((root / "transforms.json").read_text())
    data["frames"][1] |= {"camera_angle_x": 0.4}
    (root / "transforms.json").write_text(json.dumps(data))
    found = read_camera(root / "transforms.json", root / "images" / "b.png")
    assert found.fx == pytest.approx(16 / np.tan(0.2))


def test_the_camera_of_a_photo_in_another_spelling(tmp_path):
    root = store(tmp_path / "scene", ["Ger\u00e4t.JPG.png", "b.png"])
    write(root, ["gera\u0308t.jpg.png", "b.png"], w=32, h=32)
    assert read_camera(root / "transforms.json", root / "Ger\u00e4t.JPG.png").width == 32


@pytest.mark.parametrize(
    ("written", "text"),
    [
        ("a\\b.png", "a/b.png"),
        ("file:///C:/a%20b.png", "C:/a b.png"),
        ("file:/x/a.png", "/x/a.png"),
        ("file://localhost/x/a.png", "/x/a.png"),
        ("100%25.png", "100%25.png"),
    ],
)
def test_slashed(written, text):
    assert slashed(written) == text


def test_a_backslash_may_belong_to_a_name(tmp_path):
    """Linux allows it; the file of the very name goes before the path."""
    root = store(tmp_path / "scene", ["a\\b.png", "a/b.png"])
    found = SceneFiles(root, root / "transforms.json").find("a\\b.png")
    assert found is not None
    assert Image.open(found).width == 32
