import math
from dataclasses import replace

import pytest
import torch

from lightprobe.core.checkpoint import Checkpoints
from lightprobe.core.config.distillation import (
    AlphaRule,
    DistillConfig,
    LossSpace,
    NetworkForm,
    RadianceUnit,
    TotalDistribution,
)
from lightprobe.core.errors import ConfigError, ConvergenceError, InputError
from lightprobe.distillation import mlp_training, sphere_training
from lightprobe.distillation.loss import intensity_weight, sample_weight, weighted_l2
from lightprobe.distillation.sphere_training import sphere_examples
from lightprobe.distillation.training import _digest, stages, train
from lightprobe.light import cubemap
from lightprobe.light.environment import Environment
from lightprobe.light.resize import resize_light
from lightprobe.models import ProbeModel
from lightprobe.models.probe_distribution import alpha2, mean_distribution, stack, total_distribution
from lightprobe.models.probe_model import new_network, new_sphere
from lightprobe.training import Progress, descent
from tests.lit_sphere import CPU, PATCHES, glossy_sphere, lessons
from tests.tape import compute_as_a_gpu_does, record_on_tape

CONFIG = DistillConfig(
    steps=40,
    samples=256,
    width=32,
    depth=2,
    checkpoint_every=20,
    sphere_steps=10,
    sphere_width=4,
)
MLP_ONLY = replace(CONFIG, sphere_steps=0)
DIRECTIONS = cubemap.directions(16).reshape(-1, 3)


@pytest.fixture(scope="module")
def photos():
    return lessons(glossy_sphere())


def predicted(model, lesson):
    colors = model.network(lesson.pixels, lesson.light_level)
    radiance, _ = stack(lesson.pixels, colors, DIRECTIONS, model.config.alpha_rule)
    return radiance / lesson.light_level


def log_error(model, lesson):
    """Root mean square of the log difference where the photo looks."""
    seen = lesson.distribution > lesson.distribution.mean()
    error = torch.log1p(predicted(model, lesson)) - torch.log1p(lesson.target)
    return float(error[seen].square().mean().sqrt())


@pytest.mark.slow
def test_a_few_lights_are_learned_and_stay_where_they_are(photos, monkeypatch):
    monkeypatch.setattr(mlp_training, "_RATE", 2e-3)
    network, up = new_network(CONFIG).requires_grad_(False), photos[0].up
    untrained = ProbeModel(network, Environment(torch.ones(6, 16, 16, 3)), up, CONFIG)
    model = train(photos, replace(MLP_ONLY, steps=250, width=64), CPU, seed=0)
    before, after = (sum(log_error(m, photo) for photo in photos) for m in (untrained, model))
    assert after < 0.75 * before
    for patch, photo in zip(PATCHES, photos, strict=True):
        axis = torch.nn.functional.normalize(torch.tensor(patch), dim=0)
        excess = (predicted(model, photo).mean(-1) - 1.0).clamp(min=0)[:, None]
        centre = torch.nn.functional.normalize((DIRECTIONS * excess).sum(0), dim=0)
        assert float(centre @ axis) > 0.9, f"{photo.name}: bright towards {centre.tolist()}, truth {patch}"


def weights(model):
    """Return the weights of both networks by name."""
    nets = {"network": model.network, "sphere": model.sphere}
    return {f"{part}.{k}": v for part, net in nets.items() for k, v in net.state_dict().items()}


@pytest.mark.slow
def test_equal_seeds_give_equal_bits_and_others_do_not(photos):
    first, second, other = (weights(train(photos, CONFIG, CPU, seed=s)) for s in (1, 1, 2))
    assert all(torch.equal(first[k], second[k]) for k in first)
    for name in ("network.layers.0.weight", "sphere.fine.0.conv.weight"):
        assert not torch.equal(first[name], other[name])


@pytest.mark.long
def test_recorded_steps_learn_what_single_ones_do(photos, monkeypatch):
    compute_as_a_gpu_does(monkeypatch)
    config = replace(CONFIG, steps=12, sphere_steps=8)

    def learn():
        losses = []
        return train(photos, config, CPU, 3, Progress(on_step=lambda *step: losses.append(step[-1]))), losses

    single, expected = learn()
    recorders = record_on_tape(monkeypatch, descent)
    recorded, losses = learn()
    assert [recorder.replays for recorder in recorders] == [9, 5]
    assert losses == pytest.approx(expected, abs=1e-5)
    before, after = weights(single), weights(recorded)
    for name, value in before.items():
        assert torch.allclose(after[name], value, rtol=1e-4, atol=1e-6), name


@torch.no_grad()
def test_networks_give_floats_in_mixed_precision(photos):
    network, sphere, photo = new_network(CONFIG), new_sphere(replace(CONFIG, sphere_width=24)), photos[0]
    maps = sphere_examples(network, photos[:1], CONFIG, 0).maps
    for forward in (lambda: network(photo.pixels, photo.light_level), lambda: sphere(maps)):
        exact = forward()
        with torch.autocast("cpu", torch.bfloat16):
            mixed = forward()
        assert mixed.dtype == torch.float32
        assert not torch.equal(mixed, exact)
        assert float((mixed - exact).norm() / exact.norm()) < 0.02


@pytest.mark.cuda
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
@pytest.mark.filterwarnings("error:Steps cannot be recorded", "error:The CUDA Graph is empty")
def test_a_gpu_learns_from_recordings_what_it_learns_step_by_step(photos, monkeypatch):
    device = torch.device("cuda", 0)
    moved = [photo.to(device) for photo in photos]
    for module in (mlp_training, sphere_training):
        monkeypatch.setattr(module, "mixed_precision", lambda network, device: network)
    start = {
        f"{part}.{k}": v
        for part, net in (("network", new_network(CONFIG, 3)), ("sphere", new_sphere(CONFIG, 3)))
        for k, v in net.state_dict().items()
    }
    recorded = weights(train(moved, CONFIG, device, seed=3))
    monkeypatch.setattr(descent, "recorder_for", lambda device: None)
    single = weights(train(moved, CONFIG, device, seed=3))
    moves = sum(float((value.cpu() - start[name]).norm()) for name, value in single.items())
    assert sum(float((recorded[name] - value).norm()) for name, value in single.items()) < 0.05 * moves


@pytest.mark.slow
@pytest.mark.parametrize("killed_at", [30, 40, 47])
def test_resuming_gives_the_bits_of_an_uninterrupted_run(photos, tmp_path, killed_at):
    class KilledError(Exception):
        pass

    def kill(stage, step, *_):
        if first_step[stage] + step == killed_at:
            raise KilledError

    config, checkpoints, steps = replace(CONFIG, checkpoint_every=5), Checkpoints(tmp_path), []
    first_step = {stage.name: stage.first_step for stage in stages(config)}
    whole = weights(train(photos, config, CPU, seed=4))
    with pytest.raises(KilledError):
        train(photos, config, CPU, 4, Progress(checkpoints, kill))
    count = Progress(checkpoints, lambda stage, step, *_: steps.append(first_step[stage] + step))
    resumed = weights(train(photos, config, CPU, 4, count))
    first = 5 * ((killed_at - 1) // 5) + 1
    assert steps == list(range(first, 51))
    assert all(torch.equal(whole[k], value) for k, value in resumed.items())


def test_a_checkpoint_of_another_configuration_is_refused(photos, tmp_path):
    train(photos, replace(MLP_ONLY, steps=1), CPU, 0, Progress(Checkpoints(tmp_path)))
    with pytest.raises(ConfigError, match="another Phase II configuration"):
        train(photos, CONFIG, CPU, 0, Progress(Checkpoints(tmp_path)))


def test_a_checkpoint_of_other_maps_is_refused(photos, tmp_path):
    one, other = (_digest([Environment(torch.full((6, 8, 8, 3), level))]) for level in (1.0, 2.0))
    train(photos, replace(MLP_ONLY, steps=1), CPU, 0, Progress(Checkpoints(tmp_path)), maps=one)
    train(photos, replace(MLP_ONLY, steps=1), CPU, 0, Progress(Checkpoints(tmp_path)), maps=one)
    with pytest.raises(ConfigError, match="another Phase II configuration"):
        train(photos, replace(MLP_ONLY, steps=1), CPU, 0, Progress(Checkpoints(tmp_path)), maps=other)


def test_a_loss_that_is_not_a_number_stops_the_training(photos):
    broken = replace(photos[0], target=torch.full_like(photos[0].target, float("nan")))
    with pytest.raises(ConvergenceError, match="photo0"):
        train([broken], MLP_ONLY, CPU, 0)


@pytest.mark.parametrize("options", [{"alpha_rule": AlphaRule.R2}, {"loss_space": LossSpace.LINEAR}])
def test_every_option_changes_what_is_learned(photos, options):
    config = replace(MLP_ONLY, steps=2)
    plain, changed = (train(photos[:1], c, CPU, 0) for c in (config, replace(config, **options)))
    assert not torch.equal(plain.network.layers[0].weight, changed.network.layers[0].weight)


def test_the_network_follows_exposure_and_starts_at_the_average_light_a_pixel_saw(photos):
    network = new_network(CONFIG)
    pixels, level = photos[0].pixels, photos[0].light_level
    brighter = replace(pixels, color=4 * pixels.color)
    torch.testing.assert_close(network(brighter, brighter.light_level()), 4 * network(pixels, level))
    grey = replace(pixels, color=3 * pixels.furnace)  # as under a constant light of 3
    torch.testing.assert_close(
        network(grey, grey.light_level()), torch.full_like(grey.color, 3.0), rtol=0.5, atol=0
    )


def test_printed_roughness_gives_wider_lobes(photos):
    roughness = torch.tensor([0.02, 0.3, 1.0])
    torch.testing.assert_close(alpha2(roughness, AlphaRule.R4), torch.tensor([0.08**4, 0.3**4, 1.0]))
    torch.testing.assert_close(alpha2(roughness, AlphaRule.R2), torch.tensor([0.08**2, 0.3**2, 1.0]))
    pixels = photos[0].pixels.take(torch.tensor([600]))
    narrow, wide = (mean_distribution(pixels, DIRECTIONS, rule) for rule in (AlphaRule.R4, AlphaRule.R2))
    assert wide.max() / wide.mean() < narrow.max() / narrow.mean()


def test_a_model_survives_the_disk(photos, tmp_path):
    model = train(photos, replace(CONFIG, steps=3), CPU, 0)
    model.save(tmp_path)
    loaded = ProbeModel.load(tmp_path)
    assert loaded.config == model.config
    assert torch.equal(loaded.mean_light.texels, model.mean_light.texels)
    assert torch.equal(predicted(loaded, photos[0]), predicted(model, photos[0]))
    assert all(torch.equal(value, weights(model)[name]) for name, value in weights(loaded).items())
    train(photos, replace(MLP_ONLY, steps=1), CPU, 0).save(tmp_path / "paper")
    assert ProbeModel.load(tmp_path / "paper").sphere is None


def test_weights_of_another_size_are_refused(photos, tmp_path):
    train(photos, replace(MLP_ONLY, steps=1), CPU, 0).save(tmp_path)
    config = (tmp_path / "config.json").read_text()
    (tmp_path / "config.json").write_text(config.replace('"width": 32', '"width": 48'))
    with pytest.raises(InputError, match=r"illumination_mlp\.safetensors.*does not fit"):
        ProbeModel.load(tmp_path)


def test_resized_lights_keep_their_power():
    light = torch.rand(6, 16, 16, 3, generator=torch.Generator().manual_seed(0))
    power = (light * cubemap.solid_angles(16)[..., None]).sum((0, 1, 2))
    for resolution in (8, 32):
        resized = resize_light(light, resolution)
        total = (resized * cubemap.solid_angles(resolution)[..., None]).sum((0, 1, 2))
        torch.testing.assert_close(total, power, rtol=2e-3 if resolution > 16 else 1e-5, atol=0)


def test_the_paper_s_network_is_told_what_the_paper_names(photos):
    network = new_network(replace(CONFIG, network=NetworkForm.PLAIN)).requires_grad_(False)
    pixels, level = photos[0].pixels, photos[0].light_level
    colors = network(pixels, level)
    assert next(network.parameters()).shape == (CONFIG.width, 16)
    assert (colors > 0).all()
    assert torch.equal(network(pixels, 3 * level), colors)  # nothing of the photo as a whole
    for field in ("color", "base_color", "specular", "normal", "roughness", "view"):
        other = replace(pixels, **{field: getattr(pixels, field).flip(0)})
        assert not torch.equal(network(other, level), colors), field
    assert torch.equal(network(replace(pixels, furnace=pixels.furnace.flip(0)), level), colors)


def test_the_printed_loss_is_in_the_photo_s_own_radiance(photos, monkeypatch):
    """Without the weight of bright and dark directions it is the relative one times the squared light level."""
    monkeypatch.setattr(mlp_training, "intensity_weight", lambda target, unit: torch.ones(len(target)))
    config = replace(MLP_ONLY, loss_space=LossSpace.LINEAR)
    given = mlp_training.example_tensors(photos[0], config, 0, 0)
    angles = cubemap.solid_angles(16).reshape(-1)
    network = new_network(config).requires_grad_(False)
    relative, own = (
        float(mlp_training.example_loss(network, given, DIRECTIONS, angles, replace(config, radiance_unit=u)))
        for u in (RadianceUnit.LEVEL, RadianceUnit.PHOTO)
    )
    assert own == pytest.approx(relative * float(photos[0].light_level) ** 2, rel=1e-4)


def test_texels_count_alike_without_their_solid_angles(photos, monkeypatch):
    seen = []
    loss = mlp_training.example_loss
    monkeypatch.setattr(mlp_training, "example_loss", lambda *given: seen.append(given[3]) or loss(*given))
    train(photos, replace(MLP_ONLY, steps=1, solid_angle_weight=False), CPU, 0)
    assert float(seen[0].sum()) == pytest.approx(4 * math.pi, rel=1e-5)
    assert float(seen[0].min()) == float(seen[0].max())


def test_every_reading_of_the_total_distribution(photos):
    pixels, directions = photos[0].pixels.take(torch.arange(0, len(photos[0].pixels), 7)), DIRECTIONS[::37]
    count = len(pixels)
    mean, total, each = (
        total_distribution(pixels, directions, AlphaRule.R2, rule, samples=16) for rule in TotalDistribution
    )
    torch.testing.assert_close(mean, mean_distribution(pixels, directions, AlphaRule.R2))
    torch.testing.assert_close(total, mean * count / 16)  # sum over the sum of 16
    facing = ((pixels.normal @ directions.T) > 0).sum(0)
    reached = facing > 0
    torch.testing.assert_close(each[reached], (mean * count)[reached] / facing[reached])
    assert (each[~reached] == 0).all()


def naive_loss(predicted, target, sampled, total, solid_angle, *, log):
    loss = 0.0
    for k in range(len(target)):
        w = sampled[k] / total[k] if total[k] > 0 else 0.0
        r, g, b = (min(max(v, 0.0), 1e30) for v in target[k])
        luma = min((0.299 * r + 0.587 * g + 0.114 * b) / 2, 1.0)  # the photo's light level counts as .5
        y = abs(luma - 0.5) + 0.5
        difference = 0.0
        for p, e in zip(predicted[k], target[k], strict=True):
            difference += (math.log(1 + p) - math.log(1 + e)) ** 2 if log else (p - e) ** 2
        loss += w * y * difference * solid_angle[k]
    return loss / (4 * math.pi)


@pytest.mark.parametrize("space", list(LossSpace))
def test_equation_6_is_the_loop_written_from_the_paper(space):
    random = torch.Generator().manual_seed(2)
    predicted, target = (3 * torch.rand(2, 40, 3, generator=random, dtype=torch.float64)).unbind(0)
    target[3] = torch.tensor([500.0, 400.0, 300.0])
    sampled, total, angle = torch.rand(3, 40, generator=random, dtype=torch.float64).unbind(0)
    sampled[5] = total[5] = 0
    weight = sample_weight(sampled, total) * intensity_weight(target)
    given = (part.tolist() for part in (predicted, target, sampled, total, angle))
    expected = naive_loss(*given, log=space is LossSpace.LOG)
    assert float(weighted_l2(predicted, target, weight, angle, space)) == pytest.approx(expected, rel=1e-12)


def test_intensity_weight_is_least_at_the_light_level():
    grey = torch.tensor([0.0, 0.5, 1.0, 1.5, 2.0, 1000.0])[:, None].expand(-1, 3)
    torch.testing.assert_close(intensity_weight(grey), torch.tensor([1.0, 0.75, 0.5, 0.75, 1.0, 1.0]))


def test_the_printed_intensity_weight_is_not_bounded():
    grey = torch.tensor([0.0, 0.5, 1.0, 20.0])[:, None].expand(-1, 3)
    expected = torch.tensor([1.0, 0.5, 1.0, 20.0])
    torch.testing.assert_close(intensity_weight(grey, RadianceUnit.PHOTO), expected)


@pytest.mark.golden
def test_golden_number():
    target = torch.tensor([[0.0, 0.0, 0.0], [2.0, 1.0, 0.5], [8.0, 8.0, 8.0]], dtype=torch.float64)
    predicted = torch.tensor([[0.5, 0.5, 0.5], [1.0, 1.0, 1.0], [4.0, 8.0, 2.0]], dtype=torch.float64)
    sampled, total = torch.tensor([1.0, 3.0, 0.5]), torch.tensor([2.0, 2.0, 0.5])
    weight = sample_weight(sampled, total) * intensity_weight(target)
    angle = torch.full((3,), 4 * math.pi / 3, dtype=torch.float64)
    # by hand: w Y = .5 * 1, 1.5 * (.5 + |1.242/2 - .5|), 1 * 1; squared differences .75, 1.25, 52
    expected = (0.5 * 0.75 + 1.5 * 0.621 * 1.25 + 52) / 3
    found = float(weighted_l2(predicted, target, weight, angle, LossSpace.LINEAR))
    assert found == pytest.approx(expected, rel=1e-6)
