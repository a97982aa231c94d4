"""Photos that are what they are taken for, and the ways in which they are not."""

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
import torch

from lightprobe.core.errors import InputError
from lightprobe.imaging import srgb_decode, srgb_encode
from lightprobe.models import LightAccuracy, ObjectVerdict
from lightprobe.prediction import Method, PhotoStatus, PredictConfig, Predictor
from lightprobe.prediction.observation import observe
from lightprobe.prediction.verdict import _STRENGTH, _fitted, judge
from lightprobe.scene.photo import Pixels
from tests.lit_sphere import CPU, PATCHES, patch_light, photograph
from tests.shapes import camera_at

PLACE = np.array([2.6, 1.4, 1.2])
CAMERA = camera_at(tuple(PLACE), size=96, focal=128.0)


@pytest.fixture(scope="module")
def predictor(decomposition):
    return Predictor(decomposition, config=PredictConfig(light_resolution=16))


def eight_bit(photo, displayed):
    """Return the photo with other sRGB values (H, W, 3) in [0, 1], as an 8-bit file would hold them."""
    color = srgb_decode(np.round(np.clip(displayed, 0, 1) * 255) / 255)
    return Pixels.of(np.where(photo.alpha[..., None] > 0, color, 0).astype(np.float32), photo.alpha)


@pytest.fixture(scope="module")
def photo(predictor):
    taken = photograph(predictor.decomposition.asset, CAMERA, patch_light((0.2, 1.0, 0.5)))
    mean = taken.color[taken.alpha > 0].mean()
    return eight_bit(taken, srgb_encode(0.2 / mean * taken.color))


def verdict_on(predictor, photo, camera=CAMERA):
    return judge(observe(predictor.decomposition.asset, photo, camera, CPU, 65_536), seed=0)


def random_like(photo, channels=3):
    shape = (*photo.alpha.shape, channels)
    return np.broadcast_to(np.random.default_rng(0).random(shape), photo.color.shape)


def other_object(photo):
    """Return displayed stripes, shaded like a ball lit from the left."""
    x = np.linspace(-1, 1, photo.alpha.shape[1])
    shade = np.broadcast_to(0.5 - 0.4 * x, photo.alpha.shape)
    stripes = 0.4 + 0.6 * (np.sin(40 * x)[:, None] > 0)
    return (shade * stripes)[..., None] * np.array([1.0, 0.8, 0.5])


UNREADABLE = {
    "black": lambda photo: 0 * photo.color,
    "nearly black": lambda photo: random_like(photo) * 2 / 255,
    "white": lambda photo: 0 * photo.color + 1,
    "grey": lambda photo: 0 * photo.color + 0.5,
    "noise": random_like,
    "grey noise": lambda photo: random_like(photo, 1),
    "negative": lambda photo: 1 - srgb_encode(photo.color),
}
SENTENCES = {"black": "black in this photo", "white": "100 % of the object's values are clipped"}


@pytest.mark.parametrize("kind", UNREADABLE)
def test_a_photo_that_no_light_explains_is_refused(predictor, photo, kind):
    spoilt = eight_bit(photo, UNREADABLE[kind](photo))
    with pytest.raises(
        InputError, match=SENTENCES.get(kind, "No light makes this object look like this photo")
    ):
        predictor.predict(spoilt, CAMERA)


@pytest.mark.parametrize("direction", PATCHES)
def test_good_photos_are_good_and_keep_their_confidence(predictor, direction):
    good = photograph(predictor.decomposition.asset, CAMERA, patch_light(direction))
    prediction = predictor.predict(good, CAMERA)
    assert prediction.verdict.status is PhotoStatus.GOOD
    assert prediction.verdict.sentences == ()
    assert prediction.verdict.offset < 0.003
    assert prediction.verdict.doubt == 0


def moved(vector):
    pose = CAMERA.camera_to_world.copy()
    pose[:3, 3] += pose[:3, :3] @ np.array(vector)
    return replace(CAMERA, camera_to_world=pose)


def turned(angle):
    """Return the camera as if the object had been turned about the vertical axis."""
    c, s = np.cos(angle), np.sin(angle)
    pose = CAMERA.camera_to_world.copy()
    pose[:3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ pose[:3]
    return replace(CAMERA, camera_to_world=pose)


def swapped(photo):
    return srgb_encode(photo.color)[..., [1, 2, 0]]


DOUBTFUL = {
    "moved": (lambda photo: photo, moved([0.05, 0, 0]), "0.05 object radii beside"),
    "turned": (lambda photo: photo, turned(0.2), "of what this photo shows"),
    "colours swapped": (lambda photo: eight_bit(photo, swapped(photo)), CAMERA, "Light explains only"),
    "another object": (lambda photo: eight_bit(photo, other_object(photo)), CAMERA, "of what this photo"),
    "too bright": (lambda photo: eight_bit(photo, srgb_encode(8 * photo.color)), CAMERA, "clipped to white"),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", DOUBTFUL)
def test_a_doubtful_photo_is_named_so_and_trusted_less(predictor, photo, kind):
    change, camera, sentence = DOUBTFUL[kind]
    good, doubtful = predictor.predict(photo, CAMERA), predictor.predict(change(photo), camera)
    assert good.verdict.status is PhotoStatus.GOOD
    assert doubtful.verdict.status is PhotoStatus.DOUBTFUL
    assert any(sentence in said for said in doubtful.verdict.sentences)
    assert float(doubtful.confidence.mean()) < 0.85 * float(good.confidence.mean())


def test_the_verdict_is_the_photos_not_the_methods(predictor, photo):
    verdicts = [
        predictor.predict(photo, CAMERA, method).verdict for method in (Method.CONSTANT, Method.SOLVE)
    ]
    assert verdicts[0] == verdicts[1] == verdict_on(predictor, photo)


def test_exposure_does_not_matter(predictor, photo):
    one, other = (
        verdict_on(predictor, Pixels.of(factor * photo.color, photo.alpha)) for factor in (0.5, 0.05)
    )
    assert one.explained == pytest.approx(other.explained, abs=1e-3)
    assert one.residual == pytest.approx(other.residual, rel=1e-2)
    assert one.status is other.status is PhotoStatus.GOOD


def of_lights(predictor, directions):
    """Return photos of the ball from around it, each under a light from one of the directions."""
    cameras = [
        camera_at((3.0 * math.cos(a), 3.0 * math.sin(a), 1.2), size=96, focal=128.0) for a in (0.0, 0.9, 1.8)
    ]
    asset = predictor.decomposition.asset
    return [
        (photograph(asset, camera, patch_light(direction)), camera)
        for camera, direction in zip(cameras, directions, strict=True)
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("others", "status"), [((0.2, 1.0, 0.5), PhotoStatus.GOOD), ((-0.6, -1.0, 0.4), PhotoStatus.DOUBTFUL)]
)
def test_photos_of_different_lights_are_not_of_one(predictor, others, status):
    views = of_lights(predictor, [(0.2, 1.0, 0.5), others, others])
    verdict = predictor.predict_together(views, Method.CONSTANT)[0].verdict
    assert verdict.status is status
    assert (verdict.apart > 0.5) == (status is PhotoStatus.DOUBTFUL)
    warned = any(sentence.startswith("One light for all misses") for sentence in verdict.sentences)
    assert warned == (status is PhotoStatus.DOUBTFUL)
    assert predictor.predict(*views[0]).verdict.apart is None


def test_the_offset_is_the_move_across_the_view(predictor, photo):
    nearer = 1 / (1 - 1 / np.square(PLACE).sum())  # a ball's outline lies nearer than its middle
    for move in ([0.04, 0, 0], [0, -0.03, 0], [0.03, 0.04, 0]):
        offset = verdict_on(predictor, photo, moved(move)).offset
        assert offset == pytest.approx(nearer * np.linalg.norm(move), rel=0.07)
    assert verdict_on(predictor, photo, moved([0, 0, 0.05])).offset < 0.003


def test_the_fit_is_that_of_non_negative_least_squares():
    random = torch.Generator().manual_seed(3)
    matrix = torch.rand(3, 60, 12, generator=random)
    observed = matrix @ (torch.rand(3, 12, 1, generator=random) - 0.4).clamp(min=0)
    observed = observed[..., 0] + 0.1 * torch.rand(3, 60, generator=random)
    weight = torch.rand(2, 3, 60, generator=random)
    found = _fitted(matrix, observed, weight, torch.tensor(0.3))
    assert float(found.min()) >= 0

    def objective(light, half, c):
        w = (weight[half, c] / weight[half, c].sum()).double().numpy()
        a, y = matrix[c].double().numpy(), observed[c].double().numpy()
        pull = _STRENGTH * (w * a.sum(1) ** 2).sum() / 12
        rows = np.concatenate([np.sqrt(w)[:, None] * a, np.sqrt(pull) * np.eye(12)])
        sought = np.concatenate([np.sqrt(w) * y, np.full(12, 0.3 * np.sqrt(pull))])
        best = scipy.optimize.nnls(rows, sought)[0]
        return [float(np.square(rows @ each - sought).sum()) for each in (light, best)]

    for half in range(2):
        for c in range(3):
            ours, least = objective(found[half, c].double().numpy(), half, c)
            assert least <= ours * (1 + 1e-6) < 1.02 * least


@pytest.mark.slow
@pytest.mark.parametrize(("disagreement", "share"), [(0.03, 1.0), (0.12, math.exp(-0.3))])
def test_maps_of_a_poor_object_are_trusted_less(predictor, photo, disagreement, share):
    object_ = replace(predictor.decomposition, verdict=ObjectVerdict(disagreement, 5))
    judged = Predictor(object_, config=predictor.config).predict(photo, CAMERA)
    plain = predictor.predict(photo, CAMERA)
    assert torch.equal(judged.environment.texels, plain.environment.texels)
    assert torch.allclose(judged.confidence, share * plain.confidence)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "scale"), [(Method.SOLVE, 0.5), (Method.CONSTANT, 2.0)])
def test_the_confidence_follows_the_accuracy_of_the_objects_maps(predictor, photo, method, scale):
    accuracy = LightAccuracy("solve", 16, 0.5, (0.1, 0.2, 0.6), fitted_scale=0.5, estimated_scale=2.0)
    known = Predictor(predictor.decomposition, config=predictor.config, accuracy=accuracy)
    plain = predictor.predict(photo, CAMERA, method)
    assert torch.allclose(known.predict(photo, CAMERA, method).confidence, plain.confidence**scale)
