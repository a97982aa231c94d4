"""What a run keeps of how well its object tells of its light."""

import json

import pytest

from lightprobe.core.errors import InputError
from lightprobe.models import LightAccuracy
from lightprobe.models.light_accuracy import FILE

FOUND = LightAccuracy(16, 0.5306, (0.07, 0.21, 0.6), 0.61, 0.58)


def test_it_comes_back_from_its_file(tmp_path):
    assert LightAccuracy.load(tmp_path) is None
    FOUND.save(tmp_path)
    assert LightAccuracy.load(tmp_path) == FOUND


def test_the_sentence_says_what_to_expect():
    assert FOUND.sentence == (
        "On 16 simulated photos of it the predicted radiance was off by a factor of 1.70 on average, and three spheres "
        "lit by it (diffuse, matte, mirror) by 0.070, 0.210 and 0.600."
    )
    assert FOUND.spheres_mean == pytest.approx(0.88 / 3)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
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
    (tmp_path / FILE).write_text(json.dumps(FOUND.to_json() | wrong))
    with pytest.raises(InputError, match=f"light_accuracy.*{named}"):
        LightAccuracy.load(tmp_path)
