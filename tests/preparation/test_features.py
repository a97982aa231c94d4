"""Features of a picture are found again where it is shifted, and which pairs are worth matching."""

import shutil
import signal
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d, zoom

from lightprobe.core.errors import ResourceError
from lightprobe.preparation import features, learned
from lightprobe.preparation.features import (
    Features,
    find_features,
    likely_pairs,
    match,
    match_photos,
    moved,
    working_folder,
)

pytest.importorskip("pycolmap")


def test_it_is_new_and_goes_away():
    with working_folder(1000) as folder:
        assert list(folder.iterdir()) == []
        (folder / "database.db").write_bytes(b"x")
    assert not folder.exists()


def test_a_disk_that_would_run_full_is_one_sentence(monkeypatch):
    monkeypatch.setattr(shutil, "disk_usage", lambda path: SimpleNamespace(free=100 << 20))
    with working_folder(30 << 20):
        pass
    with (
        pytest.raises(ResourceError, match=r"has 100 MB free, finding cameras needs 114 MB there; .* TMPDIR"),
        working_folder(50 << 20),
    ):
        pass


@pytest.fixture
def sift(monkeypatch):
    monkeypatch.setattr(learned, "is_installed", lambda: False)


@pytest.fixture(params=["sift", "learned"])
def shifted(request, monkeypatch):
    """Features of a cloudy picture, and of the same 12 pixels further left and darker; learned ones are coarser."""
    if request.param == "sift":
        request.getfixturevalue("sift")
    elif not learned.is_installed():
        pytest.skip("the weights of learned features are not installed")
    rng = np.random.default_rng(0)
    picture = sum(zoom(rng.normal(size=(n, n)), 240 / n, order=1) for n in (12, 30, 60))
    picture = 60 + 120 * (picture - picture.min()) / np.ptp(picture)
    parts = (1.0, picture[:200, :200]), (0.7, picture[:200, 12:212])
    return find_features([(factor * part).astype(np.uint8) for factor, part in parts], [None, None])


def test_matches_are_the_same_places(shifted):
    a, b = shifted
    found = match(a, b)
    shift = a.points[found[:, 0]] - b.points[found[:, 1]]
    assert len(found) > 60
    assert (np.abs(shift - [12, 0]).max(axis=1) < 1.6).mean() > 0.9
    assert moved(a, b, found).all()
    assert not moved(a, a, match(a, a)).any()


@pytest.mark.slow
def test_a_surface_at_a_slant_is_recognised(sift):
    rng = np.random.default_rng(5)
    picture = sum(zoom(rng.normal(size=(n, n)), 400 / n, order=1) for n in (20, 40, 80))
    picture = 60 + 120 * (picture - picture.min()) / np.ptp(picture)
    slant = 0.45  # of its width is left: 63 degrees
    squeezed = zoom(gaussian_filter1d(picture, 0.8, axis=1), (1, slant), order=1)
    a, b = find_features([picture.astype(np.uint8), squeezed.astype(np.uint8)], [None, None])
    found = match(a, b)
    off = np.abs(a.points[found[:, 0]] * [slant, 1] - b.points[found[:, 1]]).max(axis=1)
    assert (off < 2).sum() > 300


def test_what_may_not_be_matched_takes_no_match(shifted):
    a, b = shifted
    left = a.points[:, 0] < 100
    found = match_photos([a, b], [left, np.ones(len(b.points), bool)])[0, 1]
    assert len(found) > 20
    assert left[found[:, 0]].all()
    shift = a.points[found[:, 0]] - b.points[found[:, 1]]
    assert (np.abs(shift - [12, 0]).max(axis=1) < 1.6).mean() > 0.8


def test_of_many_photos_each_is_matched_with_its_likest(monkeypatch):
    monkeypatch.setattr(features, "PARTNERS", 2)
    monkeypatch.setattr(features, "EVERY", 4)
    rng = np.random.default_rng(1)
    kinds = rng.integers(0, 120, (2, 40, 128))

    def photo(i):
        points = rng.uniform(0, 100, (40, 2)).astype(np.float32)
        return Features(points, (kinds[i % 2] + rng.integers(0, 3, (40, 128))).astype(np.uint8), 100, 100)

    photos = [photo(i) for i in range(6)]
    assert likely_pairs(photos) == [(0, 2), (0, 4), (1, 3), (1, 5), (2, 4), (3, 5)]
    assert len(likely_pairs(photos[:4])) == 6


def test_a_picture_without_anything_has_no_features():
    empty, tiny = find_features(
        [np.full((60, 60), 128, np.uint8), np.full((1, 3), 128, np.uint8)], [None, None]
    )
    assert (empty.width, tiny.width, tiny.height) == (60, 3, 1)
    assert tiny.points.shape == (0, 2)
    assert empty.points.shape == (0, 2)
    assert match(empty, empty).shape == (0, 2)
    assert find_features([], []) == []
    flat = find_features([np.full((10, 200), 9, np.uint8)] * 2, [None, (20.0, 30.0, 0.0, 10.0)])
    assert [len(each.points) for each in flat] == [0, 0]


def test_a_detail_brings_features_of_its_own_that_match_those_of_another_detail():
    if not learned.is_installed():
        pytest.skip("the weights of learned features are not installed")
    rng = np.random.default_rng(2)
    picture = np.full((480, 640), 110.0)
    picture[200:280, 300:380] = 40 + 160 * zoom(rng.random((40, 40)), 2, order=0)
    moved_on = np.roll(picture, (60, -150), (0, 1))
    boxes = (290.0, 390.0, 190.0, 290.0), (140.0, 240.0, 250.0, 350.0)
    found = find_features([each.astype(np.uint8) for each in (picture, moved_on)], boxes)
    for each, (left, right, top, bottom) in zip(found, boxes, strict=True):
        x, y = each.points[each.close].T
        assert ((x >= left) & (x <= right) & (y >= top) & (y <= bottom)).all()
        assert each.close.sum() > 1.5 * (~each.close).sum()
    rows = match(*found)
    assert (found[0].close[rows[:, 0]] == found[1].close[rows[:, 1]]).all()
    close = rows[found[0].close[rows[:, 0]]]
    shift = found[0].points[close[:, 0]] - found[1].points[close[:, 1]]
    assert len(close) > 60
    assert (np.abs(shift - [150, -60]).max(axis=1) < 1.0).mean() > 0.9
    fewer = found[0].select(found[0].points[:, 0] < 340)
    assert fewer.close.sum() < found[0].close.sum()
    assert match(fewer, found[1])[:, 0].max() < len(fewer.points)


def test_the_largest_blobs_are_kept_whichever_way_they_are_turned(monkeypatch):
    monkeypatch.setattr(features, "MOST", 2)
    size, angle = np.array([1.5, 4.0, 2.0, 3.0]), np.array([3.1, 0.1, -3.0, 0.2])
    turned = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], 1) * size[:, None]
    turned *= np.array(
        [[3, 1 / 3] * 2, [1 / 3, 3] * 2, [1, 1] * 2, [1 / 3, 3] * 2]
    )  # ellipses of the same area
    table = np.concatenate([np.arange(8.0).reshape(4, 2), turned], 1)
    stored = SimpleNamespace(
        exists_image=lambda name: True,
        read_image_with_name=lambda name: SimpleNamespace(image_id=1),
        read_keypoints=lambda number: table,
        read_descriptors=lambda number: SimpleNamespace(data=np.arange(4)[:, None].repeat(128, 1)),
    )
    kept = features._stored(stored, "0.png", np.zeros((10, 20), np.uint8))
    assert kept.points.tolist() == [[2, 3], [6, 7]]
    assert kept.descriptors[:, 0].tolist() == [1, 3]


def test_a_preparation_that_is_ended_prints_no_trace():
    words = "import os; from lightprobe.preparation.features import pycolmap_library as load; load(); os.kill(os.getpid(), 15)"
    ended = subprocess.run([sys.executable, "-c", words], capture_output=True, check=False)
    assert ended.returncode == -signal.SIGTERM
    assert ended.stderr == b""
