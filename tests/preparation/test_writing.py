"""What is written is a scene that loads: the photos as they are, cameras with their lenses, masks."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from lightprobe.core.errors import InputError
from lightprobe.core.files import checksum
from lightprobe.imaging import read_mask, read_orientation, write_mask
from lightprobe.preparation.mapping import bent, straightened
from lightprobe.preparation.photos import SourcePhoto
from lightprobe.preparation.undistortion import pinhole_camera, through_lens
from lightprobe.preparation.upright import rotation_to_z
from lightprobe.preparation.writing import (
    copy_photos,
    full_size,
    write_cells,
    write_masks,
    write_transforms,
)
from lightprobe.scene import load_scene
from lightprobe.scene.overlay import Cell
from tests.preparation.ring import SIZE, ball_points, photographed, ring_cameras

pytest.importorskip("cv2")


@pytest.mark.parametrize("k", [-0.2, -0.05, 0.0, 0.1])
def test_points_are_straightened_as_they_were_bent(k):
    camera = ring_cameras(1)[0]
    points = np.random.default_rng(0).uniform(0, 200, (50, 2))
    assert np.allclose(straightened(bent(points, camera, k), camera, k), points, atol=1e-6)
    corner = np.array([[0.0, 0.0]])
    radius = 100 * np.sqrt(2) / 300
    shift = 100 * np.sqrt(2) * k * radius**2
    assert np.linalg.norm(bent(corner, camera, k) - corner) == pytest.approx(abs(shift))


def test_a_turned_and_scaled_world_looks_the_same_to_its_cameras():
    _, _, solution = photographed(ring_cameras(3), ball_points(10))
    up = np.array([0.6, 0.0, 0.8])
    moved = solution.mapped(rotation_to_z(up, solution.pose), 2.5)
    for photo, camera in solution.cameras().items():
        before, after = camera.project(solution.points), moved.cameras()[photo].project(moved.points)
        assert np.allclose(before[:, :2], after[:, :2])
        assert np.allclose(2.5 * before[:, 2], after[:, 2])


def source(path: Path) -> SourcePhoto:
    rows, columns = np.mgrid[:SIZE, :SIZE]
    pixels = np.stack([rows, columns, 255 - rows], -1).astype(np.uint8)
    Image.fromarray(pixels).save(path, quality=95)
    return SourcePhoto(path.stem, path, SIZE, SIZE, checksum(path), None, None, False)


def test_photos_are_copied_byte_for_byte_and_no_later_change_reaches_them(tmp_path):
    photos = {name: source(tmp_path / f"{name}.jpg") for name in ("a", "b")}
    copied = []
    files = copy_photos(photos, tmp_path / "images", lambda: copied.append(1))
    assert files == {"a": "a.jpg", "b": "b.jpg"}
    assert len(copied) == 2
    before = (tmp_path / "a.jpg").read_bytes()
    assert (tmp_path / "images" / "a.jpg").read_bytes() == before
    with open(tmp_path / "a.jpg", "r+b") as file:  # as a program that edits in place does
        file.write(b"other bytes")
    (tmp_path / "b.jpg").unlink()
    assert (tmp_path / "images" / "a.jpg").read_bytes() == before
    assert (tmp_path / "images" / "b.jpg").is_file()


def test_a_photo_that_was_changed_meanwhile_is_one_sentence_and_leaves_nothing(tmp_path):
    photos = {name: source(tmp_path / f"{name}.jpg") for name in ("a", "b")}
    (tmp_path / "b.jpg").write_bytes(b"another file")
    with pytest.raises(InputError, match=r"b\.jpg was changed while the scene was prepared"):
        copy_photos(photos, tmp_path / "images")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.jpg", "b.jpg"]


def test_masks_are_told_of_before_they_take_the_place_of_others(tmp_path):
    own, told = tmp_path / "own.png", []
    write_mask(own, np.eye(4, dtype=np.float32))
    (tmp_path / "masks").mkdir()
    (tmp_path / "masks" / "old.png").touch()

    def written(new):
        told.extend(sorted(path.name for path in new.iterdir()))
        assert (tmp_path / "masks" / "old.png").exists()

    done = []
    write_masks(
        ["a"],
        lambda name: np.ones((4, 4), np.float32),
        {"b": own},
        tmp_path / "masks",
        written,
        lambda: done.append(1),
    )
    assert done == [1]
    assert told == sorted(path.name for path in (tmp_path / "masks").iterdir()) == ["a.png", "b.png"]
    assert (tmp_path / "masks" / "b.png").read_bytes() == own.read_bytes()


def test_a_mask_that_another_program_painted_says_that_it_is_upright(tmp_path):
    own = tmp_path / "own.png"
    Image.fromarray(np.eye(4, dtype=np.uint8) * 255).save(own)
    write_masks([], lambda name: np.zeros((0, 0)), {"b": own}, tmp_path / "masks")
    assert read_orientation(tmp_path / "masks" / "b.png") == 1
    np.testing.assert_array_equal(read_mask(tmp_path / "masks" / "b.png"), np.eye(4))


@pytest.mark.parametrize("k", [0.0, -0.15])
def test_the_scene_loads_with_its_cameras_and_lenses(tmp_path, k):
    cameras = {f"p{i}": camera for i, camera in enumerate(ring_cameras(8))}
    photos = {name: source(tmp_path / f"{name}.jpg") for name in cameras}
    scene = tmp_path / "scene"
    files = copy_photos(photos, scene / "images")
    rows, columns = np.mgrid[:SIZE, :SIZE]
    disc = ((rows - 100) ** 2 + (columns - 100) ** 2 < 60**2).astype(np.float32)
    write_masks(cameras, lambda name: disc, {}, scene / "masks")
    told = {name: through_lens(camera, k) for name, camera in cameras.items()}
    write_transforms(scene / "transforms.json", told, files, {}, {})
    loaded = load_scene(scene)
    for photo in (*loaded.train, *loaded.test):
        expected = pinhole_camera(cameras[photo.name], k, photo.name)
        assert np.allclose(photo.camera.camera_to_world, expected.camera_to_world)
        assert (photo.camera.fx, photo.camera.cx) == (pytest.approx(expected.fx), 100)
        assert (photo.camera.lens is None) == (k == 0)
        assert photo.camera.lens is None or photo.camera.lens.distort(np.eye(2)) == pytest.approx(
            expected.lens.distort(np.eye(2))
        )
    assert loaded.similarity.center == pytest.approx(np.zeros(3), abs=0.05)


def test_a_camera_of_a_small_picture_fits_its_photo(tmp_path):
    photo = SourcePhoto("a", tmp_path / "a.jpg", 500, 400, "", None, None, False)
    small = ring_cameras(1)[0].resized(250, 200)
    found = full_size(small, photo)
    assert (found.width, found.height, found.cx) == (500, 400, 250)
    assert found.fy == pytest.approx(2 * small.fx)


def test_the_sheet_has_a_cell_for_each_photo(tmp_path):
    cells = [Cell(f"p{i}", np.full((50, 80, 3), 200, np.uint8), (255, 255, 255)) for i in range(6)]
    write_cells(tmp_path / "s.png", cells)
    picture = np.asarray(Image.open(tmp_path / "s.png"))
    assert (picture == 200).all(-1).sum() >= 6 * 50 * 80
