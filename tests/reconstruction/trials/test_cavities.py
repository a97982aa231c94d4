"""A cup that its masks show closed is opened where photos show its inside; a solid block stays solid."""

import copy
from dataclasses import replace

import numpy as np
import pytest
import torch

from lightprobe.core.config import DecomposeConfig, SdfMode, StartShape
from lightprobe.light.prefilter import cached
from lightprobe.light.resize import rotate_light
from lightprobe.reconstruction import image_objective
from lightprobe.reconstruction.image_objective import ImageObjective
from lightprobe.reconstruction.lattice_model import LatticeModel
from lightprobe.reconstruction.lights import Lights
from lightprobe.reconstruction.photos import Target
from lightprobe.reconstruction.start import Start, start_from_box
from lightprobe.reconstruction.trials import cavities
from lightprobe.reconstruction.trials.cavities import Opening, best_opening, has_doubtful_lid
from lightprobe.reconstruction.trials.evidence import Evidence
from lightprobe.reconstruction.trials.trial import PassPhotos, Trial, TrialPhotos
from lightprobe.render.split_sum import shade
from lightprobe.render.surface import View
from lightprobe.training import Stage
from tests.gbuffers import sky, turned
from tests.shapes import camera_at

CPU = torch.device("cpu")
CONFIG = DecomposeConfig(hash_levels=4, hash_finest=16, trial_steps=40)
SIDE, CELLS, COUNT = 36, 36, 10


def vessel(inner: float | None) -> Start:
    """A lattice with an upright cylinder, closed, or with the radius of its inside."""
    start = start_from_box(StartShape.SPHERE, CELLS, 0)
    points = start.lattice.vertices.numpy()
    across, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    distance = np.maximum(across - 0.75, np.abs(z) - 0.5)
    if inner is not None:
        distance = np.maximum(distance, np.minimum(inner - across, z + 0.39))
    return Start(start.lattice, torch.from_numpy(distance.astype(np.float32)))


def photos(model: LatticeModel, count: int = COUNT) -> tuple[list[Target], Lights]:
    """Photos of a model from above all around, each under a turned light of its own, and these lights."""
    operator, targets = cached(CONFIG.light_resolution), []
    lights = Lights([f"photo{k}" for k in range(count)], CONFIG, CPU, 0)
    for k in range(count):
        angle = 2 * np.pi * k / COUNT
        view = View.of(
            camera_at((2.2 * np.cos(angle), 2.2 * np.sin(angle), 2.0), size=SIDE, focal=1.1 * SIDE), CPU
        )
        light = rotate_light(0.3 * sky(CONFIG.light_resolution), turned(2.4 * k), CONFIG.light_resolution)
        lights.replace(f"photo{k}", light)
        (pixels,) = model.gbuffers([view], 1.0)
        color, alpha = torch.zeros(SIDE * SIDE, 3), torch.zeros(SIDE * SIDE)
        color[pixels.pixel], alpha[pixels.pixel] = shade(pixels, operator, operator.apply(light)), 1.0
        targets.append(Target(f"photo{k}", view, color, alpha, torch.zeros(SIDE * SIDE, 3, dtype=torch.bool)))
    return targets, lights


def model_of(inner: float | None) -> LatticeModel:
    """A model of the cylinder in one plain material, with its visibility."""
    model = LatticeModel(vessel(inner), CONFIG, CPU, 0)
    model.update_visibility()
    return model


@pytest.mark.long
def test_a_cup_is_opened(monkeypatch):
    monkeypatch.setattr(cavities, "_WALLS", (1.75, 3.0))
    monkeypatch.setattr(cavities, "_DEPTHS", (1.0, 0.5))
    targets, lights = photos(model_of(inner=0.64))
    closed = model_of(inner=None)
    before = closed.distances().detach().clone()
    opening = best_opening(closed, PassPhotos(targets, lights, 1.0, 0))
    assert opening is not None
    middle = closed.lattice.vertices.norm(dim=1).argmin()
    assert before[middle] < 0 < opening.distance[middle]
    assert torch.equal(closed.distances().detach(), before)  # the model itself stays as it is


@pytest.mark.long
def test_a_cavity_is_judged_by_pixels_that_show_it(monkeypatch):
    monkeypatch.setattr(cavities, "_WALLS", (3.0,))
    monkeypatch.setattr(cavities, "_DEPTHS", (1.0,))
    closed, judged, evidence_of = model_of(inner=None), [], Evidence.of

    def spy(trial, part, *rest):
        if part.__name__ == "inside":
            judged.append([(sample.pixels.position, part(sample)) for sample in trial.samples])
        return evidence_of(trial, part, *rest)

    monkeypatch.setattr(cavities.Evidence, "of", spy)
    assert best_opening(closed, PassPhotos(*photos(model_of(inner=0.64)), 1.0, 0)) is not None
    of_closed, of_opened = judged
    for position, rows in of_closed:
        assert len(rows) > 0
        assert (position[rows, 2] > 0.45).all()  # the lid, of which a rim of three cells stays
        assert (position[rows, :2].norm(dim=1) < 0.75 - 2 * closed.lattice.cell).all()
    for position, rows in of_opened:
        assert len(rows) > 0
        assert (position[rows, 2] < 0.5 - closed.lattice.cell).all()


@pytest.mark.long
def test_a_block_stays_solid(monkeypatch):
    monkeypatch.setattr(cavities, "_SUSPECT", -1.0)  # its best explained lids, too
    monkeypatch.setattr(cavities, "_TRIED", 1)
    monkeypatch.setattr(cavities, "_WALLS", (1.75, 3.0))
    solid = model_of(inner=None)
    targets, lights = photos(solid)
    assert best_opening(solid, PassPhotos(targets, lights, 1.0, 0)) is None


@pytest.mark.long
def test_what_is_explained_as_well_as_the_rest_is_not_suspect(monkeypatch):
    solid = model_of(inner=None)
    surface = cavities._surface(solid)
    assert cavities._suspects(solid, surface, PassPhotos(*photos(solid), 1.0, 0)) == []
    cup = PassPhotos(*photos(model_of(inner=0.64)), 1.0, 0)
    (top,) = cavities._suspects(solid, surface, cup)
    assert surface.vertices[top.lid.vertices, 2].min() > 0.4
    for bound, doubtful in ((0.99 * top.excess, True), (1.01 * top.excess, False)):
        monkeypatch.setattr(cavities, "_DOUBTFUL", bound)
        assert has_doubtful_lid(solid, cup) == doubtful


def attempt(wall: float, *gains: float) -> cavities._Attempt:
    """An attempt with a wall and the gains of photos."""
    unused = None
    return cavities._Attempt(wall, unused, unused, unused, unused, torch.tensor(gains))  # type: ignore[arg-type]


def test_the_thinnest_of_walls_that_are_as_good_is_preferred():
    best, tied, worse = attempt(2.0, 0.1, 0.3), attempt(1.0, 0.15, 0.15), attempt(0.5, 0.02, 0.04)
    assert cavities._by_preference([worse, best, tied]) == [tied, best, worse]
    assert cavities._by_preference([]) == []
    surer = attempt(2.0, 0.2, 0.2)
    assert cavities._by_preference([tied, surer]) == [surer, tied]


@pytest.mark.long
def test_the_pass_goes_on_with_the_opening_that_was_found(monkeypatch):
    model = model_of(inner=None)
    targets, lights = photos(model, count=2)
    task, opened = (
        ImageObjective(model, targets, lights, Stage("pass1", 0, 4), model.config, 0),
        vessel(0.64).distance,
    )
    trial = Trial(copy.deepcopy(model.material), TrialPhotos([], task.lights, 0), steps=0)
    trial.material.brightness.mul_(2)
    trial.lights = {"photo1": torch.full_like(task.lights.maps[1], 0.25)}
    for name in ("best_opening", "best_metals", "best_rescaled"):
        found = Opening(opened, trial) if name == "best_opening" else None
        monkeypatch.setattr(image_objective, name, lambda *_, found=found, **__: found)
    task.refresh(1050, 0.7)
    assert torch.allclose(model.distances(), opened, atol=1e-6)
    assert model.material.brightness == trial.material.brightness
    assert (task.lights.maps[1] == 0.25).all()


def small_task() -> ImageObjective:
    """The first pass's task of a ball on a coarse lattice, with two photos and no shadows."""
    model = LatticeModel(start_from_box(StartShape.SPHERE, 8, 0), replace(CONFIG, shadows=False), CPU, 0)
    targets, lights = photos(model, count=2)
    return ImageObjective(model, targets, lights, Stage("pass1", 0, 4), model.config, 0)


@pytest.mark.parametrize("found", [False, True], ids=["solid", "lid"])
def test_a_lid_is_in_doubt_until_it_is_tried(monkeypatch, found):
    task, resumed = small_task(), small_task()
    for name, answer in {
        "has_doubtful_lid": found,
        "best_opening": None,
        "best_new": None,
        "best_metals": None,
        "best_rescaled": None,
        "choose_brightness": 1.0,
    }.items():
        monkeypatch.setattr(image_objective, name, lambda *_, answer=answer, **__: answer)
    assert task.model.lid_in_doubt  # nobody has looked yet
    task.refresh(300, 0.2)
    assert task.model.lid_in_doubt == found
    held = resumed.model.lid_in_doubt
    resumed.load_buffers(task.buffers())
    assert resumed.model.lid_in_doubt is held
    assert held == found
    task.refresh(1050, 0.7)
    assert not task.model.lid_in_doubt


@pytest.mark.parametrize(
    "changes",
    [
        {"pass1_iterations": 400},
        {"trial_steps": 0},
        {"priors": False},
        {"sdf": SdfMode.MLP},
        {"texture_gradient_from": 0.0},
        {"texture_gradient_from": 1.0},
    ],
)
def test_no_lid_is_in_doubt_where_none_is_tried_or_the_texture_moves_always_or_never(changes):
    model = LatticeModel(start_from_box(StartShape.SPHERE, 8, 0), replace(CONFIG, **changes), CPU, 0)
    assert not model.lid_in_doubt
