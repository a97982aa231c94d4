"""Scenes of published data sets: cameras, lights and photos as the data sets' own formulas have them."""

import json
import shutil

import numpy as np
import pytest
import torch
from PIL import Image

from benchmarks import score
from benchmarks.__main__ import main
from lightprobe.imaging import read_hdr, read_photo, write_exr, write_radiance
from lightprobe.light import equirect
from lightprobe.scene import load_scene
from tests.shapes import camera_at

SIDE, FOCAL, EXPOSURE = 16, 22.0, -1.5
EYES = [(3.0, 0.5, 1.0), (-1.0, 2.5, 1.5), (0.5, -3.0, 0.8)]
POINTS = np.array([[0.1, -0.2, 0.3], [-0.25, 0.15, 0.05]])
ROW, COLUMN = 2, 5  # of the lamp in a map of 8 x 16
ANGLE = 2 * np.arctan(SIDE / 2 / FOCAL)


def write_picture(path, value: int = 128) -> None:
    """Write a photo with a white corner."""
    pixels = np.full((SIDE, SIDE, 3), value, np.uint8)
    pixels[0, 0] = 255
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path)


def write_mask(path, left: int) -> None:
    pixels = np.zeros((SIDE, SIDE), np.uint8)
    pixels[5:11, left : left + 5] = 255
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path)


def lamp() -> np.ndarray:
    radiance = np.full((8, 16, 3), 0.25, np.float32)
    radiance[ROW, COLUMN] = [64, 32, 16]
    return radiance


def owl_camera(eye) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return K, R and t of a camera that looks at the origin, x right, y down, z ahead."""
    ahead = -np.array(eye) / np.linalg.norm(eye)
    right = np.cross(ahead, [0, 0, 1])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(ahead, right), ahead])
    return (
        np.array([[FOCAL, 0, 7.5], [0, FOCAL + 1, 8.5], [0, 0, 1]]),
        rotation,
        -rotation @ np.array(eye),
    )


@pytest.fixture
def owl(tmp_path):
    """A folder of Objects With Lighting: three photos to learn from, one of another light."""
    folder = tmp_path / "dataset" / "cup" / "test"
    for k, eye in enumerate([*EYES, (2.0, 2.0, 1.0)]):
        place, start, number = (folder / "inputs", "", k) if k < 3 else (folder, "gt_", 0)
        write_picture(place / f"{start}image_{number:04}.png")
        write_mask(place / f"{start}mask_{number:04}.png", 3 + k)
        matrix, rotation, shift = owl_camera(eye)
        rows = np.concatenate([matrix, rotation, shift[None], [[SIDE, SIDE, 3]]])
        np.savetxt(place / f"{start}camera_{number:04}.txt", rows)
    (folder / "gt_exposure_0000.txt").write_text(f"{EXPOSURE}\n")
    write_radiance(folder / "gt_env_512_rotated_0000.hdr", lamp())
    return folder


@pytest.fixture
def orb(tmp_path):
    """The photos of Stanford-ORB of one object in two places: three to learn from, one test photo in each."""
    data = tmp_path / "data"

    def frame(place: str, path: str, eye, left: int) -> dict:
        split, number = path.split("/")
        write_picture(data / "blender_LDR" / place / f"{path}.png")
        write_mask(data / "blender_LDR" / place / f"{split}_mask" / f"{number}.png", left)
        if split == "test":
            light = data / "ground_truth" / place / "env_map" / f"{number}.exr"
            light.parent.mkdir(parents=True)
            write_exr(light, lamp())
        return {"file_path": path, "transform_matrix": camera_at(eye).camera_to_world.tolist()}

    frames = {
        "train": [frame("cup_scene001", f"train/{k:04}", eye, 3 + k) for k, eye in enumerate(EYES)],
        "test": [frame("cup_scene001", "test/0007", (2.0, 2.0, 1.0), 6)],
        "novel": [frame("cup_scene002", "test/0007", (-2.0, 1.0, 2.0), 7)],
    }
    frames["novel"][0] |= {"scene_name": "cup_scene002", "camera_angle_x": ANGLE / 2}
    for split, found in frames.items():
        value = {"frames": found} | ({} if split == "novel" else {"camera_angle_x": ANGLE})
        (data / "blender_LDR" / "cup_scene001" / f"transforms_{split}.json").write_text(json.dumps(value))
    return data / "blender_LDR" / "cup_scene001"


def adapted(layout: str, folder, tmp_path):
    scene = tmp_path / "scene"
    assert main(["adapt", layout, str(folder), str(scene)]) == 0
    return scene


def middle_of_light(radiance: np.ndarray) -> np.ndarray:
    """Return the direction (3,) of a lamp in lightprobe's layout, which may have been spread over texels."""
    height = len(radiance)
    weight = (radiance.sum(axis=2) - radiance.sum(axis=2).min()) * equirect.solid_angles(height).numpy()
    middle = (weight[..., None] * equirect.directions(height).numpy()).sum(axis=(0, 1))
    return middle / np.linalg.norm(middle)


def test_owl_cameras_see_points_where_its_own_formula_does(owl, tmp_path):
    scene = load_scene(adapted("owl", owl, tmp_path))
    photos = [*scene.train, *scene.test]
    assert [photo.name for photo in photos] == ["image_0000", "image_0001", "image_0002", "gt_image_0000"]
    for photo, eye in zip(photos, [*EYES, (2.0, 2.0, 1.0)], strict=True):
        matrix, rotation, shift = owl_camera(eye)
        expected = (POINTS @ rotation.T + shift) @ matrix.T
        found = photo.camera.project(POINTS)
        np.testing.assert_allclose(found[:, :2], expected[:, :2] / expected[:, 2:], atol=1e-9)
        assert (found[:, 2] > 0).all()


def test_owl_light_lies_where_its_own_formula_says_in_the_photos_exposure(owl, tmp_path):
    (photo,) = load_scene(adapted("owl", owl, tmp_path)).test
    u, v = (COLUMN + 0.5) / 16, (ROW + 0.5) / 8
    theta, phi = (0.5 - u) * 2 * np.pi, (v - 0.5) * np.pi
    towards = [np.cos(phi) * np.cos(theta), np.cos(phi) * np.sin(theta), -np.sin(phi)]
    light = torch.from_numpy(read_hdr(photo.truth.environment))
    seen = equirect.sample(light, torch.tensor([towards]))[0]
    np.testing.assert_allclose(seen, np.array([64, 32, 16]) * 2**EXPOSURE, rtol=0.01)


def test_owl_photos_are_linear_by_its_gamma_and_white_stays_white(owl, tmp_path):
    scene = adapted("owl", owl, tmp_path)
    for path in (scene / "train" / "image_0001.png", scene / "test" / "gt_image_0000.png"):
        color, _, white = read_photo(path)
        np.testing.assert_allclose(color[1:, 1:], (128 / 255) ** 2.2, rtol=1e-3)
        assert white[0, 0].all()
        assert not white[1:, 1:].any()


def test_orb_cameras_see_points_where_its_own_formula_does(orb, tmp_path):
    scene = load_scene(adapted("orb", orb, tmp_path))
    photos = {photo.name: photo for photo in (*scene.train, *scene.test)}
    eyes = {f"train_{k:04}": eye for k, eye in enumerate(EYES)}
    eyes |= {"test_0007": (2.0, 2.0, 1.0), "cup_scene002_0007": (-2.0, 1.0, 2.0)}
    assert photos.keys() == eyes.keys()
    for name, eye in eyes.items():
        angle = ANGLE / 2 if name.startswith("cup") else ANGLE
        focal = 0.5 * SIDE / np.tan(0.5 * angle)
        local = np.c_[POINTS, np.ones(2)] @ np.linalg.inv(camera_at(eye).camera_to_world).T
        expected = SIDE / 2 + focal * local[:, :2] / -local[:, 2:3] * [1, -1]
        np.testing.assert_allclose(photos[name].camera.project(POINTS)[:, :2], expected, atol=1e-9)


def test_orb_light_is_turned_from_the_camera_into_the_world(orb, tmp_path):
    photos = {photo.name: photo for photo in load_scene(adapted("orb", orb, tmp_path)).test}
    theta, phi = 2 * np.pi * (COLUMN + 0.5) / 16 - np.pi / 2, np.pi * (ROW + 0.5) / 8
    local = np.array([-np.cos(theta) * np.sin(phi), np.cos(phi), -np.sin(theta) * np.sin(phi)])
    assert local[0] < 0 < local[1]  # left of the middle, and above it,
    assert local[2] < 0  # is ahead of the camera, to its left and above
    for name, eye in (("test_0007", (2.0, 2.0, 1.0)), ("cup_scene002_0007", (-2.0, 1.0, 2.0))):
        towards = camera_at(eye).camera_to_world[:3, :3] @ local
        light = read_hdr(photos[name].truth.environment)
        assert light.shape == (8, 16, 3)
        assert middle_of_light(light) @ towards > np.cos(np.radians(4))
        power = (equirect.solid_angles(8).numpy()[..., None] * np.stack([light, lamp()])).sum(axis=(1, 2, 3))
        assert power[0] == pytest.approx(power[1], rel=0.2)


def test_orb_photos_of_blender_hdr_are_taken_as_they_are(orb, tmp_path):
    for photo in orb.parent.glob("*/t*/*.png"):
        if not photo.parent.name.endswith("_mask"):
            write_exr(photo.with_suffix(".exr"), np.full((SIDE, SIDE, 3), 3.5, np.float32))
            photo.unlink()
    scene = load_scene(adapted("orb", orb, tmp_path))
    assert {photo.image_path.suffix for photo in (*scene.train, *scene.test)} == {".exr"}
    assert (read_photo(scene.train[0].image_path)[0] == 3.5).all()


@pytest.mark.parametrize("layout", ["owl", "orb"])
def test_masks_arrive_with_their_photos_and_training_photos_share_a_light(layout, request, tmp_path):
    folder = request.getfixturevalue(layout)
    scene = adapted(layout, folder, tmp_path)
    for split, lit in (("train", False), ("test", True)):
        frames = json.loads((scene / f"transforms_{split}.json").read_text())["frames"]
        for frame in frames:
            assert ("env_path" in frame) is lit
            assert ("light_group" in frame) is not lit
    lefts = [np.nonzero(np.asarray(Image.open(p.mask_path)))[1].min() for p in load_scene(scene).train]
    assert lefts == [3, 4, 5]
    for photo in load_scene(scene).train:
        assert photo.light_group == "training"


@pytest.mark.parametrize("layout", ["owl", "orb"])
def test_the_scorer_finds_the_lights_of_the_scene(layout, request, tmp_path, capsys):
    scene = adapted(layout, request.getfixturevalue(layout), tmp_path)
    assert main(["score", str(scene), str(scene / "light")]) == 0
    photos = score.true_photos(scene)
    assert f"| scene | {len(photos)} | 0.000 | 0.000 |" in capsys.readouterr().out
    assert {photo.name for photo in photos} == {photo.name for photo in load_scene(scene).test}


def test_photos_without_mask_map_or_folder_are_left_out_or_unlit(owl, orb, tmp_path, capsys):
    (owl / "gt_mask_0000.png").unlink()
    assert main(["adapt", "owl", str(owl), str(tmp_path / "a")]) == 0
    printed = capsys.readouterr()
    assert printed.out.endswith("3 training and 0 test photos, 0 with their true light\n")
    assert "gt_image_0000.png is left out: gt_mask_0000.png does not exist." in printed.err
    lights = orb.parents[1] / "ground_truth" / orb.name / "env_map"
    write_exr(lights / "0007.exr", np.full((8, 16, 3), np.nan, np.float32))
    shutil.rmtree(orb.with_name("cup_scene002"))
    assert main(["adapt", "orb", str(orb), str(tmp_path / "b")]) == 0
    printed = capsys.readouterr()
    assert printed.out.endswith("3 training and 1 test photos, 0 with their true light\n")
    assert "0007.exr holds NaN" in printed.err
    assert "Without test photos of cup_scene002" in printed.err


def edited(path, change) -> None:
    value = json.loads(path.read_text())
    change(value)
    path.write_text(json.dumps(value))


OWL_FAULTS = {
    "inputs/mask_0001.png does not exist": lambda f: (f / "inputs" / "mask_0001.png").unlink(),
    "inputs/camera_0001.txt does not exist": lambda f: (f / "inputs" / "camera_0001.txt").unlink(),
    "gt_env_512_rotated_0000.hdr does not exist": lambda f: (f / "gt_env_512_rotated_0000.hdr").unlink(),
    "gt_exposure_0000.txt must hold 1 finite number": lambda f: (f / "gt_exposure_0000.txt").write_text(
        "nan"
    ),
    "holds an exposure of 1e+06 stops": lambda f: (f / "gt_exposure_0000.txt").write_text("1e6"),
    "camera_0000.txt must hold 24 finite numbers": lambda f: (f / "gt_camera_0000.txt").write_bytes(b"\xff1"),
    "is not a rotation": lambda f: np.savetxt(f / "gt_camera_0000.txt", np.eye(8, 3) + np.eye(8, 3, -3) * 2),
    "skewed pixels": lambda f: np.savetxt(f / "gt_camera_0000.txt", np.ones((8, 3))),
    "is no map of a sphere": lambda f: write_radiance(f / "gt_env_512_rotated_0000.hdr", lamp()[:6]),
    "holds no training photos in the layout owl": lambda f: shutil.rmtree(f / "inputs"),
}
ORB_FAULTS = {
    "transforms_train.json does not exist": lambda f: (f / "transforms_train.json").unlink(),
    "train_mask/0001.png does not exist": lambda f: (f / "train_mask" / "0001.png").unlink(),
    "names a photo that is neither": lambda f: (f / "train" / "0001.png").unlink(),
    "ground_truth beside its photos": lambda f: shutil.rmtree(f.parents[1] / "ground_truth"),
    "has no list of 'frames'": lambda f: (f / "transforms_train.json").write_text('{"frames": [3]}'),
    "which lies outside": lambda f: edited(
        f / "transforms_train.json", lambda v: v["frames"][0].update(file_path="../cup_scene002/test/0007")
    ),
    "it must be a plain name": lambda f: edited(
        f / "transforms_novel.json", lambda v: v["frames"][0].update(scene_name="../blender_LDR")
    ),
    "'transform_matrix'": lambda f: edited(
        f / "transforms_test.json", lambda v: v["frames"][0].pop("transform_matrix")
    ),
    "no focal length": lambda f: edited(f / "transforms_test.json", lambda v: v.pop("camera_angle_x")),
    "is named twice": lambda f: edited(
        f / "transforms_test.json", lambda v: v["frames"].append(v["frames"][0])
    ),
}


@pytest.mark.parametrize(
    ("layout", "sentence"), [("owl", each) for each in OWL_FAULTS] + [("orb", each) for each in ORB_FAULTS]
)
def test_a_damaged_folder_gets_one_sentence_and_leaves_nothing(layout, sentence, request, tmp_path, capsys):
    folder = request.getfixturevalue(layout)
    {"owl": OWL_FAULTS, "orb": ORB_FAULTS}[layout][sentence](folder)
    before = sorted(tmp_path.iterdir())
    assert main(["adapt", layout, str(folder), str(tmp_path / "scene")]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert said.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before


def test_a_folder_that_is_there_is_not_replaced(owl, tmp_path, capsys):
    assert main(["adapt", "owl", str(owl), str(owl)]) == 3
    assert capsys.readouterr().err == f"{owl} is there already; name a new folder.\n"
    assert (owl / "gt_image_0000.png").is_file()
