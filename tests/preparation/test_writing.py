"""What is written is a scene that loads: straightened photos with their exposure, cameras, masks."""

import io
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image

from lightprobe.imaging import (
    read_exif_ev100,
    read_ldr,
    read_mask,
    read_orientation,
    srgb_encode,
    write_exr,
    write_mask,
)
from lightprobe.preparation import writing
from lightprobe.preparation.labelled import enlarged
from lightprobe.preparation.mapping import bent, straightened
from lightprobe.preparation.photos import SourcePhoto
from lightprobe.preparation.upright import rotation_to_z
from lightprobe.preparation.writing import (
    bend_map,
    full_size,
    largest_bend,
    straight,
    write_cells,
    write_images,
    write_masks,
    write_transforms,
)
from lightprobe.scene import load_scene
from lightprobe.scene.overlay import Cell
from tests.preparation.ring import SIZE, ball_points, photographed, ring_cameras

pytest.importorskip("cv2")


@pytest.mark.parametrize("k", [-0.2, -0.05, 0.0, 0.1])
def test_straightening_undoes_the_lens(k):
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
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0x829A: 0.01, 0x829D: 4.0, 0x8827: 100})
    rows, columns = np.mgrid[:SIZE, :SIZE]
    pixels = np.stack([rows, columns, 255 - rows], -1).astype(np.uint8)
    Image.fromarray(pixels).save(path, quality=95, exif=exif)
    return SourcePhoto(path.stem, path, SIZE, SIZE, "", None, None, False)


def test_straightening_moves_every_pixel_to_where_a_pinhole_shows_it():
    camera, k = ring_cameras(1)[0], 0.15
    rows, columns = np.mgrid[:SIZE, :SIZE] + 0.5
    picture = np.stack([columns, rows, rows], -1).astype(np.float32)
    found = straight(picture, camera, k)
    wanted = bent(np.array([[60.5, 90.5]]), camera, k)[0]
    assert found[90, 60, :2] == pytest.approx(wanted, abs=0.05)
    assert largest_bend(camera, k) > 3
    assert bend_map(camera, 0.0, 0, camera.height)[0][5, 7] == pytest.approx(7)
    assert straight(picture, camera, 1e-4) is picture


@pytest.mark.parametrize("channels", [None, 3])
def test_strips_of_rows_are_straightened_as_the_whole_is(monkeypatch, channels):
    camera, k = ring_cameras(1)[0], -0.2
    picture = np.random.default_rng(3).random(
        (SIZE, SIZE) if channels is None else (SIZE, SIZE, channels), np.float32
    )
    whole = straight(picture, camera, k)
    monkeypatch.setattr(writing, "STRIP", 7 * SIZE)
    np.testing.assert_array_equal(straight(picture, camera, k), whole)
    assert np.abs(whole - picture).max() > 0.5


def test_straight_photos_are_copied_and_bent_ones_keep_their_exposure(tmp_path):
    camera = ring_cameras(1)[0]
    photos = {name: source(tmp_path / f"{name}.jpg") for name in ("a", "b")}
    files = write_images(
        {"a": (photos["a"], camera, 0.0), "b": (photos["b"], camera, -0.2)}, tmp_path / "images"
    )
    assert files == {"a": "a.jpg", "b": "b.png"}
    assert (tmp_path / "images" / "a.jpg").read_bytes() == (tmp_path / "a.jpg").read_bytes()
    assert read_exif_ev100(tmp_path / "images" / "b.png") == pytest.approx(
        read_exif_ev100(tmp_path / "a.jpg")
    )
    one, other = (read_ldr(tmp_path / "images" / files[name])[0] for name in ("a", "b"))
    assert np.abs(one - other)[100, 100].max() < 0.02
    assert np.abs(one - other)[10, 10].max() > 0.001


def test_a_bent_photo_is_written_whatever_else_its_file_tells(tmp_path):
    camera, path = ring_cameras(1)[0], tmp_path / "a.tif"
    photo = source(tmp_path / "b.jpg")
    with Image.open(photo.path) as picture:
        exif = picture.getexif()
        exif[0x8769], exif[0x8825] = exif.get_ifd(0x8769), {1: "N", 2: (52.0, 30.0, 0.0)}
        picture.save(path, exif=exif)
    (file,) = write_images({"a": (replace(photo, path=path), camera, -0.2)}, tmp_path / "images").values()
    with Image.open(tmp_path / "images" / file) as written:
        assert not written.getexif().get_ifd(0x8825)
    assert read_exif_ev100(tmp_path / "images" / file) == pytest.approx(read_exif_ev100(photo.path))


def test_a_bent_photo_that_shows_more_than_white_keeps_it(tmp_path):
    """Code 148 of 255 of PQ is reference white (BT.2408), the greatest 49 times as bright."""
    camera, path = ring_cameras(1)[0], tmp_path / "a.png"
    buffer, points = io.BytesIO(), bytes((9, 16, 0, 1))
    Image.fromarray(np.full((SIZE, SIZE, 3), 200, np.uint8)).save(buffer, "PNG")
    chunk = struct.pack(">I", 4) + b"cICP" + points + struct.pack(">I", zlib.crc32(b"cICP" + points))
    path.write_bytes(buffer.getvalue()[:33] + chunk + buffer.getvalue()[33:])
    photo = replace(source(tmp_path / "b.jpg"), path=path)
    (file,) = write_images({"a": (photo, camera, -0.2)}, tmp_path / "images").values()
    middle = (SIZE // 2, SIZE // 2)
    assert read_ldr(path)[0][middle].min() > 2
    np.testing.assert_allclose(
        read_ldr(tmp_path / "images" / file)[0][middle], read_ldr(path)[0][middle], rtol=0.01
    )


@pytest.mark.parametrize("suffix", ["exr", "tif"])
def test_bent_photos_stay_as_fine_as_they_are(tmp_path, suffix):
    camera = ring_cameras(1)[0]
    ramp = np.linspace(0.2, 4.0 if suffix == "exr" else 0.201, SIZE)  # of 8 bits, .001 is less than a step
    light = np.broadcast_to(ramp[None, :, None], (SIZE, SIZE, 3)).astype(np.float32)
    path = tmp_path / f"a.{suffix}"
    if suffix == "exr":
        write_exr(path, light)
    else:
        codes = np.rint(65535 * srgb_encode(light)).astype(np.uint16)
        tifffile.imwrite(path, codes, photometric="rgb", extratags=[(0x0112, "H", 1, 1, True)])
    photo = replace(source(tmp_path / "b.jpg"), path=path)
    (file,) = write_images({"a": (photo, camera, -0.2)}, tmp_path / "images").values()
    assert file == ("a.exr" if suffix == "exr" else "a.png")
    written = read_ldr(tmp_path / "images" / file)[0]
    middle = written[SIZE // 2, SIZE // 4 : -SIZE // 4, 0]
    assert len(np.unique(middle)) > 20
    assert written.max() == pytest.approx(float(light.max()), rel=0.02)
    if suffix == "tif":
        assert read_orientation(tmp_path / "images" / file) == 1


def test_masks_are_told_of_before_they_take_the_place_of_others(tmp_path):
    own, told = tmp_path / "own.png", []
    write_mask(own, np.eye(4, dtype=np.float32))
    (tmp_path / "masks").mkdir()
    (tmp_path / "masks" / "old.png").touch()

    def written(new):
        told.extend(sorted(path.name for path in new.iterdir()))
        assert (tmp_path / "masks" / "old.png").exists()

    write_masks([("a", np.ones((4, 4), np.float32))], {"b": own}, tmp_path / "masks", written)
    assert told == sorted(path.name for path in (tmp_path / "masks").iterdir()) == ["a.png", "b.png"]
    assert (tmp_path / "masks" / "b.png").read_bytes() == own.read_bytes()


def test_a_mask_that_another_program_painted_says_that_it_is_upright(tmp_path):
    own = tmp_path / "own.png"
    Image.fromarray(np.eye(4, dtype=np.uint8) * 255).save(own)
    write_masks([], {"b": own}, tmp_path / "masks")
    assert read_orientation(tmp_path / "masks" / "b.png") == 1
    np.testing.assert_array_equal(read_mask(tmp_path / "masks" / "b.png"), np.eye(4))


def test_the_scene_loads_with_its_cameras(tmp_path):
    cameras = {f"p{i}": camera for i, camera in enumerate(ring_cameras(8))}
    photos = {name: (source(tmp_path / f"{name}.jpg"), camera, 0.0) for name, camera in cameras.items()}
    scene = tmp_path / "scene"
    files = write_images(photos, scene / "images")
    rows, columns = np.mgrid[:SIZE, :SIZE]
    disc = ((rows - 100) ** 2 + (columns - 100) ** 2 < 60**2).astype(np.float32)
    write_masks(((name, disc) for name in cameras), {}, scene / "masks")
    write_transforms(scene / "transforms.json", cameras, files, {}, {})
    loaded = load_scene(scene)
    for photo in (*loaded.train, *loaded.test):
        assert np.allclose(photo.camera.camera_to_world, cameras[photo.name].camera_to_world)
        assert (photo.camera.fx, photo.camera.cx) == (300, 100)
    assert loaded.similarity.center == pytest.approx(np.zeros(3), abs=0.05)


def test_a_camera_of_a_small_picture_fits_its_photo(tmp_path):
    photo = SourcePhoto("a", tmp_path / "a.jpg", 500, 400, "", None, None, False)
    small = ring_cameras(1)[0].resized(250, 200)
    found = full_size(small, photo)
    assert (found.width, found.height, found.cx) == (500, 400, 250)
    assert found.fy == pytest.approx(2 * small.fx)


def test_a_small_mask_grows_in_place():
    mask = np.zeros((40, 40), np.float32)
    mask[10:30, 5:20] = 1
    large = enlarged(mask, 160, 160)
    assert large.shape == (160, 160)
    assert ((large >= 0.5) != (np.kron(mask, np.ones((4, 4))) >= 0.5)).mean() < 0.003
    assert large.max() == 1


def test_the_sheet_has_a_cell_for_each_photo(tmp_path):
    cells = [Cell(f"p{i}", np.full((50, 80, 3), 200, np.uint8), (255, 255, 255)) for i in range(6)]
    write_cells(tmp_path / "s.png", cells)
    picture = np.asarray(Image.open(tmp_path / "s.png"))
    assert (picture == 200).all(-1).sum() >= 6 * 50 * 80
