import numpy as np
import pytest

from demo_scene.check import first_hit
from demo_scene.dark_shapes import camera, lantern, toy_car
from demo_scene.geometry import coffee_pot, rounded_curve, turned, weld
from demo_scene.mug import mug
from demo_scene.pebble import pebble

PARTS = coffee_pot()
ALL_PARTS = [
    (make.__name__, part) for make in (coffee_pot, toy_car, camera, lantern, mug, pebble) for part in make()
]


@pytest.mark.parametrize("make", [coffee_pot, toy_car, camera, lantern, mug, pebble])
def test_an_object_is_centred_and_its_farthest_vertex_lies_at_one(make):
    points = np.concatenate([part.vertices for part in make()])
    np.testing.assert_allclose((points.min(axis=0) + points.max(axis=0)) / 2, 0, atol=1e-12)
    assert np.linalg.norm(points, axis=1).max() == pytest.approx(1.0)


@pytest.mark.parametrize(
    "part", [part for _, part in ALL_PARTS], ids=[f"{of}-{part.name}" for of, part in ALL_PARTS]
)
def test_normals_are_unit_and_agree_with_the_faces(part):
    a, b, c = (part.vertices[part.faces[:, k]] for k in range(3))
    flat = np.cross(b - a, c - a)
    assert (np.linalg.norm(flat, axis=1) > 0).all()
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    np.testing.assert_allclose(np.linalg.norm(part.normals, axis=1), 1, atol=1e-9)
    agreement = np.einsum("fk,fck->fc", flat, part.normals[part.faces])
    assert np.quantile(agreement, 0.01) > 0.5


@pytest.mark.parametrize("name", ["body", "lid", "band", "knob"])
def test_turned_parts_face_away_from_their_axis_or_along_it(name):
    part = next(part for part in PARTS if part.name == name)
    axis = np.array([next(p for p in PARTS if p.name == "body").vertices[:, 0].mean(), 0.0, 0.0])
    center = part.vertices.mean(axis=0) * [0, 0, 1] + axis
    assert ((part.vertices - center) * part.normals).sum(axis=1).mean() > 0


def test_spout_is_open_and_hollow():
    spout = next(part for part in PARTS if part.name == "spout")
    rings = spout.vertices.reshape(-1, 17, 3)
    lip = rings[:, :-1].mean(axis=1)[25]  # the ring where the tube turns back
    outwards = lip - rings[:, :-1].mean(axis=1)[20]
    start = lip + 0.1 * outwards
    assert first_hit(start, -outwards / np.linalg.norm(outwards), spout.vertices[spout.faces]) > 0.2


def test_the_mug_is_open_down_to_its_floor():
    body = next(part for part in mug() if part.name == "body")
    height = np.ptp(body.vertices[:, 2])
    inside = np.array([body.vertices[:, 0].mean(), 0.01, body.vertices[:, 2].max() + 0.1])
    assert first_hit(inside, np.array([0.0, 0.0, -1.0]), body.vertices[body.faces]) > 0.1 + 0.85 * height


def test_weld_merges_equal_vertices_and_drops_what_vanishes():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 1e-6], [1, 1, 0], [9, 9, 9]], float)
    faces = np.array([[0, 1, 2], [3, 4, 2], [1, 3, 2]])
    welded, triangles = weld(vertices, faces)
    assert len(welded) == 4
    assert len(triangles) == 2


@pytest.mark.parametrize("make", [toy_car, camera, lantern, mug, pebble])
def test_closed_parts_hold_space_and_so_face_outwards(make):
    for part in make():
        a, b, c = (part.vertices[part.faces[:, k]] - part.vertices.mean(axis=0) for k in range(3))
        assert np.einsum("fk,fk->", a, np.cross(b, c)) > 0, part.name


def test_a_rounded_curve_lies_on_its_equation_and_is_closed():
    curve = rounded_curve(4.0, 40)
    assert np.array_equal(curve[0], curve[-1])
    np.testing.assert_allclose((np.abs(curve) ** 4).sum(axis=1), 1, atol=2e-3)
    assert np.linalg.norm(np.diff(curve, axis=0), axis=1).max() < 0.4


def test_a_turn_is_counter_clockwise():
    np.testing.assert_allclose(turned("z", 90) @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    np.testing.assert_allclose(turned("x", 90) @ [0, 1, 0], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(turned("y", 90) @ [0, 0, 1], [1, 0, 0], atol=1e-12)
