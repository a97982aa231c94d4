"""The plane that the object stands on: where a scene gives it, and whether all places have the same."""

import json
import math

import numpy as np
import pytest

from lightprobe.core.errors import InputError
from lightprobe.scene import load_scene
from lightprobe.scene.support import SupportPlane, common_support
from tests.toy_scene import write_toy_scene


def written(folder, supports, groups=("hall", "hall", "garden", "garden")):
    """Write a scene of four photos in two places, and return its folder."""
    root = write_toy_scene(folder, train=4, test=1)
    file = root / "transforms_train.json"
    data = json.loads(file.read_text())
    for frame, group in zip(data["frames"], groups, strict=True):
        frame["light_group"] = group
    data["supports"] = supports
    file.write_text(json.dumps(data))
    return root


def plane(z, tilt=0.0):
    return {"normal": [math.sin(tilt), 0, math.cos(tilt)], "offset": z}


def test_photos_have_the_plane_of_their_place(tmp_path):
    scene = load_scene(
        written(tmp_path, {"hall": plane(-1.0), "garden": {"normal": [0, 0, 2], "offset": -2.02}})
    )
    offsets = [photo.support.offset for photo in scene.train]
    assert offsets == pytest.approx([-1, -1, -1.01, -1.01])
    assert scene.support is not None
    np.testing.assert_allclose(scene.support.normal, [0, 0, 1])
    assert scene.support.offset == pytest.approx(-1.005)
    assert (
        load_scene(written(tmp_path / "one", {"hall": plane(-1.0)})).support is None
    )  # nothing of the garden


@pytest.mark.parametrize("other", [plane(-0.8), plane(-1.0, math.radians(8)), None])
def test_planes_that_lie_apart_are_no_common_one(other):
    def of(value):
        return value and SupportPlane.from_json(value, source="a test")

    same = of(plane(-1.0))
    assert common_support([same, of(plane(-1.02, math.radians(1))), None], 1.0) is not None
    assert common_support([same, of(other)], 1.0) is None
    assert common_support([], 1.0) is None


@pytest.mark.parametrize(
    "value",
    [
        [0, 0, 1],
        {"normal": [0, 0, 0], "offset": 1},
        {"normal": [0, 1], "offset": 1},
        {"normal": ["up", 0, 1], "offset": 1},
        {"normal": [0, 0, 1], "offset": math.inf},
        {"normal": [0, 0, 1]},
    ],
)
def test_what_is_no_plane_is_told(tmp_path, value):
    expected = (
        r"light group hall: a support must have a 'normal' of three numbers that are not all 0, and a finite"
    )
    with pytest.raises(InputError, match=expected):
        load_scene(written(tmp_path, {"hall": value}))


def test_supports_name_light_groups(tmp_path):
    with pytest.raises(InputError, match="'supports' must name a plane for each light group, not"):
        load_scene(written(tmp_path, [plane(-1.0)]))
