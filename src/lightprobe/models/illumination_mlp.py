"""The illumination MLP: the colour of the light that a pixel, as a probe, reports (Equation 3).

Notation: x = c / s, the pixel's colour relative to the photo's light level s; f the pixel's white-furnace
colour; l = 2 (n.w_o) n - w_o the mirror direction. With e = 0.02 against division by black,

    c_p = s (x + e)/(f + e) exp(8 tanh(MLP(log(x + e), log((x + e)/(f + e)), k_d, k_s, r, n.w_o, enc(n, w_o,
    l)) / 8))

The first factor is the light the pixel would have seen were it the same from everywhere, so that an untrained
network already predicts something sane; the network learns the rest in log radiance. Scaling a photo scales s
and c alike, and with them c_p, exactly.

The paper names the inputs alone, c_p = MLP(c, k_d, k_s, n, r, w_o): `NetworkForm.PLAIN`, with a softplus at
the end.
"""

import itertools
import math

import torch
from torch import Tensor, nn

from lightprobe.core.config.distillation import NetworkForm
from lightprobe.core.device import generator
from lightprobe.models.probe_pixels import ProbePixels

_BLACK = 0.02  # relative to the light level, keeps ratios of dark pixels finite
_OCTAVES = 3  # of the Fourier encoding of directions; the plain network has none
_LOG_RANGE = 8.0  # e-folds that the answer may be off its start
_PLAIN_INPUTS = 16  # of the paper: colour, base colour, specular, normal, view (3 each), roughness


class IlluminationMlp(nn.Module):
    """Maps N pixels to N probe colours >= 0, linear and unbounded above."""

    def __init__(self, width: int, depth: int, seed: int = 0, form: NetworkForm = NetworkForm.RELATIVE):
        super().__init__()
        self.form = form
        inputs = 14 + 9 * (1 + 2 * _OCTAVES) if form is NetworkForm.RELATIVE else _PLAIN_INPUTS
        sizes = [inputs] + [width] * depth + [3]
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in itertools.pairwise(sizes))
        self._initialise(seed)

    def forward(self, pixels: ProbePixels, light_level: Tensor) -> Tensor:
        """Return probe colours (N, 3) of the pixels of a photo with `light_level` ()."""
        if self.form is NetworkForm.PLAIN:
            surface = [pixels.color, pixels.base_color, pixels.specular, pixels.normal]
            inputs = torch.cat([*surface, pixels.roughness[:, None], pixels.view], -1)
            return torch.nn.functional.softplus(self._answer(inputs))
        relative = pixels.color / light_level + _BLACK
        start = relative / (pixels.furnace + _BLACK)
        answer = self._answer(self._encode(pixels, relative.log(), start.log()))
        correction = _LOG_RANGE * torch.tanh(answer / _LOG_RANGE)
        return light_level * start * correction.exp()

    def _answer(self, hidden: Tensor) -> Tensor:
        """Return the last layer's output (N, 3) for inputs (N, I)."""
        *inner, last = self._linear()
        for layer in inner:
            hidden = torch.relu(layer(hidden))
        answer: Tensor = last(hidden)
        return answer.float()  # in mixed precision, too

    def _encode(self, pixels: ProbePixels, log_color: Tensor, log_start: Tensor) -> Tensor:
        cosine = (pixels.normal * pixels.view).sum(-1, keepdim=True)
        mirror = 2 * cosine * pixels.normal - pixels.view
        directions = torch.cat([pixels.normal, pixels.view, mirror], -1)
        waves = [directions]
        for octave in range(_OCTAVES):
            angle = directions * (0.5 * math.pi * 2**octave)
            waves += [angle.sin(), angle.cos()]
        plain = [log_color, log_start, pixels.base_color, pixels.specular, pixels.roughness[:, None], cosine]
        return torch.cat(plain + waves, -1)

    def _linear(self) -> list[nn.Linear]:
        return [layer for layer in self.layers if isinstance(layer, nn.Linear)]

    def _initialise(self, seed: int) -> None:
        """He initialisation from our own stream; the last layer, and so the correction, starts small."""
        random = generator(seed, "illumination-mlp")
        for layer in self._linear():
            bound = math.sqrt(6 / layer.in_features)
            with torch.no_grad():
                layer.weight.uniform_(-bound, bound, generator=random)
                layer.bias.zero_()
        with torch.no_grad():
            self._linear()[-1].weight.mul_(0.05)
