"""The pictures of a view and the names of its scores, of an evaluation that has the truth of everything."""

import base64
import dataclasses
import io

import numpy as np
import pytest
import torch
from PIL import Image

from lightprobe.evaluation import evaluate
from lightprobe.prediction import Method
from lightprobe.prediction.confidence import confidence_colors
from lightprobe.report import view_pictures
from lightprobe.report.headings import IMAGES, LIGHTS, MAPS, OBJECT
from lightprobe.report.pictures import PICTURE_NOTES
from tests.known_scene import CPU, known_scene


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory):
    decomposition, scene = known_scene(tmp_path_factory.mktemp("known"))
    views = []
    result = evaluate(decomposition, None, scene, methods=(Method.SOLVE,), device=CPU, on_view=views.append)
    return result, views


@pytest.mark.slow
def test_every_score_has_a_heading(evaluated):
    result = evaluated[0]
    assert result.truth.keys() == OBJECT.keys()
    named = (IMAGES | LIGHTS | MAPS).keys()
    assert {name for name in result.mean(Method.SOLVE) if not name.endswith("n_rmse")} == named


def test_pictures_of_a_view_are_complete(evaluated):
    titles = list(view_pictures(evaluated[1][0]))
    assert titles == [
        "photo",
        "render",
        "difference ×3",
        "base colour",
        "roughness",
        "metallic",
        "normal",
        "predicted light",
        "true light",
        "confidence",
        "spheres, predicted light",
        "spheres, true light",
    ]
    assert titles == list(PICTURE_NOTES)


def test_the_picture_of_the_confidence_has_the_colors_of_its_scale(evaluated):
    view = evaluated[1][0]
    sure = dataclasses.replace(view.prediction, confidence=torch.full_like(view.prediction.confidence, 0.5))
    encoded = view_pictures(dataclasses.replace(view, prediction=sure))["confidence"].partition(",")[2]
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(encoded)))) / 255
    assert np.abs(picture - confidence_colors(np.array(0.5))).max() < 0.02
