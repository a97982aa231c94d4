"""The sphere network: seamless convolutions, and a light it can learn where an average cannot."""

from dataclasses import replace

import pytest
import torch

from lightprobe.core.config.distillation import AlphaRule, DistillConfig
from lightprobe.distillation import sphere_training
from lightprobe.distillation.sphere_training import sphere_examples, sphere_loss
from lightprobe.distillation.training import train
from lightprobe.light import cubemap
from lightprobe.light.prefilter import BLOCKS
from lightprobe.models.probe_maps import BLACK, CHANNELS, RESOLUTION, probe_maps, turned
from lightprobe.models.probe_model import new_network, new_sphere
from lightprobe.models.sphere_net import SphereNet, light_of, mean_over_turns, pad_faces
from tests.lit_sphere import CPU, glossy_sphere, lesson, patch_light
from tests.shapes import camera_at


@pytest.mark.parametrize("side", [4, 16])
def test_padding_is_continuous_across_all_edges(side):
    """Padded directions: every border texel is nearer to the texel it borders on than two texels are apart."""
    directions = cubemap.directions(side).permute(3, 0, 1, 2)[None]
    padded = pad_faces(directions)  # (6, 3, side + 2, side + 2)
    step = 3.2 / side
    inner = padded[:, :, 1:-1, 1:-1]
    torch.testing.assert_close(inner, directions[0].transpose(0, 1))
    for border, beside in (
        (padded[:, :, 0, 1:-1], padded[:, :, 1, 1:-1]),
        (padded[:, :, -1, 1:-1], padded[:, :, -2, 1:-1]),
        (padded[:, :, 1:-1, 0], padded[:, :, 1:-1, 1]),
        (padded[:, :, 1:-1, -1], padded[:, :, 1:-1, -2]),
    ):
        distance = (border - beside).norm(dim=1)
        assert float(distance.max()) < step
        assert float(distance.min()) > 0.1 * step, "a border repeats its own face"


def test_an_untrained_network_returns_the_stacked_light():
    maps = torch.randn(2, CHANNELS, 6, RESOLUTION, RESOLUTION, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(SphereNet(4)(maps), maps[:, :3])
    light = light_of(torch.full((3, 6, 4, 4), 0.5 + BLACK).log(), torch.tensor(3.0))
    torch.testing.assert_close(light, torch.full((6, 4, 4, 3), 1.5))


def test_the_loss_is_zero_for_the_truth_and_sees_a_dim_lamp():
    truth = patch_light((1.0, 0.3, 0.4)).reshape(-1, 3).T[None]
    flat = (truth.mean(2, keepdim=True) * torch.ones_like(truth) + BLACK).log()
    exact = (truth + BLACK).log().reshape(1, 3, 6, 16, 16)
    assert float(sphere_loss(exact, truth)) < 1e-9
    assert float(sphere_loss(flat.reshape(exact.shape), truth)) > 0.1


@pytest.mark.long
def test_a_short_training_beats_the_constant_and_the_stacked_light_on_photos_it_has_not_seen():
    asset, camera = glossy_sphere(), camera_at((2.6, 1.4, 1.2), size=40, focal=53.0)
    random = torch.Generator().manual_seed(2)
    axes = torch.nn.functional.normalize(torch.randn(40, 3, generator=random), dim=1)
    photos = [lesson(asset, camera, patch_light(axis.tolist()), f"photo{k}") for k, axis in enumerate(axes)]
    config = DistillConfig(steps=20, samples=256, width=16, depth=1, sphere_steps=240, sphere_width=8)
    model = train(photos[:32], config, CPU, seed=0)
    examples = sphere_examples(model.network, photos[32:], config, 0)
    log_constant = torch.full_like(examples.lights, 1 + BLACK).log().reshape(-1, 3, 6, 16, 16)
    with torch.no_grad():
        network, stacked, constant = (
            float(sphere_loss(light, examples.lights))
            for light in (model.sphere(examples.maps), examples.maps[:, :3], log_constant)
        )
    assert network < 0.5 * stacked
    assert network < 0.5 * constant


def test_turned_maps_are_those_of_a_turned_world():
    one = lesson(
        glossy_sphere(),
        camera_at((2.6, 1.4, 1.2), size=40, focal=53.0),
        patch_light((1.0, 0.3, 0.4)),
        "photo",
    )
    pixels, colors = one.pixels, one.pixels.color * torch.tensor([1.2, 1.0, 0.7])
    maps = probe_maps(pixels, colors, one.clipped, one.light_level, one.solved, one.up, AlphaRule.R4)
    index, handedness = cubemap.symmetries(RESOLUTION, CPU)
    texels = cubemap.directions(RESOLUTION).reshape(-1, 3)
    for turn in (3, 16, 29, 47):
        back = torch.linalg.lstsq(texels, texels[index[turn]]).solution  # w there is w @ back here
        blocks = (cubemap.directions(BLOCKS).reshape(-1, 3) @ back).contiguous()
        there = probe_maps(
            replace(pixels, normal=pixels.normal @ back.T, view=pixels.view @ back.T),
            colors,
            one.clipped,
            one.light_level,
            one.solved[:, cubemap.nearest_texel(blocks, BLOCKS)],
            one.up @ back.T,
            AlphaRule.R4,
        )
        torch.testing.assert_close(turned(maps[None], torch.tensor([turn]))[0], there, rtol=1e-3, atol=1e-3)
    assert set(handedness[[3, 16, 29, 47]].tolist()) == {-1.0, 1.0}


def test_the_mean_over_all_turns_does_not_depend_on_how_the_world_lies():
    maps = torch.randn(1, CHANNELS, 6, RESOLUTION, RESOLUTION, generator=torch.Generator().manual_seed(3))
    net = SphereNet(4).requires_grad_(False)
    torch.nn.init.normal_(net.out.weight, generator=torch.Generator().manual_seed(4))
    index, handedness = cubemap.symmetries(RESOLUTION, CPU)
    turn = int((handedness > 0).nonzero()[7])

    def answers(turns: int) -> list[torch.Tensor]:
        there = turned(maps, torch.tensor([turn]))
        straight, turned_first = (mean_over_turns(net, one, turns).flatten(2) for one in (maps, there))
        return [straight[:, :, index[turn]], turned_first]

    torch.testing.assert_close(*answers(24), rtol=1e-4, atol=1e-4)
    with pytest.raises(AssertionError):
        torch.testing.assert_close(*answers(1), rtol=1e-4, atol=1e-4)


def test_maps_do_not_depend_on_exposure():
    asset, camera = glossy_sphere(), camera_at((2.6, 1.4, 1.2), size=40, focal=53.0)
    config = DistillConfig(samples=256, width=16, depth=1, steps=1, sphere_steps=0)
    dim = patch_light((1.0, 0.3, 0.4), brightness=2.0) * 0.1
    lessons = [lesson(asset, camera, light, "photo") for light in (dim, 4 * dim)]
    lessons = [replace(one, clipped=torch.zeros_like(one.clipped)) for one in lessons]
    model = train(lessons, config, CPU, 0)
    maps = [sphere_examples(model.network, [one], config, 0).maps for one in lessons]
    torch.testing.assert_close(maps[0], maps[1], rtol=1e-3, atol=1e-3)


def test_a_training_starts_from_the_bundled_network_unless_told_otherwise_or_of_another_width():
    noise = SphereNet(24).state_dict()
    for config, bundled in ((DistillConfig(), True), (DistillConfig(pretrained=False), False)):
        start = new_sphere(config).state_dict()
        assert all(torch.equal(start[k], noise[k]) for k in noise) is not bundled
    assert new_sphere(DistillConfig(sphere_width=8)).out.weight.shape[1] == 8


def test_directions_are_told_by_up_and_by_the_camera():
    """Where light comes from is asked in a frame of the object and its photo, not of the file's axes."""
    asset, config = glossy_sphere(), DistillConfig(samples=256, width=16, depth=1)
    photo = lesson(
        asset, camera_at((2.6, 0.0, 0.0), size=40, focal=53.0), patch_light((1.0, 0.3, 0.4)), "photo"
    )
    up = sphere_examples(new_network(config), [photo], config, 0).maps[0, -3:].reshape(3, -1).T
    side = (
        sphere_examples(new_network(config), [replace(photo, up=torch.eye(3)[1])], config, 0)
        .maps[0, -3:]
        .reshape(3, -1)
        .T
    )
    directions = cubemap.directions(RESOLUTION).reshape(-1, 3)
    torch.testing.assert_close(up[:, 0], directions[:, 2])
    torch.testing.assert_close(side[:, 0], directions[:, 1])
    assert float((up[:, 1] - directions[:, 0]).abs().max()) < 0.1, "towards the camera"
    torch.testing.assert_close(up[:, 2], directions[:, 1], atol=0.1, rtol=0)
    torch.testing.assert_close(side[:, 2], -directions[:, 2], atol=0.1, rtol=0)


def test_training_ends_halfway_between_the_bundled_network_and_what_was_learned():
    asset, camera = glossy_sphere(), camera_at((2.6, 1.4, 1.2), size=40, focal=53.0)
    photos = [lesson(asset, camera, patch_light((1.0, 0.3, 0.4)), "photo")]
    start = new_sphere(DistillConfig())
    config = DistillConfig(steps=1, samples=256, width=16, depth=1, sphere_steps=1)
    learned = train(photos, config, CPU, 0).sphere
    moved = max(
        float((a - b).detach().abs().max())
        for a, b in zip(learned.parameters(), start.parameters(), strict=True)
    )
    # Adam's first step is as long as its rate, a fiftieth of the full one in the warm-up
    assert moved == pytest.approx(0.5 * sphere_training._RATE / 50, rel=0.05)
