"""Absolute brightness of a run: the factor that light and albedo share and photos cannot tell apart.

Light times c and base colour over c look alike, so each run has a light/albedo scale of its own. A calibration is a
factor per channel, g: the run's light times g, and its base colour over g, are the true ones. The run's files stay
in its own scale; g is applied where a decomposition is loaded, and where a prediction ends.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from lightprobe.core.files import write_json
from lightprobe.core.stored import damaged, read_object
from lightprobe.render.asset import Asset
from lightprobe.render.visibility import VertexVisibility

_REMEDY = "remove it with: lightprobe calibrate RUN --reset"
_LEAST, _MOST = 1 / 64, 64.0  # no run is off by more


@dataclass(frozen=True)
class Calibration:
    """The factor, and where it comes from."""

    factor: tuple[float, float, float]  # of light, linear RGB
    source: str  # one phrase for people

    def to_json(self) -> dict[str, Any]:
        """Return a JSON value."""
        return {"light_factor_rgb": list(self.factor), "source": self.source}

    def save(self, path: Path) -> None:
        """Write the calibration as JSON, atomically."""
        write_json(path, self.to_json())

    @staticmethod
    def load(path: Path) -> "Calibration | None":
        """Return the calibration in a file, None without a file; raise `InputError` when it is damaged."""
        if not path.exists():
            return None
        value = read_object(path, _REMEDY)
        factor, source = value.get("light_factor_rgb"), value.get("source")
        if not isinstance(factor, list) or not is_plausible(factor) or not isinstance(source, str):
            words = f"'light_factor_rgb' is not three numbers from {_LEAST:g} to {_MOST:g}"
            raise damaged(path, words, _REMEDY)
        r, g, b = (float(v) for v in factor)
        return Calibration((r, g, b), source)

    def tensor(self, device: torch.device | str = "cpu") -> Tensor:
        """Return the factor as (3,) float32."""
        return torch.tensor(self.factor, device=device)

    def applied(self, asset: Asset) -> Asset:
        """Return an asset of the run's own scale with its base colours over the factor, at most 1."""
        factor, visibility = self.tensor(asset.textures.base_color.device), asset.visibility
        color = (asset.textures.base_color / factor).clamp(max=1)
        if visibility is not None:
            seen = (visibility.occluder_color / factor).clamp(max=1)
            visibility = VertexVisibility(visibility.unoccluded, seen)
        return replace(asset, textures=replace(asset.textures, base_color=color), visibility=visibility)


def is_plausible(factor: Sequence[Any]) -> bool:
    """Return whether values are three numbers that can be a calibration's factor."""
    # Neither NaN nor infinity is between the bounds.
    return len(factor) == 3 and all(type(v) in (int, float) and _LEAST <= v <= _MOST for v in factor)
