"""Predictions by the demo's run, on the device and on the CPU: how long, how many a second, and how far
apart.
"""

import statistics
import time
from pathlib import Path

import torch

from benchmarks.gpu.parts import Setting
from benchmarks.gpu.training import scene
from benchmarks.speed.stages import PARTS, SIDE, TEXELS, resample
from lightprobe.core.device import resolve_device
from lightprobe.core.errors import ConfigError
from lightprobe.prediction import Method, PredictConfig, Prediction, Predictor, methods_for
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Pixels

Photo = tuple[Pixels, Camera]


def prediction_part(setting: Setting) -> None:
    """Write latency and rate at two sizes, and how far the device's maps are from the CPU's."""
    run = setting.folder / "run"
    if not run.is_dir():
        raise ConfigError(
            "There is no run to predict with: the part that trains the demo did not get that far."
        )
    parts = [f"{part}, ms" for part in PARTS]
    head = ("method", "device", "size", *parts, "photos a second", "off the CPU's map")
    setting.write(
        "prediction", [f"| {' | '.join(head)} |", "| --- | --- | --- |" + " ---: |" * (len(head) - 3)]
    )
    sizes = ((64, 16),) if setting.brief else ((256, 32), (SIDE, TEXELS))
    for side, texels in sizes:
        photos = [resample(photo, side) for photo in scene(brief=setting.brief).test]
        for method in (None, Method.PROBE_MLP):
            expected: list[Prediction] = []
            for name in dict.fromkeys(("cpu", setting.device)):
                found, row = _row(run, name, method, photos, texels)
                expected = expected or found
                setting.write("prediction", [f"{row} {apart(found, expected):.1e} |"])


def _row(
    run: Path, name: str, method: Method | None, photos: list[Photo], texels: int
) -> tuple[list[Prediction], str]:
    """Return the predictions of all photos on a device, and the beginning of their row."""
    device = resolve_device(name)
    loaded = Predictor.load(run, device)
    predictor = Predictor(
        loaded.decomposition, loaded.model, device, config=PredictConfig(light_resolution=texels)
    )
    method = method or methods_for(predictor.model)[0]
    for _ in range(3 if device.type == "cuda" else 1):  # kernels are compiled, graphs recorded
        predictor.predict(*photos[0], method)
    begin = time.perf_counter()
    found = [predictor.predict(pixels, camera, method) for pixels, camera in photos]
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    rate = len(photos) / (time.perf_counter() - begin)
    parts = [1000 * statistics.median(each.seconds[part] for each in found) for part in PARTS]
    side = photos[0][1].width
    cells = " | ".join(f"{value:.1f}" for value in parts)
    return found, f"| {method.value} | {device.type} | {side}² onto 6 x {texels}² | {cells} | {rate:.1f} |"


def apart(found: list[Prediction], expected: list[Prediction]) -> float:
    """Return the largest relative L2 difference between maps of the same photos."""
    pairs = (
        (one.environment.texels.cpu(), other.environment.texels.cpu())
        for one, other in zip(found, expected, strict=True)
    )
    return max(float((one - other).norm() / other.norm()) for one, other in pairs)
