"""The object under a given light, for any camera of the user's."""

from torch import Tensor

from lightprobe.light import prefilter
from lightprobe.light.files import load_environment
from lightprobe.models import Decomposition
from lightprobe.render.picture import Picture
from lightprobe.scene.camera import Camera

__all__ = ["load_environment", "relight"]


def relight(decomposition: Decomposition, environment: Tensor, camera: Camera) -> tuple[Tensor, Tensor]:
    """Return the object under `environment` (6, R, R, 3) seen by an input-frame camera.

    The image (H, W, 3) is linear and premultiplied, the coverage (H, W) in [0, 1]; both on the environment's device.
    """
    asset = decomposition.asset.to(environment.device)
    operator = prefilter.cached(environment.shape[1], environment.device)
    view = camera.normalised(decomposition.similarity)
    return Picture.of(asset, view, operator, environment.device).render(environment)
