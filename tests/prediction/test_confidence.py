import numpy as np
import pytest
import torch

from lightprobe.light import cubemap, prefilter
from lightprobe.light.photometry import relative_tone_weight
from lightprobe.prediction.confidence import (
    CAUSES,
    RANGE,
    TICKS,
    Weights,
    _evidence,
    confidence,
    confidence_colors,
    css_gradient,
    error_causes,
    ticks,
)
from lightprobe.prediction.observation import observe
from lightprobe.render.transport import Transport
from tests.lit_sphere import CPU, glossy_sphere, patch_light, photograph
from tests.shapes import camera_at

CAMERA = camera_at((2.6, 1.4, 1.2), size=48, focal=64.0)
FRONT = torch.nn.functional.normalize(torch.tensor(CAMERA.camera_to_world[:3, 2], dtype=torch.float32), dim=0)
LUMA = np.array([0.2126, 0.7152, 0.0722])


@pytest.fixture(scope="module")
def observation():
    asset = glossy_sphere()
    return observe(asset, photograph(asset, CAMERA, patch_light((0.2, 1.0, 0.5))), CAMERA, CPU, 65_536)


def flat(value: float = 0.7) -> torch.Tensor:
    return torch.full((6, 16, 16, 3), value)


@pytest.fixture
def weighty(monkeypatch):
    """Weights under which every cause but the first counts clearly, whatever those in use were last fitted
    to.
    """
    weights = Weights(unseen=0.0, unpinned=0.15, bright=0.25, dark=0.20, rough=0.40, least=0.52)
    monkeypatch.setattr("lightprobe.prediction.confidence.FITTED", weights)


@pytest.mark.usefixtures("weighty")
def test_what_the_object_shows_is_trusted_more(observation):
    trust = confidence(observation, flat(), fitted=True, seed=0)
    towards = cubemap.directions(16) @ FRONT
    front, back = towards > 0.5, towards < -0.9
    assert trust.shape == (6, 16, 16)
    assert 0 < float(trust.min()) < float(trust.max()) < 1
    assert float(trust[front].mean()) > 1.02 * float(trust[back].mean())
    causes = error_causes(observation, flat(), seed=0)
    for name in ("unseen", "unpinned"):
        assert float(causes[name][front].mean()) < 0.9 * float(causes[name][back].mean())


@pytest.mark.usefixtures("weighty")
def test_what_stands_out_is_trusted_less(observation):
    plain, marked = flat(), flat()
    marked[0, 4:8, 4:8], marked[2, 4:8, 4:8] = 7.0, 0.01
    before, after = (confidence(observation, light, fitted=True, seed=0) for light in (plain, marked))
    for face in (0, 2):
        assert float((after / before)[face, 5:7, 5:7].mean()) < 0.6
    assert float((after / before)[4].mean()) > 0.7


@pytest.mark.parametrize("name", CAUSES)
def test_each_cause_lowers_the_confidence_by_its_weight(observation, name, monkeypatch):
    weights = dict.fromkeys(CAUSES, 0.0) | {name: 0.7, "least": 0.1}
    monkeypatch.setattr("lightprobe.prediction.confidence.FITTED", Weights(**weights))
    light = patch_light((1, 0, 0))
    trust = confidence(observation, light, fitted=True, seed=3, scale=2.0, doubt=0.3)
    cause = error_causes(observation, light, 3)[name]
    assert float(cause.max()) > 0.1
    torch.testing.assert_close(trust, torch.exp(-2 * (0.7 * cause + 0.1) - 0.3))


def test_brightness_of_the_photo_does_not_matter(observation):
    light = patch_light((0.2, 1.0, 0.5))
    a, b = (confidence(observation, factor * light, fitted=True, seed=0) for factor in (1.0, 30.0))
    torch.testing.assert_close(a, b, rtol=1e-3, atol=1e-4)


def test_causes_are_named_bounded_and_repeatable(observation):
    first, second = (error_causes(observation, patch_light((1, 0, 0)), 3) for _ in range(2))
    assert tuple(first) == CAUSES == tuple(Weights.__dataclass_fields__)[:-1]
    for name in CAUSES:
        assert torch.equal(first[name], second[name])
        assert float(first[name].min()) >= 0
        assert first[name].isfinite().all()
    assert float(torch.stack([first["unseen"], first["unpinned"]]).max()) <= 1
    black = error_causes(observation, torch.zeros(6, 16, 16, 3), 3)
    assert all(cause.isfinite().all() for cause in black.values())


def test_evidence_against_the_matrix_itself(observation):
    """A built column by column at 6 x 4 x 4, all channels alike: s and d by their definitions."""
    seen, pinned = _evidence(observation, 4, seed=0)
    transport = Transport(observation.gbuffer, prefilter.cached(4, CPU), observation.rows)
    weight = relative_tone_weight(observation.pixels.color, observation.light_level)[:, None].expand(-1, 3)
    weight = (weight / weight.sum()).double().numpy()
    s, d, angle = np.zeros(96), np.zeros(96), cubemap.solid_angles(4).reshape(-1).double().numpy()
    for texel in range(96):
        unit = torch.zeros(96, 3)
        unit[texel] = 1
        column = transport.apply(unit.reshape(6, 4, 4, 3)).double().numpy()
        s[texel] = (weight * column).sum() / 3 / angle[texel]
        d[texel] = (weight * column**2).sum() / 3 / angle[texel] ** 2
    assert seen.reshape(-1).numpy() == pytest.approx(s, rel=1e-3, abs=1e-6)
    assert np.corrcoef(pinned.reshape(-1).numpy(), d)[0, 1] > 0.8
    assert float(pinned.sum()) == pytest.approx(d.sum(), rel=0.3)


def test_colors_brighten_over_the_range_and_stay_at_its_ends():
    values = np.linspace(0, 1, 101)
    luma = confidence_colors(values) @ LUMA
    inside = (values >= RANGE[0]) & (values <= RANGE[1])
    assert (np.diff(luma[inside]) > 0.005).all()
    assert (luma[values < RANGE[0]] == luma[inside][0]).all()
    assert np.ptp(luma) > 0.6


def test_the_bar_has_the_pictures_colors():
    stops = [
        f"#{''.join(f'{round(255 * c):02x}' for c in color)}" for color in confidence_colors(np.array(TICKS))
    ]
    assert css_gradient() == f"linear-gradient(to right, {', '.join(stops)})"


def test_ticks_stand_where_their_colors_are_and_name_the_factor():
    assert [place for place, _, _ in ticks()] == pytest.approx([0, 0.25, 0.5, 0.75, 1])
    words = [*("≤ 0.3", "≥ ×3.3"), *("0.4", "×2.5"), *("0.5", "×2"), *("0.6", "×1.7"), *("0.7", "×1.4")]
    assert [word for _, *two in ticks() for word in two] == words
