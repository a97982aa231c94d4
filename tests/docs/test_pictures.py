"""The pictures of the conventions are those that the program's own functions draw."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def pictures():
    spec = importlib.util.spec_from_file_location("make_pictures", DOCS / "make_pictures.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["axes", "equirect", "cubemap", "pixels"])
def test_the_stored_picture_is_the_drawn_one(pictures, name):
    drawn, stored = pictures.PICTURES[name](), Image.open(DOCS / "pictures" / f"{name}.png")
    assert stored.size == drawn.size
    difference = np.abs(np.asarray(drawn.convert("RGB"), float) - np.asarray(stored.convert("RGB"), float))
    assert difference.mean() < 1, "run python docs/make_pictures.py and look at what has changed"


def test_they_are_small(pictures):
    assert {path.stem for path in (DOCS / "pictures").iterdir()} == set(pictures.PICTURES)
    assert max(path.stat().st_size for path in (DOCS / "pictures").iterdir()) < 150_000
