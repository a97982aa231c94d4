"""Turn one photo of a known object into the HDR environment map around it.

    import lightprobe
    lightprobe.train("photos/cup", "runs/cup")  # as `lightprobe train photos/cup -o runs/cup` does
    predictor = lightprobe.Predictor.load("runs/cup")
    pixels, camera = lightprobe.load_photo("new.jpg", camera="new.json", mask="new_mask.png")
    prediction = predictor.predict(pixels, camera)
    prediction.save("light.exr", confidence="seen.exr")
    image, coverage = lightprobe.relight(predictor.decomposition, prediction.environment, camera)

Names are loaded when first used, so importing this package costs nothing.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lightprobe.cli.progress import Meter
    from lightprobe.distillation import distill
    from lightprobe.evaluation import evaluate, relight
    from lightprobe.localization import Locator, locate
    from lightprobe.prediction import Predictor
    from lightprobe.reconstruction import decompose
    from lightprobe.runs.preparing import prepare_scene as prepare
    from lightprobe.runs.training import train_run as train
    from lightprobe.scene import load_photo, load_scene

__all__ = [
    "Locator",
    "Meter",
    "Predictor",
    "decompose",
    "distill",
    "evaluate",
    "load_photo",
    "load_scene",
    "locate",
    "prepare",
    "relight",
    "train",
]

# name -> its package, and its name there where that is another
_HOME = {
    "Meter": "cli.progress",
    "Locator": "localization",
    "Predictor": "prediction",
    "decompose": "reconstruction",
    "distill": "distillation",
    "evaluate": "evaluation",
    "load_photo": "scene",
    "load_scene": "scene",
    "locate": "localization",
    "prepare": "runs.preparing:prepare_scene",
    "relight": "evaluation",
    "train": "runs.training:train_run",
}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        package, _, there = _HOME[name].partition(":")
        return getattr(importlib.import_module(f"lightprobe.{package}"), there or name)
    raise AttributeError(f"module 'lightprobe' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
