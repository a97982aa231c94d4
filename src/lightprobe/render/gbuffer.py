"""The G-buffer: what the camera sees of the object, one row per covered pixel."""

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class GBuffer:
    """Surface attributes of the P covered pixels of one view, in the normalised frame.

    Floating-point tensors are float32 and may carry gradients. Rows are in ascending order of `pixel`.
    """

    height: int
    width: int
    pixel: Tensor  # (P,) int64, flat row-major pixel index
    face: Tensor  # (P,) int64, visible triangle
    position: Tensor  # (P, 3)
    normal: Tensor  # (P, 3) unit shading normal
    view: Tensor  # (P, 3) unit, from the surface to the camera
    base_color: Tensor  # (P, 3) linear
    roughness: Tensor  # (P,) perceptual; alpha = roughness^2
    metallic: Tensor  # (P,)
