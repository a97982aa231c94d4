"""Which reconstruction is kept: that of a background that moves against the object is found out."""

from dataclasses import replace

import numpy as np
import pytest

from lightprobe.core.errors import InputError
from lightprobe.preparation import candidates
from lightprobe.preparation.cache import Cache
from lightprobe.preparation.candidates import SECOND, WHOLE, choose, kept_choice
from lightprobe.preparation.mapping import Lenses, reconstruct
from tests.preparation.ring import SIZE, ball_points, photographed, ring_cameras

pytest.importorskip("pycolmap")
OBJECT, BACKGROUND = 60, 120  # points
PHOTOS, POINTS = 6, 90
TRUE = 300.0  # pixels, of `ring_cameras`


@pytest.fixture
def turned(monkeypatch):
    """Photos of an object and of a background under other cameras, and a stand-in for COLMAP.

    It reconstructs whatever most matches are of, as COLMAP does, and nothing from too few.
    """
    points = ball_points(OBJECT + BACKGROUND)
    cameras, others = ring_cameras(10), [ring_cameras(20, 1.5)[i] for i in range(10)]
    photos, matches, right = photographed(cameras, points)
    shown, _, wrong = photographed(others, points)
    photos = [
        replace(f, points=np.concatenate([f.points[:OBJECT], g.points[OBJECT:]]))
        for f, g in zip(photos, shown, strict=True)
    ]

    def reconstruct(photos, matches, focal, lenses, seed=0):
        rows = np.concatenate(list(matches.values()))
        of_object = (rows[:, 0] < OBJECT).sum()
        most = max(of_object, len(rows) - of_object)
        return [] if most < 100 else [right if 2 * of_object > len(rows) else wrong]

    monkeypatch.setattr(candidates, "reconstruct", reconstruct)
    inside = [np.arange(OBJECT + BACKGROUND) < OBJECT for _ in photos]
    return photos, matches, inside, right, wrong


def test_a_background_that_explains_nothing_of_the_object_is_a_trap(turned):
    photos, matches, inside, right, _ = turned
    found, _ = choose(photos, matches, [None] * 10, inside)
    assert found.kept.name == SECOND
    assert np.array_equal(found.kept.solution.pose, right.pose)
    assert found.kept.fit.explained > 0.95
    assert found.trap.startswith("Trap: the whole photos gave cameras for 10 of 10 photos that explain only")
    assert [candidate.name for candidate in found.tried] == [WHOLE, SECOND]


def test_where_the_object_stands_still_too_the_whole_photos_are_kept(monkeypatch):
    photos, matches, right = photographed(ring_cameras(10), ball_points(OBJECT + BACKGROUND))
    monkeypatch.setattr(candidates, "reconstruct", lambda *arguments: [right])
    found, _ = choose(photos, matches, [None] * 10, None)
    assert found.kept.name == WHOLE
    assert found.trap is None
    assert len(found.tried) == 1


def test_of_two_models_the_one_of_the_object_is_kept(turned, monkeypatch):
    photos, matches, inside, right, wrong = turned
    monkeypatch.setattr(candidates, "reconstruct", lambda *arguments: [wrong, right])
    found, _ = choose(photos, matches, [None] * 10, inside)
    assert found.kept.name == WHOLE
    assert np.array_equal(found.kept.solution.pose, right.pose)
    assert found.kept.apart == (tuple(range(10)),)


def test_photos_that_fit_together_elsewhere_are_kept_by_index(monkeypatch, tmp_path):
    photos, matches, right = photographed(ring_cameras(10), ball_points(OBJECT + BACKGROUND))
    some = np.array([1, 4, 6])
    theirs = np.isin(right.seen_by, some)
    sightings = {name: getattr(right, name)[theirs] for name in ("seen_by", "feature", "seen")}
    cameras = {name: getattr(right, name)[some] for name in ("photo", "pose", "lens", "size")}
    apart = replace(right, **cameras, **sightings)
    monkeypatch.setattr(candidates, "reconstruct", lambda *arguments: [right, apart])
    made = kept_choice(
        Cache(tmp_path), "cameras", "key", lambda: choose(photos, matches, [None] * 10, None)[0]
    )
    again = kept_choice(Cache(tmp_path), "cameras", "key", lambda: pytest.fail("it was kept"))
    assert made.kept.apart == again.kept.apart == ((1, 4, 6),)
    assert made.kept.to_json()["other_models_photos"] == [3]


def test_a_choice_is_made_once(turned, tmp_path):
    photos, matches, inside, _, _ = turned
    first = kept_choice(
        Cache(tmp_path), "cameras", "key", lambda: choose(photos, matches, [None] * 10, inside)[0]
    )
    again = kept_choice(Cache(tmp_path), "cameras", "key", lambda: pytest.fail("it was kept"))
    assert again.trap == first.trap
    assert again.kept.to_json() == first.kept.to_json()
    assert np.array_equal(again.kept.solution.pose, first.kept.solution.pose)
    assert again.kept.lenses is Lenses.BY_SIZE


def test_nothing_at_all_is_one_sentence(turned, monkeypatch):
    photos, matches, inside, _, _ = turned
    monkeypatch.setattr(candidates, "reconstruct", lambda *arguments: [])
    with pytest.raises(InputError, match="No cameras were found"):
        choose(photos, matches, [None] * 10, inside)


def test_photos_whose_files_tell_absurd_lengths_share_the_middle_one():
    """One length far off, as digital zoom writes it, must not lose the photos that tell nothing."""
    cameras = [ring_cameras(24, 0.8 + 0.3 * (i % 2))[i] for i in range(PHOTOS)]
    photos, matches, _ = photographed(cameras, ball_points(POINTS))
    rows = next(iter(matches.values()))
    pairs = {(i, j): rows for i in range(PHOTOS) for j in range(i + 1, PHOTOS)}
    told = [65.0, 1.45, None, 1.55, 0.33, None]
    models = reconstruct(photos, pairs, told, Lenses.BY_SIZE)
    assert list(models[0].photo) == list(range(PHOTOS))
    assert np.ptp(models[0].lens[:, 0]) == 0
    assert models[0].lens[0, 0] == pytest.approx(TRUE, rel=0.02)
    assert models[0].errors.mean() < 0.01 * SIZE
