"""A run folder as a training leaves it, made without one: the toy scene's ball, its photos and lights."""

import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import torch

from lightprobe.core.config import DecomposeConfig
from lightprobe.core.config.distillation import quick
from lightprobe.core.run import RunFolder
from lightprobe.export import write_run_outputs
from lightprobe.geometry.textures import Textures
from lightprobe.light.cubemap import directions
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition, ProbeModel
from lightprobe.models.probe_model import new_network, new_sphere
from lightprobe.render.asset import Asset
from lightprobe.scene import load_scene
from lightprobe.scene.record import scene_record
from tests.shapes import sphere_mesh
from tests.toy_scene import write_toy_scene

SETTINGS = DecomposeConfig(
    pass1_iterations=4,
    pass2_iterations=3,
    pass3_iterations=3,
    pass1_side=24,
    pass2_side=24,
    lattice_cells=8,
    hull_voxels=16,
    hash_levels=2,
    hash_finest=16,
    light_resolution=8,
    teacher_resolution=8,
    texture_size=64,
    pass3_texture_size=64,
    unwrap_seconds=0.0,
    shadows=False,
    checkpoint_every=2,
    trial_steps=0,
)


def side_light(number: int) -> Environment:
    """Return a smooth light that comes mostly from one of four sides, so that each lights the ball otherwise."""
    side = directions(32) @ torch.tensor([math.cos(1.6 * number), math.sin(1.6 * number), 0.5])
    level = 0.3 + 0.6 * side.clamp(min=0)
    return Environment(level[..., None] * torch.tensor([1.1, 1.0, 0.9]))


def begun_run(folder: Path) -> RunFolder:
    """Return a run whose training has begun: the scene is read, the first steps are recorded."""
    scene = load_scene(write_toy_scene(folder / "scene", train=12, test=1))
    run = RunFolder.create(folder / "run")
    run.record_scene(scene_record(scene))
    run.record_config("decompose", {"seed": 0, **asdict(SETTINGS)})
    for step, loss in ((1, 0.5), (2, 0.25)):
        run.append_metrics("decompose", step, {"stage": "pass1", "loss": loss})
    run.log("decompose starts")
    return run


def finished_run(folder: Path) -> RunFolder:
    """Return a run with object and lights, as Phase I leaves it."""
    run = begun_run(folder)
    scene = load_scene(Path(run.scene()["root"]))
    size = 64
    v, u = np.mgrid[:size, :size] / size
    color = torch.from_numpy(np.stack([0.2 + 0.6 * u, 0.3 + 0 * u, 0.8 - 0.6 * v], -1)).float()
    flat = torch.zeros(size, size, 3)
    flat[..., 2] = 1
    textures = Textures(color, torch.full((size, size), 0.6), torch.zeros(size, size), flat)
    lights = {photo.name: side_light(number) for number, photo in enumerate(scene.train)}
    ball = sphere_mesh(3)
    vertices = torch.from_numpy(
        scene.similarity.apply(ball.vertices.numpy())
    ).float()  # of radius 1 in the user's frame
    decomposition = Decomposition(Asset(replace(ball, vertices=vertices), textures), lights, scene.similarity)
    write_run_outputs(decomposition, run)
    decomposition.save(run)
    run.append_metrics("decompose", 7, {"stage": "pass2", "held_out_before": 20.0, "held_out": 21.5})
    return run


def add_model(run: RunFolder) -> None:
    """Add networks as Phase II leaves them, small and untrained."""
    config = replace(quick(), light_resolution=8, width=16, depth=2, sphere_width=4)
    light, up = Environment(torch.ones(6, 8, 8, 3)), torch.tensor([0.0, 0.0, 1.0])
    ProbeModel(new_network(config), light, up, config, new_sphere(config)).save(run.model_folder)
    run.record_config("distill", {"seed": 0, **asdict(config)})


def records(run: RunFolder) -> list[dict]:
    """Return the lines of metrics.jsonl."""
    return [json.loads(line) for line in run.metrics_log.read_text().splitlines()]
