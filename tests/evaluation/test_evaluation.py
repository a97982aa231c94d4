"""Photos rendered from a known asset: an evaluation against it must find it perfect, and a wrong one not."""

import dataclasses

import pytest
import torch

from lightprobe.core.errors import InputError
from lightprobe.core.run import RunFolder
from lightprobe.evaluation import Evaluation, Protocols, evaluate
from lightprobe.evaluation.metrics import interval
from lightprobe.material.textures import Textures
from lightprobe.prediction import Method, methods_for
from lightprobe.render.asset import Asset
from tests.known_scene import CPU, known_scene


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """The decomposition, and a scene of its own renders."""
    return known_scene(tmp_path_factory.mktemp("known"))


@pytest.fixture(scope="module")
def evaluated(known, tmp_path_factory):
    decomposition, scene = known
    run, views = RunFolder(tmp_path_factory.mktemp("run")), []
    methods = (Method.SOLVE, Method.CONSTANT)
    result = evaluate(decomposition, None, scene, methods=methods, device=CPU, run=run, on_view=views.append)
    return result, run, views


def test_the_true_asset_has_no_error(evaluated):
    truth = evaluated[0].truth
    assert truth["base_color_psnr"] > 60
    assert truth["base_color_ratio"] == pytest.approx(1, abs=1e-3)
    assert truth["base_color_ratio_worst"] == pytest.approx(1, abs=1e-3)
    assert truth["roughness_mae"] < 1e-4
    assert truth["metallic_mae"] < 1e-4
    assert truth["normal_degrees"] < 0.05
    assert truth["chamfer"] < 0.02
    assert truth["relight_psnr"] > 60
    assert truth["relight_psnr_scaled"] == pytest.approx(truth["relight_psnr"], abs=1)


def test_solving_for_the_light_beats_a_constant_and_loses_on_unseen_pixels(evaluated):
    means = evaluated[0].to_json()["methods"]
    assert means["solve"]["psnr_masked"] > 34
    assert means["solve"]["psnr_masked"] > means["constant"]["psnr_masked"] + 5
    assert means["solve"]["light_log_rmse"] < means["constant"]["light_log_rmse"]
    assert means["solve"]["psnr_unseen"] < means["solve"]["psnr_masked"]
    assert means["solve"]["seconds"] > 0


def test_the_first_method_is_the_default_one(evaluated):
    result, run, views = evaluated
    metrics = result.to_json()
    assert metrics["default_method"] == "solve"
    assert metrics["photos"]["a"]["psnr"] == metrics["photos"]["a"]["methods"]["solve"]["psnr"]
    assert [view.view.photo.name for view in views] == ["a", "bb"]
    default, named = run.prediction_file("a", ".exr"), run.prediction_file("a", ".exr", "solve")
    assert default.read_bytes() == named.read_bytes()


@pytest.mark.slow
def test_the_place_without_a_name_is_only_for_the_run_s_own_default(known, tmp_path):
    decomposition, scene = known
    run, quickly = RunFolder(tmp_path), Protocols(unseen=False)
    evaluate(decomposition, None, scene, methods=(Method.CONSTANT,), device=CPU, run=run, protocols=quickly)
    assert run.prediction_file("a", ".exr", "constant").is_file()
    assert not run.prediction_file("a", ".exr").exists()
    methods = (Method.CONSTANT, Method.SOLVE)
    evaluate(decomposition, None, scene, methods=methods, device=CPU, run=run, protocols=quickly)
    solved = run.prediction_file("a", ".exr", "solve").read_bytes()
    assert run.prediction_file("a", ".exr").read_bytes() == solved


def test_a_photo_that_cannot_be_scored_is_named_and_costs_no_other(known, tmp_path):
    decomposition, scene = known
    away = dataclasses.replace(scene.test[1].camera, camera_to_world=scene.test[1].camera.camera_to_world.copy())
    away.camera_to_world[:3, 3] *= -1  # looks away from the object
    lost = dataclasses.replace(scene.test[1], camera=away)
    methods, quickly = (Method.CONSTANT,), Protocols(unseen=False)
    both = dataclasses.replace(scene, test=(lost, scene.test[0]))
    result = evaluate(decomposition, None, both, methods=methods, device=CPU, protocols=quickly)
    assert result.photos.keys() == {"a"}
    assert result.skipped.keys() == {"bb"}
    metrics = result.to_json()
    assert metrics["skipped"] == result.skipped
    assert metrics["verdicts"]["doubtful"] == 0
    assert metrics["verdicts"]["photos"]["a"]["status"] == "good"
    with pytest.raises(InputError, match="No test photo of"):
        evaluate(decomposition, None, dataclasses.replace(scene, test=(lost,)), methods=methods, device=CPU)


def test_photos_under_one_light_are_one_piece_of_evidence():
    scores = {"a": 1.0, "b": 2.0, "c": 4.0}
    result = Evaluation(Method.SOLVE, {name: {Method.SOLVE: {"psnr": value}} for name, value in scores.items()})
    apart = result.interval(Method.SOLVE)["psnr"]
    result.lights = {"a": "sky", "b": "sky"}
    metrics = result.to_json()
    assert metrics["interval"]["solve"]["psnr"] == pytest.approx(interval([1.0, 2.0, 4.0], ["sky", "sky", "c"]))
    assert metrics["interval"]["solve"]["psnr"] != pytest.approx(apart)
    assert [photo.get("light") for photo in metrics["photos"].values()] == ["sky", "sky", None]
    result.lights = dict.fromkeys(scores, "sky")
    assert result.interval(Method.SOLVE) == {}


def test_a_wrong_material_is_found_out(known):
    decomposition, scene = known
    t = decomposition.asset.textures
    tinted = Textures(t.base_color * torch.tensor([0.5, 0.8, 1.0]), t.roughness + 0.1, t.metallic, t.normal)
    wrong = dataclasses.replace(decomposition, asset=Asset(decomposition.asset.mesh, tinted))
    truth = evaluate(
        wrong, None, scene, methods=(Method.CONSTANT,), device=CPU, protocols=Protocols(unseen=False)
    ).truth
    assert truth["base_color_psnr"] < 20
    assert truth["base_color_psnr_scaled"] > 60
    assert truth["base_color_ratio"] == pytest.approx(0.4 ** (1 / 3), rel=0.01)
    assert truth["base_color_ratio_worst"] == pytest.approx(0.5, rel=0.01)
    assert truth["roughness_mae"] == pytest.approx(0.1, abs=0.001)
    assert truth["relight_psnr_scaled"] > truth["relight_psnr"] + 5


def test_a_shrunken_surface_is_found_out(known):
    decomposition, scene = known
    mesh = dataclasses.replace(decomposition.asset.mesh, vertices=decomposition.asset.mesh.vertices * 0.9)
    wrong = dataclasses.replace(decomposition, asset=Asset(mesh, decomposition.asset.textures))
    truth = evaluate(
        wrong, None, scene, methods=(Method.CONSTANT,), device=CPU, protocols=Protocols(unseen=False)
    ).truth
    assert truth["chamfer"] == pytest.approx(0.1, abs=0.01)


def test_a_scene_without_test_photos_says_so(known):
    decomposition, scene = known
    with pytest.raises(InputError, match="no test photos"):
        evaluate(decomposition, None, dataclasses.replace(scene, test=()), methods=methods_for(None), device=CPU)


def test_slow_methods_see_few_photos_but_the_default_all(known):
    decomposition, scene = known
    slow = Protocols(unseen=False, slow_seconds=0.0, slow_photos=1)
    methods = (Method.CONSTANT, Method.SOLVE)
    found = evaluate(decomposition, None, scene, methods=methods, device=CPU, protocols=slow)
    scored = [set(scores) for scores in found.photos.values()]
    assert len(scored) > 1
    assert scored == [set(methods), *[{Method.CONSTANT}] * (len(scored) - 1)]
    assert found.to_json()["mean"]["psnr"] > 0
