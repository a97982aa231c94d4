"""The G-buffer: what the camera sees of the object, one row per covered pixel."""

from dataclasses import dataclass

from torch import Tensor

from lightprobe.render.visibility import PointVisibility


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
    visibility: PointVisibility | None = None  # what blocks directions at each pixel; None: nothing

    def select(self, rows: Tensor) -> "GBuffer":
        """Return the pixels at `rows` (K,) int64."""
        visibility = None if self.visibility is None else self.visibility.select(rows)
        return GBuffer(
            self.height, self.width, self.pixel[rows], self.face[rows], self.position[rows], self.normal[rows],
            self.view[rows], self.base_color[rows], self.roughness[rows], self.metallic[rows], visibility,
        )  # fmt: skip
