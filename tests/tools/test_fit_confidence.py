"""The fit of the confidence on photos that a test makes, and its arithmetic on made-up numbers."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import fit_confidence
from fit_confidence import Samples, binned, fit, gap, joined, report, samples
from lightprobe.core.files import write_json
from lightprobe.core.run import RunFolder
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.prediction import Method, PredictConfig, Predictor
from lightprobe.prediction.confidence import CAUSES, FITTED, Weights
from lightprobe.scene import load_scene
from lightprobe.scene.camera import Similarity
from lightprobe.scene.record import scene_record
from tests.lit_sphere import glossy_sphere
from tests.shapes import camera_at
from tests.toy_scene import write_toy_scene

CAMERAS = [camera_at((2.6, 1.4, 1.2), size=32, focal=42.0), camera_at((-2.6, 1.4, 1.2), size=32, focal=42.0)]
TRUE = np.array([0.0, 0.2, 0.3, 0.0, 0.4, 0.5])


@pytest.fixture(scope="module")
def sphere():
    return Decomposition(glossy_sphere(), {}, Similarity(np.zeros(3), 1.0))


def made_up(count: int = 400) -> Samples:
    random = np.random.default_rng(0)
    causes = np.concatenate([random.random((count, len(CAUSES))), np.ones((count, 1))], 1)
    return Samples(causes, causes @ TRUE, random.random(count) + 0.5, np.arange(count) // 50)


def test_known_weights_are_found_again():
    np.testing.assert_allclose(fit(made_up()), TRUE, atol=1e-9)
    assert gap(made_up(), TRUE) == pytest.approx(0, abs=1e-9)
    assert list(binned(made_up(), TRUE)) == sorted(binned(made_up(), TRUE), reverse=True)


def test_the_report_holds_used_weights_beside_those_of_the_other_half():
    lines = report(made_up(), Weights(*TRUE))
    assert (
        lines[0]
        == "fitted  Weights(unseen=0.00, unpinned=0.20, bright=0.30, dark=0.00, rough=0.40, least=0.50)"
    )
    assert sum("off by 0.000" in line for line in lines) == 4


def test_objects_weigh_the_same_together():
    many = made_up(800)
    few = replace(made_up(100), error=np.full(100, 0.7))
    both = joined([many, few])
    assert both.angle[:800].sum() == pytest.approx(both.angle[800:].sum())
    assert np.array_equal(both.error, np.concatenate([many.error, few.error]))


@pytest.mark.slow
def test_directions_of_all_photos_are_sampled(sphere):
    found = samples(Predictor(sphere, config=PredictConfig(light_resolution=16)), CAMERAS, Method.SOLVE, 4)
    directions = 6 * 16**2
    assert found.causes.shape == (4 * directions, len(CAUSES) + 1)
    assert found.angle.sum() == pytest.approx(4 * 4 * np.pi, rel=1e-4)
    assert np.isfinite(found.causes).all()
    assert 0.1 < np.sqrt((found.error**2).mean()) < 5
    assert {len(found.part(k).error) for k in (0, 1)} == {2 * directions}


@pytest.mark.slow
def test_the_command_reads_a_run(sphere, tmp_path, capsys):
    scene, run = write_toy_scene(tmp_path / "scene", train=3, test=1), RunFolder.create(tmp_path / "run")
    write_json(run.config_file, {})
    photos = load_scene(scene)
    write_json(run.scene_file, scene_record(photos))
    replace(
        sphere, lights={photo.name: Environment(torch.ones(6, 16, 16, 3)) for photo in photos.train}
    ).save(run)
    fit_confidence.main([str(run.path), str(run.path), "--method", "solve", "--photos", "2"])
    printed = capsys.readouterr().out
    assert printed.count(str(run.path)) == 2
    assert str(FITTED) in printed
    assert printed.splitlines()[-1].startswith("all together  Weights(unseen=")
    with pytest.raises(SystemExit, match="not a run folder"):
        fit_confidence.main([str(tmp_path / "nothing")])
