"""Trainings on the bundled scene: the demo's on device and CPU; the first steps of `standard` on the device."""

import time
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

import torch

from benchmarks.gpu.parts import Pace, Setting
from benchmarks.speed.training import small
from lightprobe.core.config import DecomposeConfig, Preset, demo_settings, settings
from lightprobe.core.config.distillation import DistillConfig
from lightprobe.core.device import resolve_device
from lightprobe.core.files import write_json
from lightprobe.core.memory import peak_memory
from lightprobe.core.run import RunFolder
from lightprobe.distillation.training import distill
from lightprobe.evaluation import evaluate
from lightprobe.evaluation.evaluation import Protocols
from lightprobe.models import Decomposition, ProbeModel
from lightprobe.prediction import methods_for
from lightprobe.reconstruction import decompose
from lightprobe.report.headings import IMAGES, LIGHTS, MAPS, OBJECT
from lightprobe.scene import load_scene
from lightprobe.scene.photo import Scene
from lightprobe.scene.record import scene_record
from lightprobe.training import Progress

SCENE = Path(str(resources.files("lightprobe") / "assets" / "demo"))
_SPHERES = ("diffuse_si_rmse", "matte_si_rmse", "mirror_si_rmse")
_SCORES = ("psnr_masked", "psnr_unseen", "relit_psnr_scaled", *_SPHERES, "light_log_rmse_scaled")
HEADINGS = {
    key: (IMAGES | LIGHTS | MAPS | OBJECT)[key] for key in (*_SCORES, "base_color_psnr_scaled", "chamfer")
}


@dataclass(frozen=True)
class Learned:
    """What a training left, and what it took."""

    decomposition: Decomposition
    model: ProbeModel
    first: float  # seconds of Phase I
    second: float  # of Phase II, training examples included
    memory: str


def scene(*, brief: bool) -> Scene:
    """Return the bundled scene, with a few of its photos for a brief measurement."""
    whole = load_scene(SCENE)
    return replace(whole, train=whole.train[:4], test=whole.test[:1], relight=()) if brief else whole


def brief_configs() -> tuple[DecomposeConfig, DistillConfig]:
    """Return configurations that take seconds."""
    size = small()
    first = replace(
        size.decompose, pass1_iterations=4, pass2_iterations=3, pass3_iterations=2, max_faces=2000
    )
    first = replace(first, validation_photos=0, pass3_texture_size=256, teacher_resolution=16)
    return first, replace(size.distill, steps=4, sphere_steps=4, synthetic_lessons=4)


def learn(
    name: str,
    first: DecomposeConfig,
    second: DistillConfig,
    device: torch.device,
    setting: Setting,
    pace: Pace,
) -> Learned:
    """Train both phases on the bundled scene; the names of the stages begin with `name`."""
    photos = scene(brief=setting.brief)
    if device.type == "cuda":
        torch.cuda.init()  # until then a device that was named by its number has no memory to ask about
        torch.cuda.reset_peak_memory_stats(device)
    begin = time.perf_counter()
    progress = Progress(on_step=lambda stage, step, steps, loss: pace.step(f"{name}: {stage}", step, steps))
    found = decompose(photos, first, device, setting.seed, progress)
    middle = time.perf_counter()

    def on_example(done: int, count: int) -> None:
        pace.step(f"{name}: training examples", done, count)

    model = distill(found, photos, second, device, setting.seed, progress, on_example=on_example)
    memory, of = peak_memory(), "the process"
    if device.type == "cuda":
        memory, of = torch.cuda.max_memory_allocated(device) / 2**30, "the GPU"
    used = "–" if memory is None else f"{memory:.2f} GiB of {of}"
    return Learned(found, model, middle - begin, time.perf_counter() - middle, used)


def keep(learned: Learned, folder: Path) -> None:
    """Save a training as a run folder that predictions can load."""
    run = RunFolder.create(folder)
    write_json(run.config_file, {})
    whole, lights = load_scene(SCENE), learned.decomposition.lights
    seen = replace(whole, train=tuple(photo for photo in whole.train if photo.name in lights))
    write_json(run.scene_file, scene_record(seen))
    learned.decomposition.save(run)
    learned.model.save(run.model_folder)


def score_row(name: str, learned: Learned, device: torch.device, setting: Setting) -> str:
    """Return the row of a training: its times and its scores on the test photos by the default method."""
    found = evaluate(
        learned.decomposition,
        learned.model,
        scene(brief=setting.brief),
        methods=methods_for(learned.model)[:1],
        device=device,
        protocols=Protocols(unseen=not setting.brief),
    )
    mean = found.to_json()["mean"]
    scores = [heading.text(mean[key]) if key in mean else "–" for key, heading in HEADINGS.items()]
    return (
        f"| {name} | {learned.first:.0f} | {learned.second:.0f} | {learned.memory} | {' | '.join(scores)} |"
    )


def quality_part(setting: Setting) -> None:
    """Train the demo on the device and on the CPU, from the same seed, and score both where they were trained."""
    titles = " | ".join(f"{heading.name} {heading.arrow}".strip() for heading in HEADINGS.values())
    head = f"| training | Phase I, s | Phase II, s | memory | {titles} |"
    setting.write("quality", [head, "| --- | ---: | ---: | --- |" + " ---: |" * len(HEADINGS)])
    usual, pace = demo_settings(), Pace("quality", setting)
    configs = brief_configs() if setting.brief else (usual.decompose, usual.distill)
    for place in dict.fromkeys((setting.device, "cpu")):
        device = resolve_device(place)
        name = f"demo, seed {setting.seed}, on {device.type}"
        learned = learn(name, *configs, device, setting, pace)
        if place == setting.device:
            keep(learned, setting.folder / "run")
        setting.write("quality", [score_row(name, learned, device, setting)])


def pace_part(setting: Setting) -> None:
    """Take the first steps of each stage of `standard` on the device; the table of stages tells their pace."""
    usual, device = settings(Preset.STANDARD), resolve_device(setting.device)
    first = replace(usual.decompose, pass1_iterations=250, pass2_iterations=150, pass3_iterations=150)
    second = replace(usual.distill, steps=300, sphere_steps=300, synthetic_lessons=300)
    configs = brief_configs() if setting.brief else (first, second)
    learned = learn(f"standard on {device.type}", *configs, device, setting, Pace("pace", setting))
    setting.write("pace", [f"Memory: {learned.memory}."])
