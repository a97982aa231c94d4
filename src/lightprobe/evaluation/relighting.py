"""The object under a given light, for any camera of the user's."""

from torch import Tensor

from lightprobe.light import prefilter
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.render.picture import Picture
from lightprobe.scene.camera import Camera


def relight(decomposition: Decomposition, environment: Environment, camera: Camera) -> tuple[Tensor, Tensor]:
    """Return the object under `environment` seen by an input-frame camera.

    The image (H, W, 3) is linear and premultiplied, the coverage (H, W) in [0, 1]; both on the environment's device.
    """
    asset = decomposition.asset.to(environment.device)
    operator = prefilter.cached(environment.resolution, environment.device)
    view = camera.normalised(decomposition.similarity)
    return Picture.of(asset, view, operator, environment.device).render(environment.texels)
