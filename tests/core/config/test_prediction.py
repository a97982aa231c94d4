from dataclasses import asdict, fields

import pytest

from lightprobe.core.config import Preset, settings
from lightprobe.core.config.prediction import Method, PredictConfig, PredictionOptions
from lightprobe.core.config.rendering import RenderConfig, Renderer
from lightprobe.core.errors import ConfigError


@pytest.mark.parametrize("preset", list(Preset))
def test_what_a_run_keeps_is_what_was_asked_for(preset):
    config = settings(preset).predict
    assert PredictConfig.from_json(asdict(config)) == config


def test_the_paper_s_preset_takes_the_paper_s_single_step():
    assert settings(Preset.PAPER).predict == PredictConfig(Method.PROBE_MLP, 128, 1_048_576, 0.25, 0.0)
    assert settings(Preset.QUICK).predict == PredictConfig()


@pytest.mark.parametrize(
    "values",
    [{"light_resolution": 24}, {"max_pixels": 0}, {"sampled_share": 1.5}, {"unseen_share": float("nan")}],
)
def test_unusable_values_are_refused_by_name(values):
    with pytest.raises(ConfigError, match=next(iter(values))):
        PredictionOptions(**values).over(PredictConfig())


@pytest.mark.parametrize("stored", [{"sampled_share": "many"}, {"method": "magic"}, {"unknown": 1}, []])
def test_broken_records_are_one_sentence(stored):
    with pytest.raises(ConfigError, match=r"configuration of predictions.* cannot be used"):
        PredictConfig.from_json(stored)


def test_the_command_line_changes_what_it_names_alone():
    config = settings(Preset.PAPER).predict
    assert PredictionOptions().over(config) == config
    changed = PredictionOptions(light_resolution=64).over(config)
    assert (changed.light_resolution, changed.method, changed.unseen_share) == (64, Method.PROBE_MLP, 0.0)
    assert {field.name for field in fields(PredictionOptions)} | {"method"} == {
        f.name for f in fields(PredictConfig)
    }


@pytest.mark.parametrize("samples", [0, -1, 65_537])
def test_a_number_of_rays_that_makes_no_picture_is_refused(samples):
    with pytest.raises(ConfigError, match="--samples"):
        RenderConfig(Renderer.PATH, samples)
