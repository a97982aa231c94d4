"""The G-buffer: what the camera sees of the object, one row per covered pixel."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from lightprobe.render.visibility import PointVisibility, VertexVisibility

_PER_PIXEL = ("pixel", "face", "position", "normal", "view", "base_color", "roughness", "metallic")


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
    support: Tensor | None = None  # (4,) as `View.support`

    def select(self, rows: Tensor) -> "GBuffer":
        """Return the pixels at `rows` (K,) int64."""
        visibility = None if self.visibility is None else self.visibility.select(rows)
        chosen = {name: getattr(self, name)[rows] for name in _PER_PIXEL}
        return replace(self, **chosen, visibility=visibility)

    def tensors(self) -> tuple[Tensor, ...]:
        """Return all tensors, (P, ...) each, and last the four of the visibility, of which two are (V, ...)."""
        own = tuple(getattr(self, name) for name in _PER_PIXEL)
        if self.visibility is None:
            return own
        seen = self.visibility
        return (*own, seen.vertices.unoccluded, seen.vertices.occluder_color, seen.index, seen.weight)

    def holding(self, tensors: Sequence[Tensor]) -> "GBuffer":
        """Return a G-buffer that holds `tensors` (P, ...), in the order of `tensors()`."""
        seen = tensors[len(_PER_PIXEL) :]
        visibility = PointVisibility(VertexVisibility(*seen[:2]), *seen[2:]) if seen else None
        own = dict(zip(_PER_PIXEL, tensors, strict=False))
        return GBuffer(self.height, self.width, **own, visibility=visibility, support=self.support)

    @staticmethod
    def one_below_the_other(parts: Sequence["GBuffer"]) -> "GBuffer":
        """Return several views of one object as one picture, each below the one before."""
        width, top, pixels = max(part.width for part in parts), 0, []
        for part in parts:
            row, column = torch.div(part.pixel, part.width, rounding_mode="floor"), part.pixel % part.width
            pixels.append((top + row) * width + column)
            top += part.height
        rest = {name: torch.cat([getattr(part, name) for part in parts]) for name in _PER_PIXEL[1:]}
        seen = [part.visibility for part in parts if part.visibility is not None]
        visibility = PointVisibility.of_all(seen) if seen else None
        return GBuffer(top, width, torch.cat(pixels), **rest, visibility=visibility, support=parts[0].support)
