import numpy as np
import pytest

from demo_scene.models import Subject
from insertion.stills import CASES, Case, camera_of, glb, model_of, true_decomposition
from lightprobe.insertion import load_thing
from measure_insertion import similarity


def test_the_place_of_the_thing_is_read_off_its_points():
    points = np.random.default_rng(0).normal(size=(40, 3))
    turn = 0.5 * np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    matrix, offset = similarity(points, points @ turn.T + [1, 2, 3])
    assert matrix == pytest.approx(turn, abs=1e-9)
    assert offset == pytest.approx(np.array([1, 2, 3]), abs=1e-9)


@pytest.mark.slow
def test_objects_reach_the_product_as_they_are(tmp_path):
    model = model_of(Subject.TOY_CAR)
    (tmp_path / "car.glb").write_bytes(glb(model))
    thing = load_thing(tmp_path / "car.glb")
    points = np.concatenate(
        [part.vertices[np.unique(part.faces)] for part in model.parts]
    )  # those that faces use
    assert thing.vertices.numpy() == pytest.approx(points, abs=1e-6)
    assert len(thing.faces) == sum(len(part.faces) for part in model.parts)


@pytest.mark.long
def test_a_scene_is_traced_and_scored(tmp_path):
    pytest.importorskip("mitsuba")
    try:
        import insertion.truth  # noqa: F401
    except ImportError:
        pytest.skip("Mitsuba finds no LLVM library newer than 15.")
    from measure_insertion import make_scene, measure

    case: Case = CASES[0]
    scores = measure(make_scene(case, tmp_path / case.name, 48, 16), None)
    assert scores["true light and object"]["all"] > 18
    assert (tmp_path / case.name / "true.png").is_file()


@pytest.mark.long
def test_the_camera_sees_the_pot_whole():
    known = true_decomposition(model_of(Subject.COFFEE_POT))
    for case in CASES:
        pixel = camera_of(case, 100, -1.0).project(known.asset.mesh.vertices.numpy().astype(np.float64))
        assert (pixel[:, :2] > 0).all()
        assert (pixel[:, :2] < 100).all()
