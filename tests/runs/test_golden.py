"""The bundled scene's scores after a few steps of training stay where eight other seeds have put them."""

import json

import pytest

import measure_golden


@pytest.mark.slow
@pytest.mark.golden
def test_a_few_steps_on_the_bundled_scene_score_as_other_seeds_did():
    measured = json.loads(measure_golden.FILE.read_text())["seeds"]
    expected = measure_golden.intervals(measured)
    found = measure_golden.scores(measure_golden.small_scene(), seed=0)
    outside = {name: (value, expected[name]) for name, value in found.items() if value not in expected[name]}
    assert outside == {}, (
        f"python {measure_golden.__file__} measures them anew, if this was meant to move them"
    )
    assert found.keys() == expected.keys()
