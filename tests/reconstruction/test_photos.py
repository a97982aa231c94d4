"""Training photos as tensors: their size, their colours under their masks, and their views."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.reconstruction import photos
from lightprobe.reconstruction.photos import load_targets
from lightprobe.scene import load_pixels, load_scene
from lightprobe.scene.support import SupportPlane
from tests.toy_scene import write_toy_scene

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return load_scene(write_toy_scene(tmp_path_factory.mktemp("toy"), train=4, test=1))


@pytest.mark.parametrize("side", [40, 20])
def test_a_target_is_the_photo_over_black_at_its_size(scene, side):
    targets = load_targets(scene, scene.train, side, CPU)
    assert [target.name for target in targets] == [photo.name for photo in scene.train]
    for target, photo in zip(targets, scene.train, strict=True):
        pixels, _ = load_pixels(photo, side)
        assert (target.view.width, target.view.height) == (side, side)
        expected = (pixels.color * pixels.alpha[..., None]).reshape(-1, 3)
        np.testing.assert_array_equal(target.color.numpy(), expected)
        np.testing.assert_array_equal(target.alpha.numpy(), pixels.alpha.reshape(-1))
        assert not target.color[target.alpha == 0].any()
        assert target.clipped.shape == target.color.shape


@pytest.mark.parametrize(("white", "factor"), [(0.92, 1.0), (0.5, 0.5)])
def test_a_mask_that_is_nearly_white_inside_darkens_no_photo(scene, monkeypatch, white, factor):
    (plain,) = load_targets(scene, scene.train[:1], 40, CPU)

    def dimmed(photo, side):
        pixels, camera = load_pixels(photo, side)
        return replace(pixels, alpha=np.float32(white) * pixels.alpha), camera

    monkeypatch.setattr(photos, "load_pixels", dimmed)
    (target,) = load_targets(scene, scene.train[:1], 40, CPU)
    torch.testing.assert_close(target.alpha, factor * plain.alpha)
    torch.testing.assert_close(target.color, factor * plain.color)


def test_views_are_in_the_normalised_frame(scene):
    """There the ball, of radius 1 around the origin in the scene's own, covers what its mask covers."""
    for target in load_targets(scene, scene.train, 40, CPU):
        centre = torch.from_numpy(scene.similarity.apply(np.zeros((1, 3)))).float()
        x, y, _ = target.view.project(centre)[0]
        pixel = torch.arange(1600)
        mass = target.alpha / target.alpha.sum()
        assert float((mass * (pixel % 40 + 0.5)).sum()) == pytest.approx(float(x), abs=0.3)
        assert float((mass * (pixel // 40 + 0.5)).sum()) == pytest.approx(float(y), abs=0.3)


def test_views_know_the_support_of_all_photos_in_the_normalised_frame(scene):
    assert all(target.view.support is None for target in load_targets(scene, scene.train, 20, CPU))
    plane = SupportPlane(np.array([0.0, 0.6, 0.8]), -1.5)
    for target in load_targets(replace(scene, support=plane), scene.train, 20, CPU):
        support = target.view.support
        points = np.array([[3.0, 0.5, -2.0], [0.0, 0.0, 0.0]])
        height = torch.from_numpy(scene.similarity.apply(points)).float() @ support[:3] - support[3]
        np.testing.assert_allclose(height.numpy(), plane.height(points) / scene.similarity.scale, atol=1e-5)
