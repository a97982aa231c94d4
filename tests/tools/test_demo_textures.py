import numpy as np
import pytest

from demo_scene.geometry import coffee_pot
from demo_scene.textures import ATLAS, TILES, atlas_uv, paint

PARTS = coffee_pot()
ATLAS_MAPS = paint(PARTS, seed=3)


def test_values_are_reflectances():
    for array in (ATLAS_MAPS.base, ATLAS_MAPS.roughness, ATLAS_MAPS.metallic):
        assert np.isfinite(array).all()
        assert array.min() >= 0
        assert array.max() <= 1


def test_there_is_matte_glossy_and_metal():
    row, column, rows, columns = TILES["body"]
    body = np.s_[row : row + rows, column : column + columns]
    assert ATLAS_MAPS.metallic[body].max() == 0
    assert (ATLAS_MAPS.roughness[body] < 0.25).mean() > 0.3
    assert (ATLAS_MAPS.roughness[body] > 0.75).mean() > 0.1
    assert 0.1 < (ATLAS_MAPS.metallic > 0.99).mean() < 0.4


def test_patterns_close_at_the_seam():
    for row, column, rows, columns in TILES.values():
        tile = ATLAS_MAPS.base[row : row + rows, column : column + columns]
        # Two margin texels on either side: the texel after the last of the pattern is its first again.
        np.testing.assert_allclose(tile[:, 2], tile[:, columns - 2], atol=1e-9)


def test_parts_use_disjoint_tiles():
    taken = np.zeros((ATLAS, ATLAS), int)
    for part in PARTS:
        row, column, rows, columns = TILES[part.name]
        taken[row : row + rows, column : column + columns] += 1
        uv = atlas_uv(part.name, part.uv) * ATLAS
        assert (uv >= [column + 1, row + 1]).all()
        assert (uv <= [column + columns - 1, row + rows - 1]).all()
    assert taken.max() == 1


@pytest.mark.slow
def test_same_seed_same_paint():
    again = paint(PARTS, seed=3)
    assert np.array_equal(again.base, ATLAS_MAPS.base)
    assert not np.array_equal(paint(PARTS, seed=4).base, ATLAS_MAPS.base)
