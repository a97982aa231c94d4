"""Small pictures of the object and what light can do to them."""

import numpy as np
import pytest
import torch

from lightprobe.localization.appearance import appearance
from lightprobe.localization.pose import mean_distance
from lightprobe.localization.templates import (
    SIDE,
    centred,
    detected_camera,
    make_templates,
    search,
    views_around,
)
from tests.painted_object import CPU, photo_of, view_from


def test_views_surround_the_cameras_and_nothing_else():
    cameras = [view_from((2.5, 0.3, 0.8)), view_from((0.2, 2.5, 0.8))]
    views = views_around(cameras, spacing=10, reach=20)
    known = [camera.position / np.linalg.norm(camera.position) for camera in cameras]
    angles = [
        np.degrees(np.arccos(max(v.position @ k / np.linalg.norm(v.position) for k in known))) for v in views
    ]
    assert 12 <= len(views) <= 40
    assert max(angles) <= 20
    for camera in cameras:  # nowhere is the next view farther than about their spacing
        nearest = (
            max(view.position @ camera.position for view in views) / np.linalg.norm(camera.position) ** 2
        )
        assert nearest > np.cos(np.radians(9))


def test_a_centred_view_keeps_place_and_roll_and_sees_all():
    camera = view_from((2.5, 0.3, 0.8), shift=0.4)
    view = centred(camera)
    assert np.allclose(view.position, camera.position)
    assert np.allclose(view.project(np.zeros((1, 3)))[0, :2], 0.5 * view.width)
    assert view.camera_to_world[2, 1] > 0.8  # upright
    edge = camera.camera_to_world[:3, 0]
    assert view.project(np.stack([edge, -edge]))[:, 0].min() > 0


def test_other_lights_stay_within_what_light_can_do(asset):
    """Of what another light changes in the log luma, most lies in the template's span."""
    camera = view_from((2.5, 1.0, 1.0))
    templates = make_templates(asset, [camera], CPU)
    mask = templates.mask[0].bool()
    assert 0.2 * SIDE**2 < mask.sum() < 0.7 * SIDE**2
    ways = templates.lights[0][:, mask].float()
    assert torch.allclose(ways @ ways.T, torch.eye(len(ways)), atol=0.02)
    color, _ = photo_of(asset, centred(camera), 4)
    seen = torch.from_numpy(color.reshape(SIDE, 2, SIDE, 2, 3).mean((1, 3)))
    change = (appearance(seen)[..., 0] - templates.mean[0, 0].float())[mask]
    change = change - change.mean()
    left = change - ways.T @ (ways @ change)
    assert left.square().sum() < 0.35 * change.square().sum()
    assert templates.edges[0].float().norm(dim=0).sum().isclose(torch.tensor(1.0), atol=0.01)


def test_the_object_is_sighted_where_it_is(asset, views, camera, photo):
    points = asset.mesh.vertices[::20].double().numpy()
    detections = search(photo[0], views.templates, 8)
    assert [s.score for s in detections] == sorted((s.score for s in detections), reverse=True)
    found = [detected_camera(s, views.templates, camera.fx, camera.width, camera.height) for s in detections]
    errors = [mean_distance(one, camera, points) for one in found]
    assert min(errors[:4]) < 10  # of 128 pixels: near enough to be refined


@pytest.mark.slow
def test_a_photo_twice_as_dark_gives_the_same_sightings(views, photo):
    bright, dark = (search(factor * photo[0], views.templates, 3) for factor in (1.0, 0.5))
    assert bright[0].view == dark[0].view
    assert np.allclose(bright[0].center, dark[0].center, atol=0.05)


def test_a_sighted_camera_has_the_object_in_its_place(views):
    from lightprobe.localization.templates import Detection

    detection = Detection(1.0, 0, (0.3, 0.4), 0.5)
    camera = detected_camera(detection, views.templates, 150.0, 200, 160)
    assert np.allclose(camera.project(np.zeros((1, 3)))[0, :2], [60, 80])
    camera.check("found")
