"""Surface points are sorted into the few materials of an object, of which one can be held."""

import pytest
import torch
from lightprobe.reconstruction.materials import HeldMetallic, Materials
from lightprobe.reconstruction.scaled_material import ScaledMaterial

from lightprobe.core.config import DecomposeConfig

CPU = torch.device("cpu")
CONFIG = DecomposeConfig(hash_levels=4, hash_finest=32)


def points(count=200):
    return 2 * torch.rand(count, 3, generator=torch.Generator().manual_seed(0)) - 1


def halves(points):
    """A material that is a red paint where x < 0 and a rough grey metal elsewhere."""
    left = points[:, :1] < 0
    red, grey = (
        torch.tensor(row)
        for row in ([0.6, 0.05, 0.05, 0.3, 0.0, 0, 0, 0], [0.3, 0.3, 0.3, 0.6, 1.0, 0, 0, 0])
    )
    return torch.where(left, red, grey)


def test_points_are_sorted_into_the_materials_they_are_of(monkeypatch):
    material = ScaledMaterial(0.3, CONFIG, CPU, 0)
    monkeypatch.setattr(ScaledMaterial, "forward", lambda self, points: halves(points))
    materials = Materials.of(material, points(), 0)
    number = materials.at(points())
    left = points()[:, 0] < 0
    assert set(number[left].tolist()) & set(number[~left].tolist()) == set()
    assert sum(materials.shares(points())) == pytest.approx(1.0)


def test_the_metallic_of_one_material_is_held_whatever_the_field_becomes(monkeypatch):
    material = ScaledMaterial(0.3, CONFIG, CPU, 0)
    with monkeypatch.context() as patched:
        patched.setattr(ScaledMaterial, "forward", lambda self, points: halves(points))
        materials = Materials.of(material, points(), 0)
        number = materials.at(points())
        monkeypatch.setattr(Materials, "at", lambda self, _: number)
    before = material(points())
    chosen = int(number[0])
    material.held = [HeldMetallic(materials, chosen, 0.9)]
    after = material(points())
    assert (after[number == chosen, 4] == 0.9).all()
    assert torch.equal(after[number != chosen], before[number != chosen])
    assert torch.equal(after[:, :4], before[:, :4])
