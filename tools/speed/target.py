"""A prediction at 512 x 512 with a light of 6 x 128 x 128 by a run's default method, in a process of its own.

    python tools/speed/target.py RUN SCENE REPEATS      prints JSON: seconds of each part, and memory in GiB

A process tells the most memory it ever had, and except on Linux inherits that number from the one that starts
it; so `measure` is to be called before the caller has grown. Memory is that of the whole process: libraries,
model, asset, photo, prefilter.
"""

import json
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from lightprobe.core.device import resolve_device
from lightprobe.core.errors import ResourceError
from lightprobe.core.memory import peak_memory
from lightprobe.core.run import RunFolder
from lightprobe.models import Decomposition, ProbeModel
from lightprobe.prediction import PredictConfig, Predictor, methods_for
from lightprobe.scene import load_pixels, load_scene
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Photo, Pixels

SIDE, TEXELS = 512, 128
PARTS = ("rasterise", "verdict", "network", "stack", "solve", "confidence", "total")


@dataclass(frozen=True)
class Target:
    """What a prediction of the target's size cost."""

    method: str
    photo: str
    pixels: int  # of the object
    seconds: dict[str, float]  # of the prediction whose total is the median
    memory: float | None  # GiB


def measure(run: Path, scene: Path | None, repeats: int) -> Target:
    """Return the cost of predicting from the first test photo of a finished run, measured in a child process."""
    folder = scene or Path(RunFolder.open(run).scene()["root"])
    command = [sys.executable, str(Path(__file__).resolve()), str(run), str(folder), str(repeats)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise ResourceError(f"The prediction from {run} failed; what went wrong stands above.")
    return Target(**json.loads(done.stdout))


def target_rows(target: Target | None) -> list[str]:
    """Return the table of the target case, or what is needed for it."""
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
    pixels, camera = load_pixels(photo)
    return pixels.resized(side, side), camera.resized(side, side)


def predict(run: RunFolder, scene: Path, repeats: int) -> Target:
    """Return the cost of a prediction in this process, after one that warms up."""
    device = resolve_device("cpu")
    model, photo = ProbeModel.load(run.model_folder), load_scene(scene).test[0]
    predictor = Predictor(
        Decomposition.load(run, device), model, device, config=PredictConfig(light_resolution=TEXELS)
    )
    pixels, camera = resample(photo, SIDE)
    predictor.predict(pixels, camera)
    every = [predictor.predict(pixels, camera).seconds for _ in range(repeats)]
    usual = sorted(every, key=lambda parts: parts["total"])[repeats // 2]
    covered = int((pixels.alpha > 0.5).sum())
    return Target(methods_for(model)[0].value, photo.name, covered, usual, peak_memory())


if __name__ == "__main__":
    found = predict(RunFolder.open(Path(sys.argv[1])), Path(sys.argv[2]), int(sys.argv[3]))
    print(json.dumps(found.__dict__))
