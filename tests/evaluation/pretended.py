"""A predictor and a photo that are made up, for tests of what an evaluation makes of any."""

import math
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.errors import InputError
from lightprobe.evaluation.metrics import ImageScores
from lightprobe.light.environment import Environment
from lightprobe.prediction import Method, PhotoVerdict, Prediction
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Photo, Pixels
from tests.shapes import camera_at

GOOD = PhotoVerdict(0.01, 0.95, 0.95, 0.0, 0.2, 0.99, 0.001)


class Lamp:
    """A predictor whose light is as bright as the object's pixels are many, and that takes the time it is
    told.
    """

    def __init__(self, *seconds: float) -> None:
        self.seconds, self.asked = list(seconds), list[tuple[Pixels, Method]]()

    def predict(self, pixels: Pixels, camera: Camera, method: Method, *, refuse: bool) -> Prediction:
        assert not refuse
        self.asked.append((pixels, method))
        share = float((pixels.alpha > 0).sum())
        if share < 3:
            raise InputError("too little")
        light = Environment(torch.full((6, 8, 8, 3), share))
        return Prediction(light, torch.full((6, 8, 8), 0.5), {"total": self.seconds.pop(0)}, GOOD)


class Shown:
    """A photo's view of 4 x 6 pixels that shows a light as its brightness, and scores a picture by it."""

    def __init__(self, rows: int = 4) -> None:
        alpha = np.zeros((4, 6), np.float32)
        alpha[:rows, :4] = 0.75
        self.pixels, self.camera = Pixels.of(np.ones((4, 6, 3), np.float32), alpha), None
        self.photo = Photo("a", camera_at((3.0, 1, 1)), Path("a.png"))

    def shown(self, lights: list[Tensor]) -> list[float]:
        return [float(light.mean()) for light in lights]

    def score(self, image: float) -> ImageScores:
        return ImageScores(image, 0.5, 2 * image, 0.25)

    def psnr(self, image: float, mask: Tensor) -> float:
        """Tell which half was scored, and which one was seen."""
        columns = mask.nonzero()[:, 1].float().mean()
        rows = mask.nonzero()[:, 0].float().mean()
        return 100 * float(rows) + 10 * float(columns) + image / 8 if image < 100 else math.nan
