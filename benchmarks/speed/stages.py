"""The stages of a prediction: how their cost grows with pixels, texels and triangles, and one of full size.

    python -m benchmarks.speed.stages RUN SCENE REPEATS      prints JSON: seconds of each part, and memory in GiB

A process tells the most memory it ever had, and except on Linux inherits that number from the one that starts it; so
`measure_target` is to be called before the caller has grown. Memory is that of the whole process: libraries, model,
asset, photo, prefilter.
"""

import functools
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch

from benchmarks.speed.ball import COVERED, CPU, ball, camera, light, photograph
from benchmarks.speed.timing import growth_rows, seconds
from lightprobe.core.errors import ResourceError
from lightprobe.core.memory import peak_memory
from lightprobe.core.run import RunFolder
from lightprobe.light import prefilter
from lightprobe.models import Decomposition, ProbeModel
from lightprobe.prediction import Method, PredictConfig, Predictor, methods_for
from lightprobe.prediction.confidence import confidence
from lightprobe.prediction.observation import observe
from lightprobe.prediction.prior import constant_light
from lightprobe.prediction.solve import solve_environment
from lightprobe.render.asset import Asset, rasterize_asset
from lightprobe.render.picture import Picture
from lightprobe.render.transport import Transport
from lightprobe.scene import load_pixels, load_scene
from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.photo import Photo, Pixels

SIDE, TEXELS = 512, 128
PARTS = ("rasterise", "verdict", "network", "stack", "solve", "confidence", "total")


@torch.no_grad()
def stages(asset: Asset, side: int, texels: int, repeats: int) -> dict[str, float]:
    """Return the seconds of every stage of a prediction, and of the whole."""
    view = camera(side)
    env, operator = light(texels), prefilter.cached(texels, CPU)
    photo = photograph(asset, view, env)
    decomposition = Decomposition(asset, {}, Similarity(np.zeros(3), 1.0))
    predictor = Predictor(decomposition, config=PredictConfig(light_resolution=texels))
    observation = observe(asset, photo, view, CPU, predictor.config.max_pixels)
    prior = constant_light(observation, texels)
    transport = Transport(observation.gbuffer, operator, observation.rows)
    radiance = transport.apply(env)
    picture = Picture.of(asset, view, operator, CPU)
    works: dict[str, Callable[[], object]] = {
        "rasterise": lambda: rasterize_asset(asset, view, CPU),
        "make a picture ready": lambda: Picture.of(asset, view, operator, CPU),
        "light it": lambda: picture.render(env),
        "prefilter": lambda: operator.apply(env),
        "build transport": lambda: Transport(observation.gbuffer, operator, observation.rows),
        "apply transport": lambda: transport.apply(env),
        "its adjoint": lambda: transport.adjoint(radiance),
        "solve": lambda: solve_environment(observation, prior, predictor.solve_config, 0),
        "confidence": lambda: confidence(observation, env, fitted=True, seed=0),
        "prediction (solve)": lambda: predictor.predict(photo, view, Method.SOLVE),
    }
    return {name: seconds(work, repeats) for name, work in works.items()}


def stage_tables(repeats: int, *, quick: bool) -> list[str]:
    """Return the three tables of growth; where a size is not varied it is the usual one."""
    side, texels, levels = (128, 16, 3) if quick else (320, 32, 5)
    sides = (64, 128) if quick else (128, 181, 256, 362, 512)
    lights = (8, 16) if quick else (16, 32, 64)
    balls = (2, 3) if quick else (3, 4, 5, 6)
    made = functools.cache(ball)
    return [
        f"Milliseconds; a ball of {20 * 4**levels:,} triangles, a photo of {side} x {side} and a light of",
        f"6 x {texels} x {texels} where not varied. A prediction reduces photos to 65 536 object pixels and solves",
        "from a fixed number of them, so its cost stops growing.",
        "",
        *growth_rows(
            "object pixels", {COVERED * s**2: stages(made(levels), s, texels, repeats) for s in sides}
        ),
        "",
        *growth_rows(
            "texels of the light", {6.0 * r * r: stages(made(levels), side, r, repeats) for r in lights}
        ),
        "",
        *growth_rows("triangles", {20.0 * 4**n: stages(made(n), side, texels, repeats) for n in balls}),
    ]


@dataclass(frozen=True)
class Target:
    """What a prediction of full size cost."""

    method: str
    photo: str
    pixels: int  # of the object
    seconds: dict[str, float]  # of the prediction whose total is the median
    memory: float | None  # GiB


def measure_target(run: Path, scene: Path | None, repeats: int) -> Target:
    """Return the cost of predicting from the first test photo of a finished run, measured in a child process."""
    folder = scene or Path(RunFolder.open(run).scene()["root"])
    command = [sys.executable, "-m", "benchmarks.speed.stages", str(run), str(folder), str(repeats)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise ResourceError(f"The prediction from {run} failed; what went wrong stands above.")
    return Target(**json.loads(done.stdout))


def target_rows(target: Target | None) -> list[str]:
    """Return the table of a prediction of full size, or what is needed for it."""
    if target is None:
        return [
            f"Prediction at {SIDE} x {SIDE}, 6 x {TEXELS}²: not measured; it needs a finished run (`--run RUN`)."
        ]
    cells = " | ".join(f"{1000 * target.seconds[part]:.0f}" for part in PARTS)
    memory = "–" if target.memory is None else f"{target.memory:.2f} GiB"
    return [
        f"Prediction at {SIDE} x {SIDE} onto 6 x {TEXELS}², assets loaded, ms; memory of the whole process:",
        "",
        f"| method | object pixels | {' | '.join(PARTS)} | peak memory |",
        "| --- | ---: |" + " ---: |" * (len(PARTS) + 1),
        f"| {target.method} on photo {target.photo} | {target.pixels:,} | {cells} | {memory} |",
    ]


def resample(photo: Photo, side: int) -> tuple[Pixels, Camera]:
    """Return a photo with its camera as side x side pixels, averaged or magnified as premultiplied light."""
    pixels, view = load_pixels(photo)
    return pixels.resized(side, side), view.resized(side, side)


def predict(run: RunFolder, scene: Path, repeats: int) -> Target:
    """Return the cost of a prediction in this process, after one that warms up."""
    model, photo = ProbeModel.load(run.model_folder), load_scene(scene).test[0]
    config = PredictConfig(light_resolution=TEXELS)
    predictor = Predictor(Decomposition.load(run, CPU), model, CPU, config=config)
    pixels, view = resample(photo, SIDE)
    predictor.predict(pixels, view)
    every = [predictor.predict(pixels, view).seconds for _ in range(repeats)]
    usual = sorted(every, key=lambda parts: parts["total"])[repeats // 2]
    covered = int((pixels.alpha > 0.5).sum())
    return Target(methods_for(model)[0].value, photo.name, covered, usual, peak_memory())


if __name__ == "__main__":
    print(json.dumps(asdict(predict(RunFolder.open(Path(sys.argv[1])), Path(sys.argv[2]), int(sys.argv[3])))))
