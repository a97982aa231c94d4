"""nvdiffrec's losses of an image and of its colours' roughness (Munkberg et al. 2022), which the paper says
it adopts.

Means run over the whole frame, so that all of these weigh less for an object that fills less of it.
"""

from torch import Tensor

from lightprobe.core.config import ImageLoss
from lightprobe.light.photometry import tone_map

_RAMP = 500  # steps over which smoothness comes in


def frame_loss(
    render: Tensor,
    cover: Tensor,
    photo: Tensor,
    alpha: Tensor,
    background: Tensor,
    weight: float,
    kind: ImageLoss,
) -> Tensor:
    """Return the loss of colours within the photo's mask plus `weight` times the mean squared coverage error.

    render, photo (N, 3) linear, premultiplied, shown over `background` (3,); cover, alpha (N,).
    """
    ours = (render + (1 - cover)[:, None] * background) * alpha[:, None]
    theirs = (photo + (1 - alpha)[:, None] * background) * alpha[:, None]
    if kind is ImageLoss.L2:
        color = (ours - theirs).square().mean()
    else:
        color = (tone_map(ours) - tone_map(theirs)).abs().mean()
    return color + weight * (cover - alpha).square().mean()


def color_change(here: Tensor, there: Tensor, covered: float, step: int) -> Tensor:
    """Return the mean difference of base colours (K, 3) at visible points and beside them, at `step` of a
    pass.

    covered: the share of the frame that shows the surface.
    """
    return min(1.0, step / _RAMP) * covered * (here - there).abs().mean()
