"""The third pass finds detail that the second one left out, and a texture's size can change."""

from dataclasses import replace

import pytest
import torch

from lightprobe.core.config import DecomposeConfig
from lightprobe.reconstruction import texture_objective
from lightprobe.reconstruction.lights import Lights
from lightprobe.reconstruction.photos import Target
from lightprobe.reconstruction.surface_model import SurfaceModel
from lightprobe.reconstruction.texture_objective import PhotoPixels, TextureObjective
from lightprobe.render.surface import View
from lightprobe.training import Progress, Stage, Training, descent
from lightprobe.training.descent import exponential
from tests.lit_sphere import CPU, PATCHES, glossy_sphere, patch_light, photograph
from tests.shapes import camera_at
from tests.tape import compute_as_a_gpu_does, record_on_tape

CONFIG = DecomposeConfig(shadows=False, light_resolution=16)


def targets(asset):
    """Return a ring of photos, each under another light."""
    found = []
    for k, patch in enumerate(PATCHES):
        camera = camera_at((2.6 - k, 1.4 * (-1) ** k, 1.2), size=64, focal=80.0)
        photo = photograph(asset, camera, patch_light(patch))
        color, clipped = (torch.from_numpy(part).reshape(-1, 3) for part in (photo.color, photo.clipped))
        alpha = torch.from_numpy(photo.alpha).reshape(-1)
        found.append(Target(f"photo{k}", View.of(camera, CPU), color * alpha[:, None], alpha, clipped))
    return found


def plain(asset):
    """Return the asset without its blotches."""
    maps = asset.textures
    flat = maps.base_color.mean((0, 1)).expand_as(maps.base_color).contiguous()
    return replace(asset, textures=replace(maps, base_color=flat))


def refine(asset, photos, steps, config=CONFIG):
    model = SurfaceModel(asset, config)
    lights = Lights([photo.name for photo in photos], config, CPU, 0)
    stage = Stage("pass3", 0, steps, exponential(steps), (0.9, config.adam_decay), 1e-12)
    losses = []
    progress = Progress(on_step=lambda stage, step, steps, loss: losses.append(loss))
    pixels = [PhotoPixels.of(asset, photo, 0) for photo in photos]
    training = Training("Phase I", {}, 0, (stage,), config.checkpoint_every, progress)
    training.run(TextureObjective(model, pixels, lights, stage, config, 0), stage)
    return model.asset(), losses


@pytest.mark.long
def test_blotches_come_back():
    true = glossy_sphere()
    photos = targets(true)
    start = plain(true)
    found, losses = refine(start, photos, 40)
    assert sum(losses[-5:]) < 0.5 * sum(losses[:5])
    seen = torch.zeros(true.textures.size**2, dtype=torch.bool)
    for photo in photos:
        surface = PhotoPixels.of(true, photo, 0).surface
        uv = (surface.interpolate(true.mesh.uvs, true.mesh.uv_faces) * true.textures.size).long()
        seen[uv[:, 1] * true.textures.size + uv[:, 0]] = True

    def contrast(asset):
        """Return how well the base colours' differences between texels follow the true ones, and their
        strength.
        """
        a, b = (t.textures.base_color.reshape(-1, 3)[seen] for t in (asset, true))
        a, b = a - a.mean(0), b - b.mean(0)
        return float((a * b).sum() / (a.norm() * b.norm()).clamp(min=1e-9))

    assert contrast(start) < 0.01
    assert contrast(found) > 0.5
    assert torch.equal(found.mesh.vertices, true.mesh.vertices)


@pytest.mark.long
def test_recorded_steps_find_what_single_ones_do(monkeypatch):
    compute_as_a_gpu_does(monkeypatch)
    monkeypatch.setattr(
        texture_objective, "_PIXELS", 300
    )  # which every photo has, so that all steps are alike
    config = replace(CONFIG, light_resolution=8)
    photos = targets(glossy_sphere())

    single, before = refine(plain(glossy_sphere()), photos, 6, config)
    recorders = record_on_tape(monkeypatch, descent)
    recorded, after = refine(plain(glossy_sphere()), photos, 6, config)
    assert [recorder.replays for recorder in recorders] == [3]
    assert after == pytest.approx(before, rel=1e-4)
    start, one, other = (asset.textures.flat() for asset in (plain(glossy_sphere()), single, recorded))
    assert float((other - one).norm()) < 0.01 * float((one - start).norm())


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bits():
    photos = targets(glossy_sphere())
    one, two = (refine(plain(glossy_sphere()), photos, 3)[0] for _ in range(2))
    assert torch.equal(one.textures.flat(), two.textures.flat())
