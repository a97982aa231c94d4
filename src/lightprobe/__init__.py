"""Turn one photo of a known object into the HDR environment map around it.

    import lightprobe
    predictor = lightprobe.Predictor.load("runs/cup")  # what `lightprobe train photos/cup -o runs/cup` left
    pixels, camera = lightprobe.load_photo("new.jpg", camera="new.json", mask="new_mask.png")
    prediction = predictor.predict(pixels, camera)
    prediction.save("light.exr", confidence="seen.exr")
    image, coverage = lightprobe.relight(predictor.decomposition, prediction.environment, camera)

Names are loaded when first used, so importing this package costs nothing.
"""

import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from lightprobe.decompose import decompose
    from lightprobe.distill import distill
    from lightprobe.evaluate import evaluate, relight
    from lightprobe.predict import Predictor
    from lightprobe.scene import load_photo, load_scene

__all__ = ["Predictor", "decompose", "distill", "evaluate", "load_photo", "load_scene", "relight"]

_HOME = {"Predictor": "predict", "load_photo": "scene", "load_scene": "scene", "relight": "evaluate"}
_PHASES = ("decompose", "distill", "evaluate")  # packages that share their name with the one thing they do


class _Phase(ModuleType):
    """A package that can be called like the function of its own name."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return getattr(self, self.__name__.rpartition(".")[2])(*args, **kwargs)


class _Lightprobe(ModuleType):
    """This package; the import system hands it every subpackage by setting an attribute."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name in _PHASES and isinstance(value, ModuleType):
            value.__class__ = _Phase
        super().__setattr__(name, value)


def __getattr__(name: str) -> Any:
    if name in _PHASES:
        return importlib.import_module(f"lightprobe.{name}")
    if name in _HOME:
        return getattr(importlib.import_module(f"lightprobe.{_HOME[name]}"), name)
    raise AttributeError(f"module 'lightprobe' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


sys.modules[__name__].__class__ = _Lightprobe
