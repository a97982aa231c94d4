"""The material of the first pass: a field whose base colours share one factor, and what the material costs."""

import copy
from collections.abc import Callable

import torch
from torch import Tensor, nn

from lightprobe.core.config import DecomposeConfig, Smoothed
from lightprobe.core.device import generator, to_device
from lightprobe.material.field import START_BASE, MaterialField
from lightprobe.reconstruction.frame_loss import color_change
from lightprobe.reconstruction.gauge import metals_tried
from lightprobe.reconstruction.losses import brightness_anchor, material_prior

_NEIGHBOURS = 4096  # points whose material is compared with that beside them
_BESIDE = 0.01  # how far away that is, in object radii


Held = Callable[
    [Tensor, Tensor], Tensor
]  # points (N, 3), the field's material (N, 8) -> one with some values given


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
        self.field = MaterialField(
            levels=config.hash_levels,
            features=config.hash_features,
            log2_size=config.hash_log2_size,
            coarsest=config.hash_coarsest,
            finest=config.hash_finest,
            extent=1.2,
            generator=generator(seed, "field"),
        ).to(device)

    def forward(self, points: Tensor) -> Tensor:
        """Return the material (N, 8) at points (N, 3): the field's, with its base colours times the
        brightness.
        """
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
        """Return what the material (N, 8) at N surface points (N, 3) costs; they cover the share `covered` of
        a photo.

        Smoothness under a small random displacement, and the priors of metallic, roughness and normal offset.
        """
        count = min(_NEIGHBOURS, len(position))
        random = generator(self.seed, "jitter", step)
        rows = to_device(torch.randint(0, max(len(position), 1), (count,), generator=random), position.device)
        jitter = _BESIDE * to_device(torch.randn(count, 3, generator=random), position.device)
        here = material.index_select(0, rows)
        there = self(position.detach()[rows] + jitter)
        if self.config.smoothed is Smoothed.BASE_COLOR:
            change = color_change(here[:, :3], there[:, :3], covered, step)
        else:
            change = (here - there).abs().mean()
        return (
            self.config.smoothness * change
            + material_prior(material, self.config, decided=metals_tried(self.config, step))
            + self.config.brightness_anchor * brightness_anchor(material[:, :3], self.mean_color)
            + self.config.normal_prior * material[:, 5:].square().mean()
        )
