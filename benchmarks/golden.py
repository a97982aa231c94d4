"""Measure how the scores of a few-step training of the bundled scene spread over seeds; a test holds later
code to it.

    python -m benchmarks golden --seeds 8              # seeds 1 to 8, into tests/runs/golden_demo.json
    python -m benchmarks golden --seeds 12 --more      # those that the file does not have yet

After a change that is meant to move the scores, measure them anew and commit the file with the change. The
test trains once with seed 0, which is in no such file, and expects every score within its prediction
interval: of n seeds with mean m and standard deviation s, another falls outside of m ± t s sqrt(1 + 1/n) with
the probability FALSE_ALARM divided by the number of scores, t being that quantile of Student's distribution
with n - 1 degrees of freedom (Hahn 1969). So all of them together raise a false alarm once in 1 / FALSE_ALARM
changes at most. Training is the same on every machine only within rounding, which grows with the steps as
another seed does: hence the seeds as a yardstick.
"""

import argparse
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean, stdev

from scipy.stats import t as student

import lightprobe
from lightprobe.core.config import DecomposeConfig, DistillConfig
from lightprobe.core.files import read_json, write_json
from lightprobe.evaluation.evaluation import Protocols
from lightprobe.prediction import Method
from lightprobe.scene.photo import Scene

ROOT = Path(__file__).parents[1]
FILE = ROOT / "tests" / "runs" / "golden_demo.json"
FALSE_ALARM = 1e-3
"""Probability that a change which moves nothing fails the test."""

METHODS = (Method.SOLVE, Method.PROBE_MLP, Method.PROBE_NET)
_SCORES = ("psnr", "light_log_rmse_channels", "diffuse_si_rmse")  # of each method
_OBJECT = ("relight_psnr", "base_color_psnr_scaled", "roughness_mae", "normal_degrees", "chamfer")
_DECOMPOSE = DecomposeConfig(
    pass1_iterations=40,
    pass2_iterations=15,
    pass3_iterations=15,
    pass1_side=48,
    pass2_side=48,
    lattice_cells=20,
    hull_voxels=32,
    hash_levels=6,
    hash_finest=64,
    light_resolution=8,
    teacher_resolution=8,
    texture_size=64,
    pass3_texture_size=64,
    light_solve_pixels=512,
    light_solve_iterations=4,
    unwrap_seconds=0.0,
    trial_steps=0,
)
_DISTILL = DistillConfig(
    steps=40, samples=256, light_resolution=8, synthetic_lessons=8, sphere_steps=3, sphere_batch=2
)


def small_scene() -> Scene:
    """Return the bundled scene with every fourth training photo and two test photos."""
    scene = lightprobe.load_scene(ROOT / "src" / "lightprobe" / "assets" / "demo")
    return replace(scene, train=scene.train[::4], test=scene.test[:2])


def scores(scene: Scene, seed: int) -> dict[str, float]:
    """Return the scores of a few-step training with this seed: dB, log-RMSE, degrees, as `evaluate` has them."""
    decomposition = lightprobe.decompose(scene, _DECOMPOSE, seed=seed)
    model = lightprobe.distill(decomposition, scene, _DISTILL, seed=seed)
    result = lightprobe.evaluate(
        decomposition, model, scene, methods=METHODS, protocols=Protocols(unseen=False)
    )
    means = {method: result.mean(method) for method in METHODS}
    found = {f"{method.value} {name}": means[method][name] for method in METHODS for name in _SCORES}
    return found | {name: result.truth[name] for name in _OBJECT}


def intervals(
    measured: Mapping[str, Mapping[str, float]], false_alarm: float = FALSE_ALARM
) -> dict[str, tuple[float, float]]:
    """Return between what two values every score is expected; `measured` has the scores of each seed, by its name.

    Raises `ValueError` for fewer than three seeds, whose spread says nothing.
    """
    runs = list(measured.values())
    if len(runs) < 3:
        raise ValueError("A spread needs three seeds at least.")
    names, found = list(runs[0]), {}
    quantile = float(student.ppf(1 - false_alarm / len(names) / 2, len(runs) - 1))
    for name in names:
        values = [run[name] for run in runs]
        width = quantile * stdev(values) * math.sqrt(1 + 1 / len(values))
        found[name] = (fmean(values) - width, fmean(values) + width)
    return found


def summary(measured: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Return number, mean and standard deviation of every score, of two seeds at least."""
    values = {name: [run[name] for run in measured.values()] for name in next(iter(measured.values()))}
    return {
        name: {"n": len(given), "mean": fmean(given), "sd": stdev(given)} for name, given in values.items()
    }


def main(words: Sequence[str]) -> None:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--more", action="store_true", help="keep the seeds that the file has")
    parser.add_argument("--file", type=Path, default=FILE)
    given = parser.parse_args(words)
    scene = small_scene()
    measured = read_json(given.file)["seeds"] if given.more and given.file.is_file() else {}
    for seed in range(1, given.seeds + 1):
        if str(seed) not in measured:
            began = time.process_time()
            measured[str(seed)] = scores(scene, seed)
            print(f"seed {seed}: {time.process_time() - began:.1f} s of one core", flush=True)
            told = summary(measured) if len(measured) > 1 else {}
            write_json(given.file, {"scores": told, "seeds": measured})
