"""Objects that nobody made: sound solids, and lessons that a number alone decides."""

import sys

import pytest
import torch

import pretrain_sphere_net
from lightprobe.core.checkpoint import load_tensors
from lightprobe.core.config.distillation import DistillConfig
from lightprobe.core.device import generator
from lightprobe.distillation.draw import Draw
from lightprobe.distillation.sphere_training import sphere_examples, sphere_loss
from lightprobe.geometry.mesh import is_closed
from lightprobe.models.probe_model import new_network, new_sphere
from pretraining import photos
from pretraining.photos import LIGHTS, VIEWS, lessons_of
from pretraining.solids import random_solid


def test_solids_are_centred_closed_and_different():
    solids = [random_solid(Draw(generator(0, "test", k))) for k in range(3)]
    for vertices, faces in solids:
        assert abs(float(vertices.norm(dim=1).max()) - 1) < 1e-6
        assert float((vertices.amax(0) + vertices.amin(0)).abs().max()) < 1e-5
        a, b, c = vertices[faces.long()].unbind(1)
        assert float((a * torch.linalg.cross(b, c)).sum()) > 0, "inside out"
    assert any(is_closed(*solid) for solid in solids)
    assert len({len(vertices) for vertices, _ in solids}) == 3


@pytest.mark.long
def test_a_number_decides_the_lessons_and_their_lights_differ():
    config = DistillConfig(samples=64)
    first, again = lessons_of(3, config, seed=1), lessons_of(3, config, seed=1)
    assert 0 < len(first) <= VIEWS * LIGHTS
    for one, same in zip(first, again, strict=True):
        assert torch.equal(one.pixels.color, same.pixels.color)
        assert torch.equal(one.target, same.target)
    assert not torch.equal(first[0].target, first[1].target)
    assert float(first[0].up[2]) > 0.8
    assert all(bool(torch.isfinite(one.solved).all()) for one in first)


@pytest.mark.slow
def test_the_bundled_network_knows_a_solid_and_lights_that_it_has_not_seen():
    config = DistillConfig()
    examples = sphere_examples(new_network(config), lessons_of(0, config, seed=1234), config, 0)
    with torch.no_grad():
        bundled = float(sphere_loss(new_sphere(config)(examples.maps), examples.lights))
        stacked = float(sphere_loss(examples.maps[:, :3], examples.lights))
    assert bundled < 0.5 * stacked


@pytest.mark.slow
def test_the_command_writes_weights_that_a_training_can_start_from(tmp_path, monkeypatch):
    monkeypatch.setattr(photos, "VIEWS", 2)
    monkeypatch.setattr(photos, "LIGHTS", 2)
    words = [
        "--solids",
        "1",
        "--steps",
        "2",
        "--sphere-steps",
        "2",
        "--out",
        str(tmp_path / "net.safetensors"),
    ]
    monkeypatch.setattr(sys, "argv", ["pretrain_sphere_net.py", *words])
    pretrain_sphere_net.main()
    trained, bundled = load_tensors(tmp_path / "net.safetensors"), new_sphere(DistillConfig()).state_dict()
    assert {name: value.shape for name, value in trained.items()} == {n: v.shape for n, v in bundled.items()}
    assert all(bool(value.isfinite().all()) for value in trained.values())
