import numpy as np
import pytest

from demo_scene.models import Model, Subject, make_model
from demo_scene.textures import ATLAS, POT_TILES, atlas_uv

POT = make_model(Subject.COFFEE_POT, seed=3)
ATLAS_MAPS = POT.material


@pytest.fixture(scope="module", params=list(Subject))
def model(request) -> Model:
    return make_model(request.param, seed=3)


@pytest.mark.slow
def test_values_are_reflectances(model):
    for array in (model.material.base, model.material.roughness, model.material.metallic):
        assert np.isfinite(array).all()
        assert array.min() >= 0
        assert array.max() <= 1


def test_there_is_matte_glossy_and_metal():
    row, column, rows, columns = POT_TILES["body"]
    body = np.s_[row : row + rows, column : column + columns]
    assert ATLAS_MAPS.metallic[body].max() == 0
    assert (ATLAS_MAPS.roughness[body] < 0.25).mean() > 0.3
    assert (ATLAS_MAPS.roughness[body] > 0.75).mean() > 0.1
    assert 0.1 < (ATLAS_MAPS.metallic > 0.99).mean() < 0.4


def test_patterns_close_at_the_seam(model):
    for row, column, rows, columns in model.tiles.values():
        tile = model.material.base[row : row + rows, column : column + columns]
        # Two margin texels on either side: the texel after the last of the pattern is its first again.
        np.testing.assert_allclose(tile[:, 2], tile[:, columns - 2], atol=1e-9)


def test_parts_use_disjoint_tiles(model):
    taken = np.zeros((ATLAS, ATLAS), int)
    for part in model.parts:
        row, column, rows, columns = model.tiles[part.name]
        taken[row : row + rows, column : column + columns] += 1
        uv = atlas_uv(model.tiles[part.name], part.uv) * ATLAS
        assert (uv >= [column + 1, row + 1]).all()
        assert (uv <= [column + columns - 1, row + rows - 1]).all()
    assert taken.max() == 1


def painted(model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Base colour (N, 3), roughness and metallic (N,) of the texels that belong to some part."""
    tiles = [
        np.s_[row : row + rows, column : column + columns]
        for row, column, rows, columns in model.tiles.values()
    ]
    atlas = model.material
    return tuple(
        np.concatenate([array[tile].reshape(-1, *array.shape[2:]) for tile in tiles])
        for array in (atlas.base, atlas.roughness, atlas.metallic)
    )


def test_the_car_is_near_black_metal_with_neutral_panels():
    base, roughness, metallic = painted(make_model(Subject.TOY_CAR, seed=3))
    assert base.max() <= 0.085
    assert base.mean() < 0.045
    assert metallic.min() >= 0.7
    assert 0.2 <= roughness.min() < roughness.max() <= 0.42
    neutral = np.ptp(base, axis=1) < 0.003
    assert 0.2 < neutral.mean() < 0.8


@pytest.mark.slow
def test_the_camera_is_near_black_and_matte():
    base, roughness, metallic = painted(make_model(Subject.CAMERA, seed=3))
    assert base.max() <= 0.055
    assert metallic.max() == 0
    assert 0.45 <= roughness.min() < roughness.max() <= 0.85
    assert np.quantile(np.ptp(base, axis=1), 0.5) > 0.01  # slightly coloured


@pytest.mark.slow
def test_a_third_of_the_lantern_is_twenty_times_brighter_than_the_rest():
    lantern = make_model(Subject.LANTERN, seed=3)
    share, dark, bright = 0.0, [], []
    area = 0.0
    for part in lantern.parts:
        corners = part.vertices[part.faces]
        size = (
            np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        )
        x, y = (atlas_uv(lantern.tiles[part.name], part.uv[part.faces].mean(axis=1)) * ATLAS).astype(int).T
        color = lantern.material.base[y, x].mean(axis=1)
        share, area = share + size[color > 0.3].sum(), area + size.sum()
        dark.append(color[color < 0.1])
        bright.append(color[color > 0.3])
    assert 0.25 < share / area < 0.42
    assert np.median(np.concatenate(bright)) > 20 * np.median(np.concatenate(dark))
    assert lantern.material.metallic[: 3 * 256].max() == 0


@pytest.mark.slow
def test_same_seed_same_paint():
    again = make_model(Subject.COFFEE_POT, seed=3).material
    assert np.array_equal(again.base, ATLAS_MAPS.base)
    assert not np.array_equal(make_model(Subject.COFFEE_POT, seed=4).material.base, ATLAS_MAPS.base)
