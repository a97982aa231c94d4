"""A small U-Net on the sphere: what one photo says about its light in, its light out.

Notation: x (B, C, 6, R, R) maps on cubemaps. Convolutions see across the edges of faces: every face is padded
with the texels on the other side. Faces share their weights; the directions among the inputs tell them apart.
The output is what to add to the log of the stacked light, and starts at nothing.
"""

import math

import torch
from torch import Tensor, nn

from lightprobe.core.device import generator
from lightprobe.light import cubemap
from lightprobe.models.probe_maps import BLACK, CHANNELS, turned

_LOG_RANGE = 8.0  # e-folds that the answer may be off the stacked map


def pad_faces(x: Tensor) -> Tensor:
    """Return maps (B, C, 6, R, R) as faces with a border of their neighbours, (B * 6, C, R + 2, R + 2)."""
    batch, channels, _, side, _ = x.shape
    index = cubemap.padding(side, x.device)
    padded = x.reshape(batch, channels, -1).index_select(2, index)
    return padded.reshape(batch, channels, 6, side + 2, side + 2).transpose(1, 2).flatten(0, 1)


class SphereConv(nn.Module):
    """A 3 x 3 convolution over the whole cubemap, followed by a leaky ReLU."""

    def __init__(self, inputs: int, outputs: int):
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, 3)

    def forward(self, x: Tensor) -> Tensor:
        """Return (B, outputs, 6, R, R) of (B, inputs, 6, R, R)."""
        y = nn.functional.leaky_relu(self.conv(pad_faces(x)), 0.1)
        return y.unflatten(0, (len(x), 6)).transpose(1, 2)


class SphereNet(nn.Module):
    """Predicts log(E / s + e) on 6 x 16 x 16 texels from the maps of `probe_maps`."""

    def __init__(self, width: int, seed: int = 0):
        super().__init__()
        self.fine = nn.ModuleList([SphereConv(CHANNELS, width), SphereConv(width, width)])
        self.middle = nn.ModuleList([SphereConv(width, 2 * width), SphereConv(2 * width, 2 * width)])
        self.coarse = nn.ModuleList([SphereConv(2 * width, 2 * width), SphereConv(2 * width, 2 * width)])
        self.whole = nn.Linear(2 * width, 2 * width)
        self.up_middle = SphereConv(4 * width, 2 * width)
        self.up_fine = SphereConv(3 * width, width)
        self.out = nn.Conv3d(width, 3, 1)
        self._initialise(seed)

    def forward(self, maps: Tensor) -> Tensor:
        """Return log(E / s + e), (B, 3, 6, 16, 16), of maps (B, 19, 6, 16, 16)."""
        fine = _through(self.fine, maps)
        middle = _through(self.middle, _halve(fine))
        coarse = _through(self.coarse, _halve(middle))
        everywhere = self.whole(coarse.mean((2, 3, 4)))[:, :, None, None, None]
        middle = self.up_middle(torch.cat([middle, _double(coarse + everywhere)], 1))
        fine = self.up_fine(torch.cat([fine, _double(middle)], 1))
        return maps[:, :3] + _LOG_RANGE * torch.tanh(self.out(fine).float() / _LOG_RANGE)

    def _initialise(self, seed: int) -> None:
        """He initialisation from our own stream; the output starts at nothing."""
        random = generator(seed, "sphere-net")
        with torch.no_grad():
            for name, parameter in self.named_parameters():
                if name.startswith("out.") or parameter.ndim == 1:
                    parameter.zero_()
                else:
                    bound = math.sqrt(6 / parameter[0].numel())
                    parameter.uniform_(-bound, bound, generator=random)


def mean_over_turns(net: SphereNet, maps: Tensor, turns: int) -> Tensor:
    """Return the network's mean output (1, 3, 6, 16, 16) for maps (1, C, 6, 16, 16) turned `turns` ways,
    turned back.

    Which way the cubemap's faces lie means nothing; what the network makes of it is error, and averages out.
    """
    index, handedness = cubemap.symmetries(maps.shape[-1], maps.device)
    rotations = (handedness > 0).nonzero()[:, 0]
    chosen = rotations[torch.arange(turns, device=maps.device) * len(rotations) // turns]
    seen = net(turned(maps.expand(turns, *maps.shape[1:]), chosen)).flatten(2)
    back = torch.empty_like(seen).scatter_(2, index[chosen][:, None].expand_as(seen), seen)
    return back.mean(0).view(1, 3, *maps.shape[2:])


def light_of(log_light: Tensor, light_level: Tensor) -> Tensor:
    """Return the light (6, R, R, 3) >= 0 of the network's output (3, 6, R, R)."""
    relative = (log_light.exp() - BLACK).clamp(min=0)
    return (light_level * relative).permute(1, 2, 3, 0).contiguous()


def _through(layers: nn.ModuleList, x: Tensor) -> Tensor:
    for layer in layers:
        x = layer(x)
    return x


def _halve(x: Tensor) -> Tensor:
    """Return the means of 2 x 2 texels."""
    side = x.shape[-1] // 2
    return x.reshape(*x.shape[:3], side, 2, side, 2).mean((4, 6))


def _double(x: Tensor) -> Tensor:
    """Return every texel four times; the convolution after it smooths."""
    return x.repeat_interleave(2, 3).repeat_interleave(2, 4)
