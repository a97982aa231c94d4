"""A predicted light against the true one: by solid angle, three spheres, bins of confidence and a relit
object.

The relit object is a stand-in: the true object where the scene brings it, else the reconstructed one, seen
from up to five of the test cameras, never the photo's own. Both images come from our renderer, so only the
light differs. This scores the *predictor*; how well the *asset* relights is scored against the scene's
renders under novel lights (`truth.relight_scores`).
"""

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from lightprobe.evaluation import metrics
from lightprobe.evaluation.three_spheres import HEIGHT, Disc, ThreeSpheres, reduced, sphere_scores
from lightprobe.imaging import read_hdr, srgb_encode
from lightprobe.light import cubemap, equirect, prefilter
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.prediction import Prediction
from lightprobe.render.asset import rasterize_asset
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Scene

BINS = 5  # of confidence, of equal solid angle
Scores = dict[str, float]
_VIEWS, _SIDE = 5, 128  # cameras, and pixels of their pictures


@dataclass(frozen=True)
class TrueLight:
    """The true light of one photo, read once for all methods."""

    environment: Environment  # of the resolution of the predictions
    height: int  # rows of the maps that light the spheres
    spheres: ThreeSpheres
    discs: dict[str, Disc]  # the three spheres under it

    @staticmethod
    def load(
        path: Path, camera: Camera, center: np.ndarray, resolution: int, device: torch.device
    ) -> "TrueLight":
        """Read an environment file and light spheres at `center` (3,), seen by an input-frame camera."""
        environment = Environment.load(path, device, resolution)
        light = reduced(torch.from_numpy(np.ascontiguousarray(read_hdr(path)[..., :3], np.float32)), HEIGHT)
        return TrueLight._shown(environment, light, camera, center)

    @staticmethod
    def of(environment: Environment, camera: Camera, center: np.ndarray) -> "TrueLight":
        """Light spheres at `center` (3,) by a cubemap of the resolution of the predictions."""
        light = equirect.from_cubemap(environment.texels.cpu(), HEIGHT)
        return TrueLight._shown(environment, light, camera, center)

    @staticmethod
    def _shown(environment: Environment, light: Tensor, camera: Camera, center: np.ndarray) -> "TrueLight":
        up = torch.from_numpy(camera.camera_to_world[:3, 1].copy())
        spheres = ThreeSpheres(torch.from_numpy(camera.position - center), up)
        return TrueLight(environment, len(light), spheres, spheres.light(light))

    def scores(self, prediction: Prediction) -> Scores:
        """Return errors of ln radiance (raw, by confidence, after one factor or three) and of spheres.

        Errors over the brightest percent of the true light are raw and after the whole map's one factor.
        """
        difference = metrics.log_difference(prediction.environment.texels, self.environment.texels)
        bright = metrics.brightest(self.environment.texels)
        shown = equirect.from_cubemap(prediction.environment.texels.cpu(), self.height)
        return {
            "light_log_rmse": metrics.environment_log_rmse(difference),
            "light_log_rmse_confident": metrics.environment_log_rmse(difference, prediction.confidence),
            "light_log_rmse_scaled": metrics.environment_log_rmse(metrics.aligned(difference)),
            "light_log_rmse_channels": metrics.environment_log_rmse(
                metrics.aligned(difference, per_channel=True)
            ),
            "light_log_rmse_bright": metrics.environment_log_rmse(difference, bright),
            "light_log_rmse_bright_scaled": metrics.environment_log_rmse(metrics.aligned(difference), bright),
            **sphere_scores(self.spheres.light(shown), self.discs),
        }


class ConfidenceBins:
    """Gathers one method's errors by confidence: five bins of equal solid angle over all photos together."""

    def __init__(self) -> None:
        # (T, 4) each: confidence, solid angle, squared error raw and after one factor
        self._rows: list[Tensor] = []

    def add(self, prediction: Prediction, true: Environment) -> None:
        """Add a map with its truth."""
        difference = metrics.log_difference(prediction.environment.texels, true.texels)
        angle = cubemap.solid_angles(true.resolution)
        errors = [d.square().mean(-1).cpu() for d in (difference, metrics.aligned(difference))]
        self._rows.append(torch.stack([prediction.confidence.cpu(), angle, *errors], -1).reshape(-1, 4))

    def result(self) -> list[Scores]:
        """Return the bins, the least confident first: mean confidence and log-RMSE, raw and scaled."""
        if not self._rows:
            return []
        rows = torch.cat(self._rows).double()
        rows = rows[torch.argsort(rows[:, 0], stable=True)]
        share = (rows[:, 1].cumsum(0) - rows[:, 1] / 2) / rows[:, 1].sum()
        bins = []
        for part in range(BINS):
            chosen = rows[(share * BINS).long() == part]
            mean = (chosen * chosen[:, 1:2]).sum(0) / chosen[:, 1].sum()
            errors = {"log_rmse": float(mean[2].sqrt()), "log_rmse_scaled": float(mean[3].sqrt())}
            bins.append({"confidence": float(mean[0]), **errors})
        return bins


def falls(bins: list[Scores], name: str = "log_rmse_scaled") -> bool:
    """Return whether the error falls from each bin to the next more confident one."""
    errors = [scores[name] for scores in bins]
    return all(a > b for a, b in itertools.pairwise(errors))


@dataclass(frozen=True)
class StandIn:
    """An object seen from several test photos' cameras."""

    views: dict[str, GBuffer]  # by photo

    @staticmethod
    def of(decomposition: Decomposition, scene: Scene, device: torch.device) -> "StandIn":
        """Rasterise the object for five evenly chosen test cameras at 128 pixels."""
        count = min(_VIEWS, len(scene.test))
        asset, views = decomposition.asset.to(device), {}
        for photo in (scene.test[i * len(scene.test) // count] for i in range(count)):
            camera = photo.camera.normalised(decomposition.similarity).within(_SIDE)
            views[photo.name] = rasterize_asset(asset, camera, device)
        return StandIn(views)

    @torch.no_grad()
    def scores(self, name: str, environment: Environment, true: Environment) -> dict[str, float]:
        """Return the PSNR over the object's pixels of sRGB images under two lights, the second the truth.

        `name` is the photo that the light was predicted from. Raw, and after one linear factor per channel.
        """
        views = [view for photo, view in self.views.items() if photo != name and len(view.pixel)]
        if not views:
            return {}
        operator = prefilter.cached(environment.resolution, environment.device)
        levels = [operator.apply(light.texels) for light in (environment, true)]
        mine, theirs = (torch.cat([shade(view, operator, stack) for view in views]) for stack in levels)
        scaled = mine * metrics.channel_scale(mine, theirs)
        shown = srgb_encode(theirs.clamp(0, 1))
        return {
            "relit_psnr": metrics.psnr(srgb_encode(mine.clamp(0, 1)), shown),
            "relit_psnr_scaled": metrics.psnr(srgb_encode(scaled.clamp(0, 1)), shown),
        }
