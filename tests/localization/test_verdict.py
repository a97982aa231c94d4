"""What follows from what was measured."""

import dataclasses

import pytest

from lightprobe.localization.verdict import PoseStatus, PoseVerdict, rival_scores

FINE = PoseVerdict(
    score=2.5, explained=0.9, edges=0.7, agreed=0.4, inside=1.0, rivals=0, pose_uncertainty=0.006
)


def test_a_good_pose_needs_no_words():
    assert FINE.status is PoseStatus.GOOD
    assert FINE.sentences == ()


@pytest.mark.parametrize(
    ("change", "status", "words"),
    [
        ({"score": 0.9}, PoseStatus.REFUSED, "not found in this photo"),
        ({"score": 1.9}, PoseStatus.DOUBTFUL, "may not stand where"),
        ({"inside": 0.3}, PoseStatus.DOUBTFUL, "Only 30 % of the object"),
        ({"rivals": 1}, PoseStatus.AMBIGUOUS, "another pose explains this photo about as well"),
        ({"pose_uncertainty": 0.05}, PoseStatus.AMBIGUOUS, "could lie 10 % of its size elsewhere"),
        ({"pose_uncertainty": 0.05, "rivals": 1}, PoseStatus.AMBIGUOUS, "another pose explains"),
        ({"rivals": 3}, PoseStatus.AMBIGUOUS, "3 other poses explain"),
        ({"rivals": 3, "score": 1.2}, PoseStatus.DOUBTFUL, "may not stand where"),
    ],
)
def test_each_finding_is_a_sentence(change, status, words):
    verdict = dataclasses.replace(FINE, **change)
    assert verdict.status is status
    assert verdict.doubt > FINE.doubt == 0
    assert len(verdict.sentences) == 1
    assert words in verdict.sentences[0]
    assert verdict.to_json()["status"] == status.value


def test_rivals_are_those_near_the_best():
    assert rival_scores([2.0, 1.9, 1.8, 1.2]) == 2
    assert rival_scores([2.0]) == 0
