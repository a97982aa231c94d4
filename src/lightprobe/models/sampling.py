"""Which pixels become light probes: smooth ones more often, for they tell more about the light they mirror."""

import torch
from torch import Tensor

from lightprobe.core.device import generator, to_device

_LEAST_WEIGHT = 1e-3  # keeps perfectly rough pixels in the draw: a wholly matte object has probes, too


def sample_pixels(roughness: Tensor, count: int, *, seed: int, stream: str, step: int = 0) -> Tensor:
    """Return `count` distinct pixel indices (count,) int64 drawn with probability proportional to 1 - r.

    roughness: (N,) in [0, 1]. stream, step: name of the random stream of a run's `seed`, and the number
    within it. All N indices are returned when `count` >= N.

    The paper (section 3.2.3) asks for more smooth pixels than rough ones; its |r - 1| - 1 is read as |r - 1|,
    as no probability is negative. Adding Gumbel noise to the log weights and taking the largest draws one
    pixel after the other without replacement.
    """
    if count >= len(roughness):
        return torch.arange(len(roughness), device=roughness.device)
    weight = (1 - roughness.detach()).clamp_min(_LEAST_WEIGHT).double()
    uniform = torch.rand(len(weight), dtype=torch.float64, generator=generator(seed, stream, step))
    gumbel = -torch.log(-torch.log(uniform.clamp(1e-300, 1 - 1e-16)))
    return torch.topk(weight.log() + to_device(gumbel, roughness.device), count, sorted=True).indices
