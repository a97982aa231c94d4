"""Cameras are compared after the similarity that fits them, and masks by what they share."""

import json

import numpy as np
import pytest

from lightprobe.imaging import write_png
from measure_prepare import compare, mask_overlaps, similarity
from tests.shapes import camera_at
from turntable_photos import render, write


def test_a_similarity_is_found_back_whatever_one_camera_does():
    rng = np.random.default_rng(0)
    points = rng.normal(size=(20, 3))
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    moved = 2.5 * points @ turn.T + [1, 2, 3]
    moved[4] += 30
    found, scale, shift = similarity(points, moved)
    assert np.allclose(found, turn)
    assert scale == pytest.approx(2.5)
    assert np.allclose(shift, [1, 2, 3])


def test_errors_are_degrees_and_percent_of_the_distance():
    angles = np.linspace(0, 2 * np.pi, 13)[:-1]
    true = {f"{i}": camera_at((4 * np.cos(a), 4 * np.sin(a), 1.0)) for i, a in enumerate(angles)}
    turned, moved = compare(true, true)
    assert max(turned.max(), moved.max()) < 1e-4
    found = {name: camera.resized(64, 64) for name, camera in true.items()}
    pose = found["3"].camera_to_world.copy()
    pose[:3, 3] *= 1.02
    found["3"].camera_to_world[:] = pose
    true = {f"{i}": camera_at((4 * np.cos(a), 4 * np.sin(a), 1.0)) for i, a in enumerate(angles)}
    assert compare(found, true)[1].max() == pytest.approx(2, rel=0.1)


def test_overlap_is_intersection_over_union(tmp_path):
    left, middle = np.zeros((2, 40, 40, 3))
    left[:, :20], middle[:, 10:30] = 1, 1
    write_png(tmp_path / "masks" / "a.png", left)
    write_png(tmp_path / "true.png", middle)
    (tmp_path / "transforms.json").write_text(json.dumps({"frames": [{"mask_path": "masks/a.png"}]}))
    assert mask_overlaps(tmp_path, {"a": tmp_path / "true.png"})[0] == pytest.approx(1 / 3)


def test_the_background_of_the_turntable_stays_and_its_object_turns(tmp_path):
    photos = render(3, 64)
    outside = np.min([photo.alpha == 0 for photo in photos], axis=0)
    first, second = (photo.color[outside] for photo in photos[:2])
    assert np.corrcoef(first.ravel(), second.ravel())[0, 1] > 0.9
    inside = np.min([photo.alpha == 1 for photo in photos], axis=0)
    assert np.corrcoef(photos[0].color[inside].ravel(), photos[1].color[inside].ravel())[0, 1] < 0.5
    write(photos, tmp_path)
    assert len(list((tmp_path / "images").iterdir())) == len(list((tmp_path / "true_masks").iterdir())) == 3
