"""How well a predicted light relights: a stand-in object under the predicted and under the true light.

The stand-in is the true object where the scene brings it, else the reconstructed one, seen from up to five of
the test cameras, never the photo's own. Both images come from our renderer, so only the light differs. This
scores the *predictor*; how well the *asset* relights is scored against the scene's renders under novel lights
(`truth.relight_scores`).
"""

from dataclasses import dataclass

import torch

from lightprobe.evaluation.metrics import channel_scale, psnr
from lightprobe.imaging import srgb_encode
from lightprobe.light import prefilter
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.render.asset import rasterize_asset
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade
from lightprobe.scene.photo import Scene

_VIEWS, _SIDE = 5, 128  # cameras, and pixels of their pictures


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
        scaled = mine * channel_scale(mine, theirs)
        shown = srgb_encode(theirs.clamp(0, 1))
        return {
            "relit_psnr": psnr(srgb_encode(mine.clamp(0, 1)), shown),
            "relit_psnr_scaled": psnr(srgb_encode(scaled.clamp(0, 1)), shown),
        }
