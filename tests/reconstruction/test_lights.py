"""The photos' lights while the asset changes: solved from their pixels or fitted by gradients."""

from dataclasses import replace

import pytest
import torch

from lightprobe.core.config import DecomposeConfig, LightUpdate
from lightprobe.light import cubemap
from lightprobe.light.prefilter import cached
from lightprobe.reconstruction import lights as lights_module
from lightprobe.reconstruction.lights import GREY, LightPull, Lights, LightSolver, solve_target_light
from lightprobe.reconstruction.photos import Target
from lightprobe.render.seen_light import SeenLight
from lightprobe.render.split_sum import shade
from lightprobe.render.surface import View
from lightprobe.render.visibility import PointVisibility, VertexVisibility
from tests.gbuffers import sky, sphere_gbuffer
from tests.shapes import camera_at
from tests.tape import compute_as_a_gpu_does, record_on_tape

CPU = torch.device("cpu")
CONFIG = DecomposeConfig(light_solve_pixels=500)
GRADIENT = replace(CONFIG, light_update=LightUpdate.GRADIENT)


def ball():
    """Return the G-buffer of a glossy ball, its photo, of which some pixels lie outside the mask, and its
    light.
    """
    gbuffer, operator = sphere_gbuffer(1500, roughness=0.2, metallic=0.5), cached(CONFIG.light_resolution)
    light = 0.5 * sky(CONFIG.light_resolution).clamp(max=3)
    color = shade(gbuffer, operator, operator.apply(light))
    alpha = (torch.arange(1500) % 3 > 0).float()
    view = View.of(camera_at((3.0, 0, 0), size=1, width=1500), CPU)
    return gbuffer, Target("ball", view, color, alpha, torch.zeros(1500, 3, dtype=torch.bool)), light


def test_a_solved_light_explains_its_photo():
    gbuffer, target, light = ball()
    rows, start = torch.arange(0, 1500, 2), torch.full_like(light, 0.5)
    solved = solve_target_light(
        target.color[rows], target.clipped[rows], gbuffer, start, rows, CONFIG, times=6
    )
    operator = cached(CONFIG.light_resolution)
    before, after = (
        float((shade(gbuffer, operator, operator.apply(x)) - target.color).abs().mean())
        for x in (start, solved)
    )
    assert after < 0.1 * before
    assert (solved >= 0).all()


@pytest.mark.parametrize("highlight", ["of the photo", "of the asset"])
def test_highlights_that_only_one_of_photo_and_asset_has_change_the_light_little(monkeypatch, highlight):
    monkeypatch.setattr(
        lights_module, "refit_contrast", lambda transport, solved, observed, clipped: solved.light
    )
    gbuffer, target, light = ball()
    true, brightness = target.color, target.color.mean(1)
    if highlight == "of the photo":
        wrong = torch.arange(1500) % 20 == 0
        photo = torch.where(wrong[:, None], true + 3, true)
    else:
        wrong = brightness > brightness.quantile(0.9)
        photo = torch.where(wrong[:, None], 0.0, true)
    solved = solve_target_light(
        photo, target.clipped, gbuffer, torch.full_like(light, 0.5), None, CONFIG, times=6
    )
    operator = cached(CONFIG.light_resolution)
    shown = shade(gbuffer, operator, operator.apply(solved))
    error = (shown - true)[~wrong].abs().mean() / true[~wrong].mean()
    assert (
        error < 0.16
    )  # by the picture's brightness alone 1.0 with the photo's, by the photo's .19 with the asset's


def test_what_the_asset_cannot_explain_does_not_dim_the_light():
    gbuffer, target, light = ball()
    brighter = torch.rand(1500, generator=torch.Generator().manual_seed(0)) > 0.5
    photo = torch.where(brighter, 1.5, 0.5)[:, None] * target.color
    solved = solve_target_light(
        photo, target.clipped, gbuffer, torch.full_like(light, 0.5), None, CONFIG, times=6
    )
    operator = cached(CONFIG.light_resolution)
    shown = shade(gbuffer, operator, operator.apply(solved))
    assert float(shown.mean() / photo.mean()) == pytest.approx(
        1, abs=0.03
    )  # by the photo .95, by the picture 1.06


def test_a_pull_of_its_own_takes_the_place_of_the_configured_one(monkeypatch):
    gbuffer, target, light = ball()
    photo = (target.color, target.clipped, gbuffer, torch.full_like(light, 0.5), None, CONFIG)
    monkeypatch.setattr(
        lights_module, "refit_contrast", lambda transport, solved, observed, clipped: solved.light
    )
    firm = solve_target_light(*photo, regularisation=100.0)
    assert firm.std() < 0.1 * solve_target_light(*photo).std()


def test_rows_lie_in_the_mask_and_come_once():
    gbuffer, target, _ = ball()
    lights = Lights(["ball"], CONFIG, CPU, 0)
    rows = lights.rows(target, gbuffer, 3, 400)
    assert len(rows.unique()) == 400
    assert (target.alpha[gbuffer.pixel[rows]] == 1).all()
    assert len(lights.rows(target, gbuffer, 3, 5000)) == 1000  # all there are
    assert torch.equal(rows, lights.rows(target, gbuffer, 3, 400))
    assert not torch.equal(rows, lights.rows(target, gbuffer, 4, 400))


@pytest.mark.long
def test_recorded_visits_solve_what_single_ones_do(monkeypatch):
    compute_as_a_gpu_does(monkeypatch)
    gbuffer, target, _ = ball()
    few = replace(CONFIG, light_solve_pixels=200, light_resolution=8)
    open_sphere = VertexVisibility(torch.full((4, 384), 200, dtype=torch.uint8), torch.full((4, 3), 0.2))
    corners = torch.arange(1500)[:, None] % 4
    shadowed = replace(gbuffer, visibility=PointVisibility(open_sphere, corners, torch.ones(1500, 1)))

    def visits():
        lights, found = Lights(["ball"], few, CPU, 0), []
        for step, seen in enumerate([gbuffer] * 5 + [shadowed] * 5):
            lights.levels(target, seen, step)
            found.append(lights.maps[0].clone())
        return found

    single, recorders = visits(), record_on_tape(monkeypatch, lights_module)
    recorded = visits()
    assert [(recorder.recordings, recorder.replays) for recorder in recorders] == 2 * [
        (1, 2)
    ]  # one each surface
    for one, other in zip(single, recorded, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-5)
    assert not torch.allclose(single[3], single[4], rtol=1e-3)  # other pixels, another light


@pytest.mark.long
def test_photos_of_fewer_pixels_are_solved_from_the_same_recording(monkeypatch):
    compute_as_a_gpu_does(monkeypatch)
    gbuffer, target, light = ball()
    start, rows = torch.full_like(light, 0.5), torch.arange(500)
    bright_first = rows[target.color[:500].mean(1).argsort(descending=True)]
    few = [rows, rows, rows, bright_first[:250], bright_first]  # in 500 pixels each of 250 comes twice

    def solved():
        solver = LightSolver(CONFIG, CPU, pixels=500)
        return [solver(target.color, target.clipped, gbuffer, part, start) for part in few]

    single, recorders = solved(), record_on_tape(monkeypatch, lights_module)
    for one, other in zip(single, solved(), strict=True):
        torch.testing.assert_close(one, other, rtol=1e-3, atol=1e-4)
    assert [(recorder.recordings, recorder.replays) for recorder in recorders] == [(1, 2)]
    half_more = LightSolver(CONFIG, CPU, pixels=375)(
        target.color, target.clipped, gbuffer, bright_first[:250], start
    )
    torch.testing.assert_close(
        half_more, single[3], rtol=0.2, atol=0.05
    )  # as many more of the bright as of the dark


@pytest.mark.cuda
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.filterwarnings("error:Steps cannot be recorded")
def test_a_gpu_solves_from_a_recording_what_it_solves_singly(monkeypatch):
    device = torch.device("cuda", 0)
    gbuffer, target, _ = ball()
    gbuffer = gbuffer.holding([tensor.to(device) for tensor in gbuffer.tensors()])
    moved = {name: getattr(target, name).to(device) for name in ("color", "alpha", "clipped")}
    target = replace(target, view=View.of(camera_at((3.0, 0, 0), size=1, width=1500), device), **moved)

    def visits():
        lights = Lights(["ball"], CONFIG, device, 0)
        for step in range(8):
            lights.levels(target, gbuffer, step)
        return lights.maps[0]

    recorded = visits()
    monkeypatch.setattr(lights_module, "recorder_for", lambda device: None)
    torch.testing.assert_close(recorded, visits(), rtol=1e-3, atol=1e-4)


def test_a_visit_solves_the_light_or_leaves_it_to_gradients():
    gbuffer, target, _ = ball()
    solving, fitting = Lights(["ball"], CONFIG, CPU, 0), Lights(["ball"], GRADIENT, CPU, 0)
    grey = solving.maps[0].clone()
    levels, cost = solving.levels(target, gbuffer, 0)
    assert not torch.equal(solving.maps[0], grey)
    torch.testing.assert_close(levels, solving.prefilter.apply(solving.maps[0]))
    assert float(cost) == 0
    levels, _ = fitting.levels(target, gbuffer, 0)
    assert torch.equal(fitting.maps[0].detach(), grey)
    (gradient,) = torch.autograd.grad(levels.sum(), fitting.maps[0])
    assert (gradient > 0).all()
    assert solving.groups() == []
    assert list(fitting.groups()[0].parameters) == ["light.ball"]


def two_sides():
    """Return the light, and (target, G-buffer) of the front and the back of a plain ball, the back's exposure another."""
    gbuffer, light = sphere_gbuffer(1500, roughness=0.6), 0.5 * sky(CONFIG.light_resolution).clamp(max=3)
    operator = cached(CONFIG.light_resolution)
    turn = torch.tensor([[-1.0, 0, 0], [0, -1, 0], [0, 0, 1]])  # by half a turn about the vertical
    back = replace(
        gbuffer, **{name: getattr(gbuffer, name) @ turn for name in ("position", "normal", "view")}
    )
    view, none = (
        View.of(camera_at((3.0, 0, 0), size=1, width=1500), CPU),
        torch.zeros(1500, 3, dtype=torch.bool),
    )
    photos = []
    for name, seen, gain in (("front", gbuffer, (1.0, 1.0, 1.0)), ("back", back, (1.5, 1.0, 0.8))):
        color = shade(seen, operator, operator.apply(light)) * torch.tensor(gain)
        photos.append((Target(name, view, color, torch.ones(1500), none), seen))
    return light, photos


def shared_visits(groups, visits=24):
    light, photos = two_sides()
    lights = Lights(["front", "back"], CONFIG, CPU, 0, groups)
    for step in range(visits):
        lights.levels(*photos[step % 2], step)
    return light, lights


def test_what_a_photo_does_not_show_of_a_light_comes_from_those_that_share_it():
    light, alone = shared_visits(())
    _, together = shared_visits(("table", "table"))
    _, other = shared_visits(("table", None))
    assert all(torch.equal(mine, theirs) for mine, theirs in zip(alone.maps, other.maps, strict=True))

    def error(lights):
        found = lights.maps[0] / lights.maps[0].mean((0, 1, 2))
        return float((found - light / light.mean((0, 1, 2))).abs().mean())

    assert error(together) < 0.85 * error(alone)
    level = together.maps[1].mean((0, 1, 2)) / together.maps[0].mean((0, 1, 2))
    torch.testing.assert_close(level, torch.tensor([1.5, 1.0, 0.8]), rtol=0.1, atol=0)


def test_with_the_support_at_its_distance_photos_of_a_place_share_one_light():
    """Their lights are pulled to each other far more than where what is near is taken to be far."""
    _, photos = two_sides()
    target, gbuffer = photos[0]
    start, expected = torch.full((6, 16, 16, 3), 0.5), sky(CONFIG.light_resolution).clamp(max=3)
    expected = expected / expected.mean((0, 1, 2))
    solved = [
        solve_target_light(
            target.color, target.clipped, seen, start, None, CONFIG, 3, pull=LightPull(expected)
        )
        for seen in (gbuffer, replace(gbuffer, support=torch.tensor([0.0, 0.0, 1.0, -100.0])))
    ]
    free, held = (float((x / x.mean((0, 1, 2)) - expected).abs().mean()) for x in solved)
    assert held < 0.5 * free


def test_a_light_is_what_its_photo_shows_of_it():
    """Behind a sphere that is seen from one side; brighter than a bound from below costs nothing."""
    light, photos = two_sides()
    target, gbuffer = photos[0]
    behind = (cubemap.directions(16)[..., 0] < -0.6).float()
    shown = LightPull(seen=SeenLight(light, behind, torch.zeros(6, 16, 16, 3, dtype=torch.bool)))
    bound = LightPull(seen=SeenLight(0.01 * light, behind, torch.ones(6, 16, 16, 3, dtype=torch.bool)))
    start = torch.full((6, 16, 16, 3), 0.5)
    alone, held, bounded = (
        solve_target_light(target.color, target.clipped, gbuffer, start, None, CONFIG, 3, pull=pull)
        for pull in (LightPull(), shown, bound)
    )
    missing = [float((found - light)[behind > 0].abs().mean()) for found in (alone, held, bounded)]
    assert missing[1] < 0.3 * missing[0]
    assert missing[2] == pytest.approx(missing[0], rel=0.2)


@pytest.mark.long
def test_shared_lights_are_solved_from_a_recording_as_without_one(monkeypatch):
    compute_as_a_gpu_does(monkeypatch)
    _, single = shared_visits(("table", "table"), 6)
    recorders = record_on_tape(monkeypatch, lights_module)
    _, recorded = shared_visits(("table", "table"), 6)
    assert any(recorder.replays for recorder in recorders)
    for one, other in zip(single.maps, recorded.maps, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-5)


def test_only_a_coloured_light_costs():
    lights, (_, _, light) = Lights(["ball"], GRADIENT, CPU, 0), ball()
    assert float(lights.grey_cost(0).detach()) == 0  # they start grey
    lights.load(light[None])
    expected = GREY * (light - light.mean(-1, keepdim=True)).abs().mean()
    torch.testing.assert_close(lights.grey_cost(0).detach(), expected)


def test_the_cast_is_what_all_lights_have_in_common():
    lights, factors = Lights(["a", "b"], CONFIG, CPU, 0), torch.tensor([2.0, 1.0, 0.5])
    lights.load(
        torch.stack([0.5 * torch.ones(6, 16, 16, 3) * factors, 3.0 * torch.ones(6, 16, 16, 3) * factors])
    )
    torch.testing.assert_close(lights.color_cast(), factors.log())
    lights.load(torch.stack([torch.ones(6, 16, 16, 3) * factors, torch.ones(6, 16, 16, 3) / factors]))
    torch.testing.assert_close(lights.color_cast(), torch.zeros(3), atol=1e-6, rtol=0)


@pytest.mark.parametrize("config", [CONFIG, GRADIENT], ids=["solved", "gradient"])
def test_lights_change_in_place(config):
    """An optimiser may hold them."""
    lights, (_, _, light) = Lights(["a", "b"], config, CPU, 0), ball()
    held = lights.maps[1]
    lights.replace("b", light)
    lights.dim(4.0)
    assert lights.maps[1] is held
    torch.testing.assert_close(held.detach(), light / 4)
    torch.testing.assert_close(lights.stacked()[0], torch.full_like(light, 0.125))


def test_loaded_lights_must_fit():
    lights, (_, _, light) = Lights(["a", "b"], CONFIG, CPU, 0), ball()
    lights.replace("b", light)
    again = Lights(["a", "b"], CONFIG, CPU, 0)
    again.load(lights.stacked())
    assert torch.equal(again.stacked(), lights.stacked())
    for odd in (lights.stacked()[:1], -lights.stacked()):
        with pytest.raises(ValueError, match="'lights' are"):
            again.load(odd)
