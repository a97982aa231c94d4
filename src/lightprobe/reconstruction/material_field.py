"""The first pass's material as a function of position: a multiresolution hash grid read by a small MLP, whose
base colours share one factor, and what the material costs.

Output channels, in the order of `geometry.textures`: base colour 3 (linear), roughness, metallic, normal
offset 3. The normal offset is added to the interpolated unit normal and the sum normalised; it is in world
axes, because a lattice surface has no texture coordinates yet. Baking turns it into a tangent-space normal
map.
"""

import copy
import itertools
from collections.abc import Callable

import torch
from torch import Tensor, nn

from lightprobe.core.config import DecomposeConfig, Smoothed
from lightprobe.core.device import generator, to_device
from lightprobe.geometry.textures import CHANNELS
from lightprobe.kernels import hash_encode
from lightprobe.light.prefilter import MIN_ROUGHNESS
from lightprobe.reconstruction.losses import SMOOTHNESS, brightness_anchor, color_change, material_prior
from lightprobe.reconstruction.trials.schedule import metals_tried

MATERIAL_RATE = 0.005  # Adam step of the material in the first two passes (paper, 4.2)
START_BASE = 0.2  # linear base colour that a new field shows
_MAX_NORMAL_OFFSET = 0.5  # of each component, before the normal is normalised
_FEATURES = 2  # per level and entry
_EXTENT = 1.2  # half edge of the cube around the origin that the grid covers, in object radii
_NEIGHBOURS = 4096  # points whose material is compared with that beside them
_BESIDE = 0.01  # how far away that is, in object radii

# points (N, 3), the field's material (N, 8) -> a material (N, 8) with some values given
Held = Callable[[Tensor, Tensor], Tensor]


def activate(raw: Tensor) -> Tensor:
    """Map unbounded channels (N, 8) to a valid material (N, 8)."""
    color = torch.sigmoid(raw[:, :3])
    roughness = MIN_ROUGHNESS + (1 - MIN_ROUGHNESS) * torch.sigmoid(raw[:, 3:4])
    metallic = torch.sigmoid(raw[:, 4:5])
    offset = _MAX_NORMAL_OFFSET * torch.tanh(raw[:, 5:8])
    return torch.cat([color, roughness, metallic, offset], dim=1)


def level_resolutions(levels: int, coarsest: int, finest: int) -> Tensor:
    """Return the cells per edge of each level, (L,) int32, in geometric progression.

    Mueller et al. 2022, equations 2 and 3.
    """
    steps = torch.arange(levels, dtype=torch.float64) / max(levels - 1, 1)
    return torch.floor(coarsest * (finest / coarsest) ** steps + 1e-6).to(torch.int32)


class MaterialField(nn.Module):
    """Hash grid and MLP (two hidden layers of 32) from points to materials."""

    def __init__(self, config: DecomposeConfig, random: torch.Generator) -> None:
        super().__init__()
        levels, entries = config.hash_levels, 2**config.hash_log2_size
        # No buffer: its values are read, which a GPU delays.
        self.resolutions = level_resolutions(levels, config.hash_coarsest, config.hash_finest)
        self.table = nn.Parameter(torch.rand(levels, entries, _FEATURES, generator=random) * 2e-4 - 1e-4)
        widths = (levels * _FEATURES + 3, 32, 32, CHANNELS)
        self.weights = nn.ParameterList(
            torch.randn(a, b, generator=random) * (2 / a) ** 0.5 for a, b in itertools.pairwise(widths)
        )
        self.biases = nn.ParameterList(torch.zeros(b) for b in widths[1:])
        with torch.no_grad():
            self.weights[-1].mul_(0.1)
            # Start a dark grey, half rough and a third metallic, from where either kind of surface can be
            # reached.
            self.biases[-1].copy_(torch.tensor([-1.4, -1.4, -1.4, 0.0, -0.85, 0.0, 0.0, 0.0]))

    def forward(self, points: Tensor) -> Tensor:
        """Return the material (N, 8) at points (N, 3) of the normalised frame; differentiable in the points."""
        unit = (points / (2 * _EXTENT) + 0.5).clamp(0, 1)
        features = hash_encode(unit, self.table, self.resolutions)
        x = torch.cat([features, unit - 0.5], dim=1)
        for weight, bias in zip(list(self.weights)[:-1], list(self.biases)[:-1], strict=True):
            x = torch.relu(torch.addmm(bias, x, weight))
        return activate(torch.addmm(self.biases[-1], x, self.weights[-1]))


class ScaledMaterial(nn.Module):
    """A material field and the brightness of its base colours, which is chosen, not trained."""

    brightness: Tensor  # ()

    def __init__(self, mean: float, config: DecomposeConfig, device: torch.device, seed: int):
        """Start a new field with the mean linear base colour `mean`."""
        super().__init__()
        self.config, self.seed = config, seed
        self.held: list[Held] = []
        """What is given for a while and not fitted; no part of the state that is stored and taken over."""
        self.register_buffer("brightness", torch.tensor(mean / START_BASE, device=device))
        self.field = MaterialField(config, generator(seed, "field")).to(device)

    def forward(self, points: Tensor) -> Tensor:
        """Return the field's material (N, 8) at points (N, 3), its base colours times the brightness."""
        channels = self.field(points)
        color = channels[:, :3] * self.brightness
        # At the bound the gradient goes on: a colour that shot over white could not come back without one.
        over_white = (color.detach() - 1).clamp(min=0)
        material = torch.cat([color - over_white, channels[:, 3:]], 1)
        for held in self.held:
            material = held(points, material)
        return material

    @property
    def mean_color(self) -> Tensor:
        """The mean () that base colours are held at."""
        return START_BASE * self.brightness

    @torch.no_grad()
    def rescaled(self, factor: float) -> "ScaledMaterial":
        """Return a copy with all base colours times `factor`."""
        copied = copy.deepcopy(self)
        copied.brightness *= factor
        return copied

    @torch.no_grad()
    def take_over(self, other: "ScaledMaterial") -> None:
        """Become `other`, in place: an optimiser may hold the parameters."""
        self.load_state_dict(other.state_dict())

    def loss(self, position: Tensor, material: Tensor, step: int, covered: float) -> Tensor:
        """Return what the material (N, 8) at N surface points (N, 3) costs: smoothness, priors, normal
        offsets.

        covered: the share of a photo that the points cover.
        """
        config, count = self.config, min(_NEIGHBOURS, len(position))
        random = generator(self.seed, "jitter", step)
        rows = to_device(torch.randint(0, max(len(position), 1), (count,), generator=random), position.device)
        jitter = _BESIDE * to_device(torch.randn(count, 3, generator=random), position.device)
        here = material.index_select(0, rows)
        there = self(position.detach()[rows] + jitter)
        if config.smoothed is Smoothed.BASE_COLOR:
            change = color_change(here[:, :3], there[:, :3], covered, step)
        else:
            change = (here - there).abs().mean()
        return (
            SMOOTHNESS * change
            + material_prior(material, config, decided=metals_tried(config, step))
            + brightness_anchor(material[:, :3], self.mean_color, config)
            + config.normal_prior * material[:, 5:].square().mean()
        )
