"""The sphere network: seamless convolutions, and a light it can learn where an average cannot."""

from dataclasses import replace

import pytest
import torch

from lightprobe.core.config_distill import DistillConfig
from lightprobe.distill.probe_maps import BLACK, CHANNELS, RESOLUTION
from lightprobe.distill.sphere_net import SphereNet, light_of, pad_faces
from lightprobe.distill.sphere_training import fill_album, sphere_loss
from lightprobe.distill.training import train
from lightprobe.light import cubemap
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


@pytest.mark.slow
def test_a_short_training_beats_the_constant_and_the_stacked_light_on_photos_it_has_not_seen():
    asset, camera = glossy_sphere(), camera_at((2.6, 1.4, 1.2), size=40, focal=53.0)
    random = torch.Generator().manual_seed(2)
    axes = torch.nn.functional.normalize(torch.randn(40, 3, generator=random), dim=1)
    photos = [lesson(asset, camera, patch_light(axis.tolist()), f"photo{k}") for k, axis in enumerate(axes)]
    config = DistillConfig(steps=20, samples=256, width=16, depth=1, sphere_steps=120, sphere_width=8)
    model = train(photos[:32], config, CPU, seed=0)
    album = fill_album(model.network, photos[32:], config, 0)
    log_constant = torch.full_like(album.lights, 1 + BLACK).log().reshape(-1, 3, 6, 16, 16)
    with torch.no_grad():
        network, stacked, constant = (
            float(sphere_loss(light, album.lights))
            for light in (model.sphere(album.maps), album.maps[:, :3], log_constant)
        )
    assert network < 0.5 * stacked
    assert network < 0.5 * constant


def test_maps_do_not_depend_on_exposure():
    asset, camera = glossy_sphere(), camera_at((2.6, 1.4, 1.2), size=40, focal=53.0)
    config = DistillConfig(samples=256, width=16, depth=1, steps=1, sphere_steps=0)
    dim = patch_light((1.0, 0.3, 0.4), brightness=2.0) * 0.1
    lessons = [lesson(asset, camera, light, "photo") for light in (dim, 4 * dim)]
    lessons = [replace(one, clipped=torch.zeros_like(one.clipped)) for one in lessons]
    model = train(lessons, config, CPU, 0)
    maps = [fill_album(model.network, [one], config, 0).maps for one in lessons]
    torch.testing.assert_close(maps[0], maps[1], rtol=1e-3, atol=1e-3)
