"""Which pixels become light probes: smooth ones more often, for they tell more about the light they mirror."""

import torch
from torch import Tensor

from lightprobe.core.device import generator, to_device

_LEAST_WEIGHT = 1e-3  # keeps perfectly rough pixels in the draw, so that a wholly matte object still has probes


def sample_pixels(roughness: Tensor, count: int, *, seed: int, stream: str, step: int = 0) -> Tensor:
    """Return `count` distinct pixel indices (count,) int64 drawn with probability proportional to 1 - r.

    The paper (section 3.2.3) states the probability as |r - 1|. Adding Gumbel noise to the log weights and taking the
    largest draws one after the other without replacement. All N indices are returned when `count` >= N.

    Args:
        roughness: (N,) in [0, 1].
        count: number of pixels wanted.
        seed: seed of the run.
        stream: name of the random stream.
        step: number within the stream.
    """
    if count >= len(roughness):
        return torch.arange(len(roughness), device=roughness.device)
    weight = (1 - roughness.detach()).clamp_min(_LEAST_WEIGHT).double()
    uniform = torch.rand(len(weight), dtype=torch.float64, generator=generator(seed, stream, step))
    gumbel = -torch.log(-torch.log(uniform.clamp(1e-300, 1 - 1e-16)))
    return torch.topk(weight.log() + to_device(gumbel, roughness.device), count, sorted=True).indices
