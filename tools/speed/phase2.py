"""Phase II on the ball, step by step: its lessons, the time of a step of each network, and what its parts
take.
"""

import time
from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import nn

from lightprobe.core.config.distillation import DistillConfig
from lightprobe.distillation.examples import ExampleMaker, TrainingExample
from lightprobe.distillation.mlp_training import example_loss, example_tensors
from lightprobe.distillation.sphere_training import batch, sphere_examples, sphere_loss
from lightprobe.distillation.training import train
from lightprobe.light import cubemap
from lightprobe.models.probe_model import new_network, new_sphere
from lightprobe.render.asset import Asset, rasterize_asset
from lightprobe.training import Adam, ParameterGroup, Progress
from speed.ball import CPU, LIT, camera, light
from speed.clock import WARM, Parts, median_gap
from speed.phase1 import SEED, picture

UP = torch.tensor([0.0, 0.0, 1.0])


def lessons_of(asset: Asset, count: int, config: DistillConfig) -> list[TrainingExample]:
    """Return a lesson from each of `count` cameras."""
    lessons = []
    for number in range(count):
        gbuffer = rasterize_asset(asset, camera(config.max_side, number, count), CPU)
        photo = picture(asset, config.max_side, number, count)
        desk = ExampleMaker(gbuffer, UP, config)
        at = gbuffer.pixel
        lessons.append(desk.example(photo.name, photo.color[at], photo.clipped[at], light(LIT, number)))
    return lessons


def step_seconds(lessons: list[TrainingExample], config: DistillConfig, steps: int) -> dict[str, float]:
    """Return the median seconds of a step of the illumination MLP and of the sphere network."""
    stamps: list[float] = []
    short = replace(config, steps=steps + WARM, sphere_steps=steps + WARM)
    train(lessons, short, CPU, SEED, Progress(on_step=lambda *_: stamps.append(time.perf_counter())))
    return {
        "step of Phase II's MLP": median_gap(stamps[: short.steps]),
        "step of the sphere network": median_gap(stamps[short.steps :]),
    }


def profile(
    lessons: Sequence[TrainingExample], config: DistillConfig, steps: int
) -> dict[str, dict[str, float]]:
    """Return the median seconds of each part of a step of both networks."""
    network, sphere = new_network(config, SEED), new_sphere(config, SEED)
    directions = cubemap.directions(config.light_resolution).reshape(-1, 3)
    angles = cubemap.solid_angles(config.light_resolution).reshape(-1)
    examples = sphere_examples(network, lessons, config, SEED)
    modules: dict[str, nn.Module] = {"MLP": network, "sphere network": sphere}
    found = {}
    for name, module in modules.items():
        parts, adam = Parts(), Adam([ParameterGroup(dict(module.named_parameters()), rate=1e-3)])
        for step in range(steps + WARM):
            adam.forget_gradients()
            with parts.part("network and loss"):
                if module is sphere:
                    maps, lights = batch(examples, SEED, step)
                    loss = sphere_loss(sphere(maps), lights)
                else:
                    given = example_tensors(lessons[step % len(lessons)], config, SEED, step)
                    loss = example_loss(network, given, directions, angles, config)
            with parts.part("backward"):
                loss.backward()
            with parts.part("optimiser"):
                adam.step()
        found[name] = parts.medians(WARM)
    return found
