"""Simulated shoots: shapes and textures, the telephone's lens, light against pictures, and a whole tiny shoot."""

import json
import subprocess
import sys
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.stats import spearmanr

from benchmarks.__main__ import main
from benchmarks.shoot import cameras, materials, models, objects, shapes
from benchmarks.shoot.telephone import Telephone
from demo_scene.files import read_exr, read_obj, read_png, srgb_decode
from demo_scene.lights import directions, reduce_area
from demo_scene.textures import Material
from lightprobe.scene import load_scene

ROOT = Path(__file__).parents[2]
CURVE = np.stack(
    [np.cos(np.linspace(0, 3, 30)), np.sin(np.linspace(0, 3, 30)), np.linspace(0, 1, 30)], axis=1
)
SOLIDS = {  # with their volumes
    "box": (shapes.rounded_box((1.0, 0.5, 0.3), 0.01), 1.2),
    "ellipsoid": (shapes.superquadric((1.0, 0.7, 0.5), 1.0), 4 / 3 * np.pi * 0.35),
    "cylinder": (shapes.turned((0, 0), (0.8, 0), (0.8, 0.5), (0, 0.5)), np.pi * 0.32),
    "tube": (shapes.tube(CURVE, 0.1, segments=32), np.pi * 0.01 * np.hypot(3, 1)),
}


def run(*words: object) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "benchmarks", "shoot", *map(str, words)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)


@pytest.fixture(scope="module")
def tiny(path_tracer, tmp_path_factory):
    folder = tmp_path_factory.mktemp("shoot") / "radio"
    made = run("radio", folder, "--tiny")
    assert made.returncode == 0, made.stderr
    assert made.stdout.splitlines()[-1].startswith("14 of 14 photos: IMG_1014")
    return folder


@pytest.mark.parametrize("name", SOLIDS)
def test_a_solid_faces_outwards_and_has_its_volume(name):
    shape, expected = SOLIDS[name]
    volume = 0.0
    for vertices, normals, faces in map(shapes.group_mesh, shape):
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        volume += np.einsum("ij,ij->", a, np.cross(b, c)) / 6
        assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), normals[faces].sum(axis=1)) > 0).all()
    assert volume == pytest.approx(expected, rel=0.04)


def test_a_disc_faces_up_and_covers_its_circle():
    vertices, normals, faces = shapes.group_mesh(shapes.disc(2.0)[0])
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    assert np.cross(b - a, c - a)[:, 2].sum() / 2 == pytest.approx(4 * np.pi, rel=0.01)
    assert np.allclose(normals, [0, 0, 1])


def test_the_atlas_shows_at_every_vertex_what_is_painted_there():
    def paint(points):
        return Material(0.5 + points / 4, 0.5 + points[..., 0] / 4, 0.5 + points[..., 1] / 4)

    parts = [models.Part(shape, paint, models.pose_of((3, 2, 1), 0.7)) for shape, _ in SOLIDS.values()]
    model = models.textured(parts, 1024)
    column, row = (model.uv * 1024 - 0.5).round().astype(int).T
    local = np.concatenate([grid.reshape(-1, 3) for p in parts for group in p.shape for grid in group])
    np.testing.assert_allclose(model.material.base[row, column], 0.5 + local / 4, atol=0.01)
    np.testing.assert_allclose(model.material.metallic[row, column], 0.5 + local[:, 1] / 4, atol=0.01)


def test_rays_are_those_of_opencvs_lens():
    telephone = Telephone(64, 48, 26, -0.06, 0.2, 0.01)
    pose = cameras.look_from(np.array([2.0, -1.0, 1.5]), np.zeros(3), 0.3)
    offset = np.full((64 * 48, 2), 0.25)
    local = telephone.rays(pose, offset) @ pose[:3, :3]
    x, y = local[:, 0] / -local[:, 2], -local[:, 1] / -local[:, 2]
    bend = 1 + telephone.k1 * (x * x + y * y)
    pixel = np.stack([telephone.focal * x * bend + 32, telephone.focal * y * bend + 24], axis=1)
    rows, columns = np.mgrid[:48, :64]
    np.testing.assert_allclose(pixel, np.stack([columns.ravel(), rows.ravel()], axis=1) + 0.25, atol=1e-6)


@pytest.mark.parametrize("name", objects.OBJECTS)
def test_the_object_fills_a_quarter_to_three_fifths_of_the_picture(name):
    points = models.corners(objects.make_object(name, 5))
    assert np.linalg.norm(points, axis=1).max() == pytest.approx(1.0)
    poses = cameras.hand_held(points, 700.0, 600, 12, np.random.default_rng(0))
    for pose in poses:
        local = (points - pose[:3, 3]) @ pose[:3, :3]
        assert 0.25 <= np.ptp(700 * local[:, :2] / -local[:, 2:], axis=0).max() / 600 <= 0.6
        assert pose[2, 3] > points[:, 2].min() + 0.3  # above the table
    azimuth = np.unwrap([np.arctan2(pose[1, 3], pose[0, 3]) for pose in poses])
    assert np.degrees(np.diff(azimuth)) == pytest.approx(30, abs=13)


def test_equal_seeds_paint_equally_and_others_do_not():
    points = np.random.default_rng(0).normal(size=(50, 3))
    for kind in materials.Kind:
        first, again, other = (materials.patterned(kind, np.random.default_rng(s))(points) for s in (1, 1, 2))
        assert np.array_equal(first.base, again.base)
        assert not np.array_equal(first.base, other.base)
        assert (first.metallic.max() > 0) == (kind in (materials.Kind.METAL, materials.Kind.CHROME))


@pytest.mark.slow
def test_light_lies_where_photos_see_it(path_tracer):
    import mitsuba as mi

    from benchmarks.shoot.tracing import Tracer, panorama, quad_lamp, sky_lamp

    with mi.scoped_set_variant("llvm_ad_rgb"):
        sky = 1.0 + directions(64) * [0.9, 0.7, 0.5]  # its colour tells the direction
        facing = np.array([0.6, 0.0, 0.8])
        pose = cameras.look_from(3 * facing, np.zeros(3), 0.0)  # a window whose +z looks back at the origin
        pose[:3, 2] *= -1
        pose[:3, 0] *= -1
        picture = np.zeros((4, 4, 3))
        picture[:2] = [50.0, 0.0, 0.0]  # its upper half glows red, its lower half is dark
        tracer = Tracer({"sky": sky_lamp(sky), "window": quad_lamp(pose, picture)})
        light = reduce_area(panorama(tracer, 128, 16, np.random.default_rng(0)), 2)
        towards = Telephone(32, 24, 26, 0.0, 0.0, 0.0).rays(pose, np.full((768, 2), 0.5))
        seen = tracer.radiance(np.zeros(3), towards, np.random.default_rng(0))
    away = directions(64) @ facing < 0.85  # the window is not there
    np.testing.assert_allclose(light[away], sky[away], atol=0.03)
    elsewhere = towards @ facing < 0.85
    np.testing.assert_allclose(seen[elsewhere], 1 + towards[elsewhere] * [0.9, 0.7, 0.5], atol=0.03)
    red = light[..., 0] > 40
    assert red.any()
    assert (directions(64)[red] @ np.array([-0.8, 0.0, 0.6]) > 0).all()  # above the window's middle


@pytest.mark.slow
def test_a_shoot_has_the_files_of_its_photos(tiny):
    record = json.loads((tiny / "shoot.json").read_text())
    names = [frame["name"] for frame in record["frames"]]
    assert [frame["split"] for frame in record["frames"]] == ["train"] * 12 + ["test"] * 2
    assert (
        {path.stem for path in (tiny / "masks").iterdir()}
        == set(names)
        == {f"IMG_{k}" for k in range(1001, 1015)}
    )
    assert len(set(record["places"])) == 3
    taken = []
    for frame in record["frames"]:
        with Image.open(tiny / frame["split"] / f"{frame['name']}.jpg") as photo:
            assert photo.size == (200, 150)
            exif = photo.getexif().get_ifd(0x8769)
        assert exif[0xA405] / 43.27 * 250 == pytest.approx(record["fl_x"])
        taken.append(datetime.strptime(exif[0x9003], "%Y:%m:%d %H:%M:%S"))
        light = read_exr(tiny / "light" / f"{frame['place']}.exr", "RGB")
        assert light.shape == (128, 256, 3)
        assert min(frame["gain"]) > 0
        assert light.min() >= 0
    minutes = [(b - a).total_seconds() / 60 for a, b in pairwise(taken)]
    assert minutes == [1] * 5 + [55] + [1] * 5 + [55] + [1]
    scene = load_scene(tiny)
    assert (len(scene.train), len(scene.test)) == (12, 2)


@pytest.mark.slow
def test_masks_show_the_mesh_where_the_cameras_say_and_the_object_stands(tiny):
    record = json.loads((tiny / "shoot.json").read_text())
    vertices, _ = read_obj(tiny / "mesh.obj")
    outside = []  # pixels by which a mask reaches beyond the mesh, on its four sides
    for place in record["places"].values():
        assert place["support"]["height"] == pytest.approx(vertices[:, 2].min(), abs=2e-4)
    for frame in record["frames"]:
        pose = np.array(frame["transform_matrix"])
        local = (vertices - pose[:3, 3]) @ pose[:3, :3]
        seen = local[:, :2] / -local[:, 2:] * [1, -1]
        seen *= 1 + record["k1"] * (seen**2).sum(axis=1, keepdims=True)
        pixel = record["fl_x"] * seen + [record["cx"], record["cy"]]
        mask = np.asarray(Image.open(tiny / "masks" / f"{frame['name']}.png"))
        rows, columns = np.nonzero(mask)
        low, high = (columns.min(), rows.min()), (columns.max() + 1, rows.max() + 1)
        outside.append([*(pixel.min(axis=0) - low), *(high - pixel.max(axis=0))])
    assert np.abs(outside).max() < 1.5
    assert abs(np.mean(outside)) < 0.25  # a pixel is the object's from a half on


@pytest.mark.slow
def test_the_sky_of_photos_is_the_light_of_their_place_times_their_gain(tiny):
    record, ranks = json.loads((tiny / "shoot.json").read_text()), []
    for frame in record["frames"]:
        light = read_exr(tiny / "light" / f"{frame['place']}.exr", "RGB") * frame["gain"]
        photo = read_png(tiny / frame["split"] / f"{frame['name']}.jpg").reshape(-1, 3)
        mask = np.asarray(Image.open(tiny / "masks" / f"{frame['name']}.png")).ravel()
        lens = Telephone(200, 150, round(record["fl_x"] / 250 * 43.27), record["k1"], 0, 0)
        towards = lens.rays(np.array(frame["transform_matrix"]), np.full((len(photo), 2), 0.5))
        row = (np.arccos(towards[:, 2]) / np.pi * 128).astype(int)
        column = ((0.5 - np.arctan2(towards[:, 1], towards[:, 0]) / (2 * np.pi)) * 256).astype(int) % 256
        sky = ~mask & (towards[:, 2] > 0.08)
        if frame["place"].startswith("room") or sky.sum() < 1000:  # walls are near, and lie elsewhere
            continue
        expected, shown = light[row, column][sky], photo[sky]
        ranks.append(spearmanr(expected[:, 1], shown[:, 1])[0])
        assert np.median(np.clip(expected, 0, 1) / np.maximum(srgb_decode(shown), 0.01)) == pytest.approx(
            1, abs=0.25
        )
    assert len(ranks) >= 3
    assert np.mean(ranks) > 0.6


@pytest.mark.slow
def test_an_interrupted_shoot_goes_on_to_the_same_files(tiny, tmp_path):
    record = json.loads((tiny / "shoot.json").read_text())
    files = {path: path.read_bytes() for path in tiny.rglob("*") if path.is_file()}
    lost = [tiny / "masks/IMG_1013.png", tiny / "test/IMG_1014.jpg", tiny / "mesh.obj"]
    lost += [tiny / "transforms_test.json", tiny / f"light/{record['frames'][-1]['place']}.exr"]
    for path in lost:
        path.unlink()
    del record["places"][record["frames"][-1]["place"]]
    (tiny / "shoot.json").write_text(json.dumps(record | {"frames": record["frames"][:12]}))
    again = run("radio", tiny, "--tiny")
    assert again.returncode == 0, again.stderr
    assert again.stdout.splitlines() == [f"{k} of 14 photos: IMG_10{k} in hall_02" for k in (13, 14)]
    assert {path: path.read_bytes() for path in tiny.rglob("*") if path.is_file()} == files
    other = run("radio", tiny, "--tiny", "--seed", 1)
    assert other.returncode == 3
    assert "begun with other settings" in other.stderr
    (tmp_path / "holiday.txt").write_text("mine")
    foreign = run("radio", tmp_path, "--tiny")
    assert foreign.returncode == 3
    assert foreign.stderr == f"{tmp_path} holds files that are no shoot; name a new folder.\n"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--width", "3"], "--width 3 is too few; give 64 or more."),
        (["--test-places", "-1"], "--test-places -1 is too few; give 0 or more."),
        (["--seed", "-1"], "--seed -1 is negative; give 0 or more."),
    ],
)
def test_a_number_that_cannot_be_is_refused(words, sentence, tmp_path, capsys):
    assert main(["shoot", "radio", str(tmp_path / "new"), *words]) == 3
    assert capsys.readouterr().err.strip() == sentence
    assert not (tmp_path / "new").exists()
