"""Trainings on the bundled scene: the demo's on device and CPU; `standard` on the device, begun and whole."""

import time
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

import torch

from benchmarks.gpu.parts import Pace, Setting
from benchmarks.speed.training import small
from lightprobe.core.config import DecomposeConfig, distillation, reconstruction
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
SCORES = (
    "psnr_masked",
    "psnr_unseen",
    "relit_psnr_scaled",
    "diffuse_si_rmse",
    "matte_si_rmse",
    "mirror_si_rmse",
    "light_log_rmse_scaled",
    "base_color_psnr_scaled",
    "chamfer",
)
_BEGUN = {
    "pass1": 250,
    "pass2": 150,
    "pass3": 150,
    "network": 300,
    "sphere": 300,
}  # steps of each stage of `pace`
_HEADINGS = {**IMAGES, **LIGHTS, **MAPS, **OBJECT}


@dataclass(frozen=True)
class Learned:
    """What a training left, and what it took."""

    decomposition: Decomposition
    model: ProbeModel
    first: float  # seconds of Phase I
    second: float  # of Phase II, lessons included
    memory: str


def scene(*, brief: bool) -> Scene:
    """Return the bundled scene, with a few of its photos for a brief measurement."""
    whole = load_scene(SCENE)
    return replace(whole, train=whole.train[:4], test=whole.test[:1], relight=()) if brief else whole


def configurations(preset: str, *, brief: bool) -> tuple[DecomposeConfig, DistillConfig]:
    """Return the configurations of `demo` or `standard`, or some of seconds."""
    if brief:
        size = small()
        first = replace(
            size.decompose,
            pass1_iterations=4,
            pass2_iterations=3,
            pass3_iterations=2,
            validation_photos=0,
            pass3_texture_size=256,
            teacher_resolution=16,
            max_faces=2000,
        )
        return first, replace(size.distill, steps=4, sphere_steps=4, synthetic_lessons=4)
    if preset == "standard":
        return reconstruction.standard(), distillation.standard()
    return reconstruction.demo(), distillation.demo()


def stage_steps(first: DecomposeConfig, second: DistillConfig) -> dict[str, int]:
    """Return how many steps each stage of a training takes."""
    return {
        "pass1": first.pass1_iterations,
        "pass2": first.pass2_iterations,
        "pass3": first.pass3_iterations,
        "network": second.steps,
        "sphere": second.sphere_steps,
    }


def begun(first: DecomposeConfig, second: DistillConfig) -> tuple[DecomposeConfig, DistillConfig]:
    """Return configurations of at most `_BEGUN` steps."""
    steps = {stage: min(whole, _BEGUN[stage]) for stage, whole in stage_steps(first, second).items()}
    return (
        replace(
            first,
            pass1_iterations=steps["pass1"],
            pass2_iterations=steps["pass2"],
            pass3_iterations=steps["pass3"],
        ),
        replace(
            second,
            steps=steps["network"],
            sphere_steps=steps["sphere"],
            synthetic_lessons=min(second.synthetic_lessons, _BEGUN["sphere"]),
        ),
    )


def learn(
    preset: str, place: str, device: torch.device, setting: Setting, pace: Pace, *, whole: bool = True
) -> Learned:
    """Train both phases on the bundled scene, or only begin each stage; the stages' names begin with `place`."""
    photos, (first, second) = scene(brief=setting.brief), configurations(preset, brief=setting.brief)
    full = stage_steps(first, second)
    if not whole:
        first, second = begun(first, second)
    if device.type == "cuda":
        torch.cuda.init()  # until then a device that was named by its number has no memory to ask about
        torch.cuda.reset_peak_memory_stats(device)
    begin = time.perf_counter()
    progress = Progress(
        on_step=lambda stage, step, steps, loss: pace.step(f"{place}: {stage}", step, full.get(stage, steps))
    )
    found = decompose(photos, first, device, setting.seed, progress)
    middle = time.perf_counter()
    model = distill(
        found,
        photos,
        second,
        device,
        setting.seed,
        progress,
        on_lesson=lambda done, count: pace.step(f"{place}: photos turned into lessons", done, count),
    )
    return Learned(found, model, middle - begin, time.perf_counter() - middle, _memory(device))


def _memory(device: torch.device) -> str:
    if device.type == "cuda":
        return f"{torch.cuda.max_memory_allocated(device) / 2**30:.2f} GiB of the GPU"
    used = peak_memory()
    return "–" if used is None else f"{used:.2f} GiB of the process"


def keep(learned: Learned, folder: Path) -> None:
    """Save a training as a run folder that predictions can load."""
    run = RunFolder.create(folder)
    write_json(run.config_file, {})
    whole, lights = load_scene(SCENE), learned.decomposition.lights
    seen = replace(whole, train=tuple(photo for photo in whole.train if photo.name in lights))
    write_json(run.scene_file, scene_record(seen))
    learned.decomposition.save(run)
    learned.model.save(run.model_folder)


def score_rows(name: str, learned: Learned, device: torch.device, setting: Setting) -> list[str]:
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
    scores = [_HEADINGS[key].text(mean[key]) if key in mean else "–" for key in SCORES]
    return [
        f"| {name} | {learned.first:.0f} | {learned.second:.0f} | {learned.memory} | {' | '.join(scores)} |"
    ]


def score_head() -> list[str]:
    """Return the head of the table of trainings."""
    titles = [f"{_HEADINGS[key].name} {_HEADINGS[key].arrow}".strip() for key in SCORES]
    return [
        f"| training | Phase I, s | Phase II, s | memory | {' | '.join(titles)} |",
        "| --- | ---: | ---: | --- |" + " ---: |" * len(titles),
    ]


def quality_part(setting: Setting) -> None:
    """Train the demo on the device and on the CPU, from the same seed, and score both where they were
    trained.
    """
    pace = Pace("quality", setting)
    setting.write("quality", score_head())
    for name in dict.fromkeys((setting.device, "cpu")):
        device = resolve_device(name)
        place = f"demo, seed {setting.seed}, on {device.type}"
        learned = learn("demo", place, device, setting, pace)
        if name == setting.device:
            keep(learned, setting.folder / "run")
        setting.write("quality", score_rows(place, learned, device, setting))


def pace_part(setting: Setting) -> None:
    """Begin each stage of `standard` on the device; the table of stages tells how long all of them would
    take.
    """
    device = resolve_device(setting.device)
    learned = learn(
        "standard", f"standard on {device.type}", device, setting, Pace("pace", setting), whole=False
    )
    setting.write("pace", [f"Memory: {learned.memory}."])


def standard_part(setting: Setting) -> None:
    """Train `standard` on the device and score it there."""
    device = resolve_device(setting.device)
    place = f"standard, seed {setting.seed}, on {device.type}"
    learned = learn("standard", place, device, setting, Pace("standard", setting))
    setting.write("standard", [*score_head(), *score_rows(place, learned, device, setting)])
