"""Both renderers are scored on a scene that our own renderer made: the fast one is perfect, the other near
it.
"""

import pytest

import measure_renderers
from lightprobe.core.errors import ConfigError
from lightprobe.render.path_tracer import check_path_tracer
from lightprobe.scene.photo import Scene
from tests.known_scene import SIMILARITY, known_decomposition, write_photo


@pytest.mark.long
def test_true_object_under_novel_lights(tmp_path, monkeypatch):
    try:
        check_path_tracer()
    except ConfigError as missing:
        pytest.skip(str(missing))
    known = known_decomposition()
    monkeypatch.setattr(measure_renderers, "true_asset", lambda scene: known.asset)
    photos = [write_photo(tmp_path, name, known, (1.6, 0.4, 0.5)) for name in ("one", "seven")]
    scene = Scene(tmp_path, "transforms", (), (), tuple(photos), SIMILARITY)
    fast, path = (row.split("|") for row in measure_renderers.rows(scene, None, 256))
    assert (fast[2].strip(), path[2].strip()) == ("fast", "path")
    assert fast[1].strip() == f"{tmp_path.name}, true object"
    assert float(fast[3]) > 60
    assert 30 < float(path[3]) < 60
