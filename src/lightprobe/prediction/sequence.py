"""Maps of a video's frames, freed from flicker.

Each frame's map errs in its own way, and played one after the other they flicker. The light itself moves
slowly or, at a switch, at once. So ln radiance is averaged over neighbouring frames, each direction weighted
by its confidence; and a frame counts the less, the more its map differs from the frame's in question,
measured by how much neighbours usually differ (a bilateral filter; Tomasi and Manduchi, ICCV 1998).
"""

from itertools import pairwise

import torch
from torch import Tensor

from lightprobe.light import cubemap

_FRAMES = 2.0  # standard deviation of the average, in predicted frames
_REACH = 6  # frames to each side that count at all: three deviations
_LIKENESS = 2.0  # difference that makes a frame count e^-1/2, in usual differences of neighbours
_FLOOR = 0.01  # of the mean radiance: darker is all alike


def steadied(lights: Tensor, confidences: Tensor) -> Tensor:
    """Return the maps (N, 6, R, R, 3) of consecutive frames without flicker; confidences (N, 6, R, R)."""
    logs, floor, angle = _logs(lights)
    usual = torch.stack([_difference(a, b, angle) for a, b in pairwise(logs)] or [angle.sum() * 0])
    spread = _LIKENESS * usual.median().clamp_min(1e-6)
    found = []
    for number in range(len(logs)):
        first, last = max(0, number - _REACH), min(len(logs), number + _REACH + 1)
        near = torch.arange(first, last, device=lights.device)
        apart = torch.stack([_difference(logs[number], logs[other], angle) for other in near])
        weight = torch.exp(-0.5 * (((near - number) / _FRAMES) ** 2 + (apart / spread) ** 2))
        share = weight[:, None, None, None] * confidences[near]
        mean = (share[..., None] * logs[near]).sum(0) / share.sum(0).clamp_min(1e-12)[..., None]
        found.append((mean.exp() - floor).clamp(min=0))
    return torch.stack(found)


def flicker(lights: Tensor) -> float:
    """Return the root mean square change of ln radiance from each map (N, 6, R, R, 3) to the next."""
    logs, _, angle = _logs(lights)
    changes = [_difference(a, b, angle).square() for a, b in pairwise(logs)]
    return float(torch.stack(changes).mean().sqrt()) if changes else 0.0


def _logs(lights: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Return ln of maps (N, 6, R, R, 3) above a floor, the floor (), and texels' solid angles (6, R, R)."""
    floor = _FLOOR * torch.stack([cubemap.sphere_mean(light).mean() for light in lights]).mean()
    return (lights + floor).log(), floor, cubemap.solid_angles(lights.shape[2], lights.device)


def _difference(first: Tensor, second: Tensor, angle: Tensor) -> Tensor:
    """Return the root mean square difference () of two maps (6, R, R, 3) by solid angle."""
    return (((first - second).square().mean(-1) * angle).sum() / angle.sum()).sqrt()
