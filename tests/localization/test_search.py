"""Looking everywhere for the object."""

import numpy as np
import pytest

from lightprobe.localization.pose import mean_distance
from lightprobe.localization.search import search, sighted_camera


def test_the_object_is_sighted_where_it_is(asset, views, camera, photo):
    points = asset.mesh.vertices[::20].double().numpy()
    sightings = search(photo[0], views.templates, 8)
    assert [s.score for s in sightings] == sorted((s.score for s in sightings), reverse=True)
    found = [sighted_camera(s, views.templates, camera.fx, camera.width, camera.height) for s in sightings]
    errors = [mean_distance(one, camera, points) for one in found]
    assert min(errors[:4]) < 10  # of 128 pixels: near enough to be refined


@pytest.mark.slow
def test_a_photo_twice_as_dark_gives_the_same_sightings(views, photo):
    bright, dark = (search(factor * photo[0], views.templates, 3) for factor in (1.0, 0.5))
    assert bright[0].view == dark[0].view
    assert np.allclose(bright[0].center, dark[0].center, atol=0.05)


def test_a_sighted_camera_has_the_object_in_its_place(views):
    from lightprobe.localization.search import Sighting

    sighting = Sighting(1.0, 0, (0.3, 0.4), 0.5)
    camera = sighted_camera(sighting, views.templates, 150.0, 200, 160)
    assert np.allclose(camera.project(np.zeros((1, 3)))[0, :2], [60, 80])
    camera.check("found")
