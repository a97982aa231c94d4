"""What a run keeps of how well its object tells of its light."""

import json

import pytest

from lightprobe.core.errors import InputError
from lightprobe.models import LightAccuracy

FOUND = LightAccuracy("probe-net+optimize", 16, 0.5306, (0.07, 0.21, 0.6), 0.61, 0.58)


def test_it_comes_back_from_its_file(tmp_path):
    assert LightAccuracy.load(tmp_path) is None
    assert not LightAccuracy.is_decided(tmp_path)
    FOUND.save(tmp_path)
    assert LightAccuracy.load(tmp_path) == FOUND


def test_what_could_not_be_measured_is_decided_but_unknown(tmp_path):
    LightAccuracy.save_unknown(tmp_path, "No camera shows the object.")
    assert LightAccuracy.is_decided(tmp_path)
    assert LightAccuracy.load(tmp_path) is None


def test_the_sentence_says_what_to_expect():
    assert FOUND.sentence == (
        "On 16 simulated photos of the object the directions of the predicted map were off by 1.70 times on average, "
        "after one factor for all, and the spheres' si-RMSE (diffuse, matte, mirror) was 0.070, 0.210 and 0.600."
    )


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"method": "magic"}, "'method'"),
        ({"method": None}, "'method'"),
        ({"photos": 0}, "'photos'"),
        ({"photos": 1.5}, "'photos'"),
        ({"spheres": [0.1, 0.2]}, "'spheres'"),
        ({"spheres": [0.1, 0.2, -1]}, "'spheres'"),
        ({"spheres": None}, "'spheres'"),
        ({"log_error": None}, "'log_error'"),
        ({"log_error": float("nan")}, "'log_error'"),
        ({"fitted_scale": 0}, "'fitted_scale'"),
        ({"estimated_scale": "1"}, "'estimated_scale'"),
        ({"fitted_scale": 1e9}, "'fitted_scale'"),
    ],
)
def test_a_damaged_file_is_refused_with_what_is_wrong(tmp_path, wrong, named):
    (tmp_path / "light_accuracy.json").write_text(json.dumps(FOUND.to_json() | wrong))
    with pytest.raises(InputError, match=f"light_accuracy.*{named}"):
        LightAccuracy.load(tmp_path)
