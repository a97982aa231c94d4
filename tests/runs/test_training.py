"""A whole run in one call from Python, which the rest of the library reads."""

import dataclasses

import numpy as np
import pytest

import lightprobe
from benchmarks.provenance import training_costs
from lightprobe.core.config import DecomposeConfig, DistillConfig
from lightprobe.core.config.prediction import PredictConfig
from lightprobe.core.errors import ConfigError
from lightprobe.core.timings import read_timings
from tests.toy_scene import TINY_DISTILL, TINY_WITHOUT_TRIALS, write_toy_scene


def tiny(words: list[str], section: str) -> dict[str, int]:
    """Return the settings of a section among the options of the toy scene's command line."""
    options = dict(zip(words[::2], words[1::2], strict=True))
    start = f"--{section}."
    return {
        name.removeprefix(start).replace("-", "_"): int(v)
        for name, v in options.items()
        if name.startswith(start)
    }


@pytest.mark.slow
def test_one_call_trains_a_run_that_a_predictor_loads(tmp_path):
    scene, heard = write_toy_scene(tmp_path / "scene"), []
    settings = {
        "decompose": dataclasses.replace(DecomposeConfig(), **tiny(TINY_WITHOUT_TRIALS, "decompose")),
        "distill": dataclasses.replace(DistillConfig(), **tiny(TINY_DISTILL, "distill")),
        "predict": PredictConfig(light_resolution=16),
        "device": "cpu",
        "seed": 3,
    }
    run = lightprobe.train(scene, tmp_path / "run", **settings, on_progress=lambda *told: heard.append(told))
    stages = {"pass1", "pass2", "pass3", "lights", "lessons", "distill", "simulated photos"}
    assert stages <= {stage for stage, *_ in heard}
    assert ("distill", 18, 18) in [told[:3] for told in heard]
    timings = read_timings(run.timings_file)
    assert all(timings[phase].finished and timings[phase].seconds > 0 for phase in ("decompose", "distill"))
    assert training_costs(run).keys() >= {"decompose", "distill"}
    predictor = lightprobe.Predictor.load(run.path)
    photo = lightprobe.load_photo(scene / "test" / "test_00.png", camera=scene / "transforms_test.json")
    environment = predictor.predict(*photo).environment.texels
    assert environment.shape == (6, 16, 16, 3)
    assert np.isfinite(environment.numpy()).all()
    assert predictor.accuracy is not None
    assert predictor.accuracy.photos == 2

    heard.clear()
    lightprobe.train(scene, run.path, **settings, on_progress=lambda *told: heard.append(told))
    assert heard == []  # both phases were finished
    (run.model_folder / "light_accuracy.json").unlink()  # as a training that was killed before it
    lightprobe.train(scene, run.path, **settings)
    assert lightprobe.Predictor.load(run.path).accuracy == predictor.accuracy
    with pytest.raises(ConfigError, match=r"decompose\.seed = 3, not 4"):
        lightprobe.train(scene, run.path, **{**settings, "seed": 4})
