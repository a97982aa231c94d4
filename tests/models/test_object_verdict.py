"""An object's verdict: what it says, and its file."""

import json

import pytest

from lightprobe.core.errors import InputError
from lightprobe.models.object_verdict import ObjectVerdict, Trust


@pytest.mark.parametrize(
    ("disagreement", "trust", "told"),
    [
        (0.03, Trust.GOOD, "is good"),
        (0.06, Trust.DOUBTFUL, "look at its materials"),
        (0.09, Trust.POOR, "--seed"),
    ],
)
def test_parts_that_disagree_about_the_light_tell_a_poor_object(disagreement, trust, told):
    verdict = ObjectVerdict(disagreement, 5)
    assert verdict.trust is trust
    assert told in verdict.sentence
    assert "5 held-out photos" in verdict.sentence


def test_an_object_that_was_only_judged_by_photos_it_was_fitted_to_is_doubtful_at_best(tmp_path):
    verdict = ObjectVerdict(0.03, 4, held_out=False)
    assert verdict.trust is Trust.DOUBTFUL
    assert (
        "(4 photos that it was fitted to, as none was held out); expect about 27 dB at best"
        in verdict.sentence
    )
    assert "at least eight photos" in verdict.sentence
    assert ObjectVerdict(0.09, 4, held_out=False).trust is Trust.POOR
    verdict.save(tmp_path / "verdict.json")
    assert ObjectVerdict.load(tmp_path / "verdict.json") == verdict


def test_the_more_parts_disagree_the_less_is_expected_and_only_poor_objects_lower_the_confidence():
    verdicts = [ObjectVerdict(value, 5) for value in (0.0, 0.03, 0.06, 0.09)]
    expected = [verdict.expected_psnr for verdict in verdicts]
    assert expected == sorted(expected, reverse=True)
    assert [verdict.doubt > 0 for verdict in verdicts] == [False, False, False, True]


@pytest.mark.parametrize(("bias", "told"), [(-0.3, "taken for too bright"), (0.4, "taken for too dark")])
def test_lights_that_know_where_the_camera_stands_make_an_object_doubtful(bias, told):
    assert ObjectVerdict(0.03, 5, bias, 1.0).trust is Trust.GOOD
    verdict = ObjectVerdict(0.03, 5, bias, 9.0)
    assert verdict.trust is Trust.DOUBTFUL
    assert told in verdict.sentence
    assert "calibrate" in verdict.sentence
    assert ObjectVerdict(0.09, 5, bias, 9.0).trust is Trust.POOR


@pytest.mark.parametrize(
    ("excess", "told"),
    [
        (-1.5, "dimmer than what its photos show around it, so it is probably taken for too bright"),
        (1.5, "brighter than what its photos show around it, so it is probably taken for too dark"),
    ],
)
def test_lights_that_do_not_fit_what_photos_show_make_an_object_doubtful(excess, told):
    verdict = ObjectVerdict(0.03, 5, 0.1, 0.5, excess, 4.5)
    assert verdict.trust is Trust.DOUBTFUL
    assert told in verdict.sentence
    assert ObjectVerdict(0.03, 5, 0.1, 0.5, excess / 3, 0.5).trust is Trust.GOOD


def test_a_verdict_comes_back_from_its_file(tmp_path):
    path = tmp_path / "verdict.json"
    assert ObjectVerdict.load(path) is None
    verdict = ObjectVerdict(0.0612, 5, -0.2, 3.1, -0.4, 0.3)
    verdict.save(path)
    assert ObjectVerdict.load(path) == verdict
    path.write_text(json.dumps({"disagreement": 0.05, "photos": 5}))  # as runs of before have it
    assert ObjectVerdict.load(path) == ObjectVerdict(0.05, 5)


@pytest.mark.parametrize(
    "value",
    [
        [],
        {},
        {"disagreement": 2, "photos": 5},
        {"disagreement": 0.1, "photos": 0},
        {"disagreement": "0.1", "photos": 5},
        {"disagreement": 0.1, "photos": 1.5},
        {"disagreement": 0.1, "photos": 5, "front_bias": "much"},
        {"disagreement": 0.1, "photos": 5, "surprise": -1},
        {"disagreement": 0.1, "photos": 5, "excess": None},
        {"disagreement": 0.1, "photos": 5, "excess_surprise": -0.1},
        {"disagreement": 0.1, "photos": 5, "held_out": "no"},
    ],
)
def test_a_file_that_holds_none_is_refused(tmp_path, value):
    path = tmp_path / "verdict.json"
    path.write_text(json.dumps(value))
    with pytest.raises(InputError, match="verdict"):
        ObjectVerdict.load(path)
