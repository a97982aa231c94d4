"""Photos rendered from a known asset: an evaluation against it must find it perfect, and a wrong one not."""

import dataclasses
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import torch

from lightprobe.core.config.prediction import Sun
from lightprobe.core.errors import InputError
from lightprobe.core.run import RunFolder
from lightprobe.evaluation import Evaluation, Protocols, evaluate
from lightprobe.evaluation.evaluation import _Judge, write_prediction
from lightprobe.evaluation.metrics import interval
from lightprobe.evaluation.views import TestView
from lightprobe.imaging import read_hdr, read_ldr
from lightprobe.light.environment import Environment
from lightprobe.light.files import light_file
from lightprobe.light.sources import SplitLight
from lightprobe.material.textures import Textures
from lightprobe.models import Decomposition
from lightprobe.prediction import Method, Prediction, Predictor, methods_for
from lightprobe.render.asset import Asset
from lightprobe.scene.photo import Scene, Truth
from tests.evaluation.pretended import GOOD, Lamp, Shown
from tests.known_scene import CPU, known_scene


def prediction() -> Prediction:
    """A light that is brighter above than below, more trusted along +x; without its suns it has a third of
    it.
    """
    light = torch.ones(6, 8, 8, 3) * torch.tensor([0.5, 0.25, 1.0])
    light[4] *= 4
    trust = torch.full((6, 8, 8), 0.125)
    trust[0] = 0.75
    split = SplitLight(Environment(light / 3), ())
    return Prediction(Environment(light), trust, {"total": 1.0}, GOOD, split=split)


@pytest.mark.parametrize(("height", "sun", "share"), [(None, Sun.INSIDE, 1.0), (64, Sun.SEPARATE, 1 / 3)])
def test_a_map_has_its_picture_and_its_confidence_beside_it(
    tmp_path: Path, height: int | None, sun: Sun, share: float
) -> None:
    write_prediction(prediction(), tmp_path / "a.exr", height, sun)
    assert {path.name for path in tmp_path.iterdir()} == {"a.exr", "a.png", "a.confidence.exr"}
    rows = height or 16
    light, confidence = read_hdr(tmp_path / "a.exr"), read_hdr(tmp_path / "a.confidence.exr")
    assert light.shape == (rows, 2 * rows, 3)
    assert light[0, 0] == pytest.approx(share * np.array([2.0, 1.0, 4.0]), rel=1e-2)
    assert light[-1, 0] == pytest.approx(share * np.array([0.5, 0.25, 1.0]), rel=1e-2)
    assert confidence.shape[:2] == (16, 32)
    assert float(confidence[8, 16].flat[0]) == pytest.approx(
        0.75, abs=1e-3
    )  # the middle column looks along +x
    assert float(confidence[8, 0].flat[0]) == pytest.approx(0.125, abs=1e-3)
    picture, _ = read_ldr(tmp_path / "a.png")
    assert picture.shape == light.shape
    factor = -np.log(1 - picture[-1, 0]) / light[-1, 0]  # 1 - exp(-factor radiance), one factor for all
    assert factor == pytest.approx(np.full(3, factor.mean()), rel=0.03)
    assert picture[0, 0] == pytest.approx(1 - np.exp(-factor.mean() * light[0, 0]), abs=0.02)


def test_what_was_told_of_an_older_map_goes(tmp_path: Path) -> None:
    light_file(tmp_path / "a.exr").write_text(
        '{"format": "lightprobe light", "map": {"file": "a.exr", "sun": "separate"}}'
    )
    write_prediction(prediction(), tmp_path / "a.exr")
    assert not light_file(tmp_path / "a.exr").exists()


def test_a_map_can_be_written_as_radiance(tmp_path: Path) -> None:
    write_prediction(prediction(), tmp_path / "b.hdr")
    assert {path.name for path in tmp_path.iterdir()} == {"b.hdr", "b.png", "b.confidence.exr"}
    assert read_hdr(tmp_path / "b.hdr")[0, 0] == pytest.approx([2.0, 1.0, 4.0], rel=0.01)


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


@pytest.mark.slow
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


@pytest.mark.long
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


@pytest.mark.slow
def test_a_photo_that_cannot_be_scored_is_named_and_costs_no_other(known, tmp_path):
    decomposition, scene = known
    away = dataclasses.replace(
        scene.test[1].camera, camera_to_world=scene.test[1].camera.camera_to_world.copy()
    )
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
    result = Evaluation(
        Method.SOLVE, {name: {Method.SOLVE: {"psnr": value}} for name, value in scores.items()}
    )
    apart = result.interval(Method.SOLVE)["psnr"]
    result.lights = {"a": "sky", "b": "sky"}
    metrics = result.to_json()
    assert metrics["interval"]["solve"]["psnr"] == pytest.approx(
        interval([1.0, 2.0, 4.0], ["sky", "sky", "c"])
    )
    assert metrics["interval"]["solve"]["psnr"] != pytest.approx(apart)
    assert [photo.get("light") for photo in metrics["photos"].values()] == ["sky", "sky", None]
    result.lights = dict.fromkeys(scores, "sky")
    assert result.interval(Method.SOLVE) == {}


@pytest.mark.slow
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


def test_a_scene_without_test_photos_says_so(known):
    decomposition, scene = known
    with pytest.raises(InputError, match="no test photos"):
        evaluate(
            decomposition, None, dataclasses.replace(scene, test=()), methods=methods_for(None), device=CPU
        )


@pytest.mark.slow
def test_slow_methods_see_few_photos_but_the_default_all(known):
    decomposition, scene = known
    slow = Protocols(unseen=False, slow_seconds=0.0, slow_photos=1)
    methods = (Method.CONSTANT, Method.SOLVE)
    found = evaluate(decomposition, None, scene, methods=methods, device=CPU, protocols=slow)
    scored = [set(scores) for scores in found.photos.values()]
    assert len(scored) > 1
    assert scored == [set(methods), *[{Method.CONSTANT}] * (len(scored) - 1)]
    assert found.to_json()["mean"]["psnr"] > 0


def scores_of(**values: float) -> dict[Method, dict[str, float]]:
    return {Method.SOLVE: values}


def test_scores_that_are_not_finite_are_left_out_photo_by_photo() -> None:
    result = Evaluation(
        Method.SOLVE,
        {
            "a": scores_of(psnr=20.0, ssim=0.5, normal=math.nan) | {Method.CONSTANT: {"psnr": 12.0}},
            "b": scores_of(psnr=math.nan, ssim=0.7, normal=math.nan, extra=3.0),
            "c": scores_of(psnr=26.0, ssim=math.inf, normal=math.nan),
        },
        truth={"chamfer": 0.125, "roughness_mae": math.nan},
        lights={"a": "sky"},
    )
    finite = {"psnr": {"a": 20.0, "c": 26.0}, "ssim": {"a": 0.5, "b": 0.7}, "normal": {}, "extra": {"b": 3.0}}
    assert result.values(Method.SOLVE) == finite
    assert result.mean(Method.SOLVE) == pytest.approx({"psnr": 23.0, "ssim": 0.6, "extra": 3.0})
    assert result.interval(Method.SOLVE) == pytest.approx(
        {"psnr": 12.7062 * 3.0, "ssim": 12.7062 * 0.1}, rel=1e-4
    )
    assert result.interval(Method.CONSTANT) == {}
    found = result.to_json()
    assert found["mean"] == pytest.approx({"psnr": 23.0, "ssim": 0.6, "extra": 3.0, "chamfer": 0.125})
    assert found["methods"]["constant"] == {"psnr": 12.0}
    assert found["interval"]["constant"] == {}
    assert found["photos"]["a"] == {
        "psnr": 20.0,
        "ssim": 0.5,
        "methods": {"solve": {"psnr": 20.0, "ssim": 0.5}, "constant": {"psnr": 12.0}},
        "light": "sky",
    }
    assert found["photos"]["c"] == {"psnr": 26.0, "methods": {"solve": {"psnr": 26.0}}}
    assert "skipped" not in found


def test_bins_and_doubtful_photos_are_counted() -> None:
    rising = [{"confidence": 0.2, "log_rmse_scaled": 0.3}, {"confidence": 0.7, "log_rmse_scaled": 0.4}]
    doubtful = replace(GOOD, overlap=0.5)
    result = Evaluation(
        Method.SOLVE,
        {"a": scores_of(psnr=20.0)},
        confidence={Method.SOLVE: rising, Method.CONSTANT: rising[::-1], Method.PROBE_MLP: []},
        verdicts={"a": GOOD, "b": doubtful, "c": doubtful},
    )
    found = result.to_json()
    assert found["confidence"] == {
        "solve": {"bins": rising, "falls": False},
        "constant": {"bins": rising[::-1], "falls": True},
    }
    assert found["verdicts"]["doubtful"] == 2
    assert found["verdicts"]["photos"]["b"]["overlap"] == 0.5


def judge_of(lamp: Lamp, **limits: Any) -> _Judge:
    protocols = Protocols(**limits)
    return _Judge(cast(Decomposition, None), cast(Predictor, lamp), None, protocols, CPU)


def test_each_half_of_the_object_is_scored_under_the_light_of_the_other() -> None:
    """Left, right, above, below: 8 pixels each, with means at columns .5, 2.5 and rows .5, 2.5."""
    lamp = Lamp(*[30.0] * 5)
    found = judge_of(lamp).score(cast(TestView, Shown()), None, Method.SOLVE)
    assert found.image == 16  # of all of the object
    assert found.scores["psnr"] == 16
    assert found.scores["psnr_masked"] == 32
    halves = [100 * 1.5 + 10 * 2.5, 100 * 1.5 + 10 * 0.5, 100 * 2.5 + 10 * 1.5, 100 * 0.5 + 10 * 1.5]
    assert found.scores["psnr_unseen"] == pytest.approx(sum(halves) / 4 + 1)
    seen = [sorted(set(np.nonzero(pixels.alpha)[1])) for pixels, _ in lamp.asked]
    assert seen == [[0, 1, 2, 3], [0, 1], [2, 3], [0, 1, 2, 3], [0, 1, 2, 3]]
    assert all(set(np.unique(pixels.alpha)) == {0, np.float32(0.75)} for pixels, _ in lamp.asked)
    assert found.scores.keys() == {"psnr", "ssim", "psnr_masked", "ssim_masked", "seconds", "psnr_unseen"}


def test_a_half_with_too_little_of_the_object_is_left_out() -> None:
    """Of one row of four pixels the halves are two wide, of which no light is found, nothing above and all
    below.
    """
    found = judge_of(Lamp(30.0, 30.0)).score(cast(TestView, Shown(rows=1)), None, Method.SOLVE)
    assert "psnr_unseen" not in found.scores  # nothing is left to score the light of the lower half on
    without = judge_of(Lamp(30.0), unseen=False).score(cast(TestView, Shown()), None, Method.SOLVE)
    assert "psnr_unseen" not in without.scores


def test_the_first_call_of_a_quick_method_is_not_the_one_that_is_timed() -> None:
    lamp, view = Lamp(0.49, 0.1, 0.3, 0.2), cast(TestView, Shown())
    judge = judge_of(lamp, unseen=False, slow_seconds=0.5, slow_photos=2)
    assert [judge.score(view, None, Method.SOLVE).scores["seconds"] for _ in range(3)] == [0.1, 0.3, 0.2]
    assert judge.slowest == {Method.SOLVE: 0.3}
    slow = judge_of(Lamp(0.5, 0.1), unseen=False, slow_seconds=0.5, slow_photos=2)
    assert slow.score(view, None, Method.SOLVE).scores["seconds"] == 0.5
    assert slow.slowest == {Method.SOLVE: 0.5}


@pytest.mark.parametrize(
    ("seconds", "done", "slow"),
    [(0.5, 9, False), (0.6, 2, True), (0.6, 1, False), (0.6, 3, True), (None, 9, False)],
)
def test_a_method_that_was_too_slow_is_left_out_after_some_photos(
    seconds: float | None, done: int, slow: bool
) -> None:
    judge = judge_of(Lamp(), slow_seconds=0.5, slow_photos=2)
    judge.slowest = {} if seconds is None else {Method.SOLVE: seconds}
    assert judge.too_slow(Method.SOLVE, done) == slow
    assert not judge.too_slow(Method.CONSTANT, done)


@pytest.mark.slow
def test_whoever_waits_hears_of_each_photo_that_was_scored(
    known: tuple[Decomposition, Scene], tmp_path: Path
) -> None:
    """A photo that cannot be read is not reported, and names of lights come from the photos."""
    decomposition, scene = known
    lost = replace(scene.test[0], name="lost", image_path=tmp_path / "none.png")
    named = replace(scene.test[1], truth=replace(scene.test[1].truth, light="sky"))
    some = replace(scene, test=(scene.test[0], lost, named), relight=(), root=tmp_path)
    heard: list[tuple[int, int]] = []
    quickly = {"methods": (Method.CONSTANT,), "device": CPU, "protocols": Protocols(unseen=False)}
    result = evaluate(decomposition, None, some, **quickly, on_photo=lambda *counts: heard.append(counts))
    assert heard == [(1, 3), (3, 3)]
    assert result.lights == {"bb": "sky"}
    assert result.skipped.keys() == {"lost"}
    assert "none.png" in result.skipped["lost"]
    assert "chamfer" not in result.truth  # this folder has no mesh
    assert "relight_psnr" not in result.truth
    scores = result.photos["a"][Method.CONSTANT]
    assert {"light_log_rmse", "relit_psnr", "diffuse_si_rmse"} <= scores.keys()
    bare = replace(scene, test=(replace(scene.test[0], truth=Truth()),), relight=(), root=tmp_path)
    plain = evaluate(decomposition, None, bare, **quickly)
    expected = {"psnr", "ssim", "psnr_masked", "ssim_masked", "seconds"}
    assert plain.photos["a"][Method.CONSTANT].keys() == expected
    assert plain.truth == {}
    assert plain.to_json()["confidence"] == {}
