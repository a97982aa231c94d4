"""Fit the prefiltered lobes that stand for the specular lobe of the reflectance model, by view and roughness.

    python tools/fit_specular_lobes.py        # rewrites src/lightprobe/assets/specular_lobes.json, four minutes

The renderer reads the table through `lightprobe.render.specular_lobes`, which says what the lobes are. For a grid of
cosines and roughnesses this finds the mixture g of two prefiltered lobes in the plane of incidence and the cosine lobe
of the normal that is nearest to the true lobe f = F D V n.l. There is one set of parameters for F0 = 1 and one for a
dielectric, fitted together so that their blends serve what lies between. Near means, for soft lamps in all places,

    sum over lamps of (response of g - response of f)^2 / sum over lamps of (response of f)^2,

plus a share of the same ratio for point lamps, |g - f|^2 / |f|^2, lest a lobe narrower than a lamp falls apart into
two. No particular light enters. Same machine, same table.

Frame: n = z, the plane of incidence is x, z, the mirror direction has x > 0. C cosines, S roughnesses, M directions.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

TABLE = Path(__file__).parents[1] / "src/lightprobe/assets/specular_lobes.json"
COSINES, ROUGHNESSES = 16, 13  # nodes, uniform in sqrt(n.v) and in roughness, both over [0, 1]
MIN_COS, MIN_ROUGHNESS, MAX_ALPHA = 0.005, 0.08, 1.96
REFLECTANCES = (1.0, 0.5, 0.2, 0.04)
RINGS, SPOKES = 36, 18
LAMPS, CONCENTRATION = 500, 40.0  # a lamp of exp(40 (cos - 1)) is about 15 degrees wide
POINT_SHARE = 0.02
STEPS, RATE, SMOOTHNESS = 700, 0.03, 0.001


@dataclass(frozen=True)
class Cells:
    """All (cosine, roughness) cells, each with M directions around its mirror direction, on one side."""

    cosine: Tensor  # (C, 1)
    roughness: Tensor  # (1, S)
    light: Tensor  # (C, S, M, 3)
    solid_angle: Tensor  # (1, S, M), of both sides

    @property
    def mirror(self) -> Tensor:
        """Mirror directions (C, 1, 3)."""
        sine = (1.0 - self.cosine**2).sqrt()
        return torch.stack([sine, torch.zeros_like(sine), self.cosine], dim=-1)


def make_cells() -> Cells:
    """Return cells whose directions lie on rings of geometric chord lengths t; dl = t dt dphi."""
    cosine = torch.linspace(0.0, 1.0, COSINES).square().clamp(min=MIN_COS)[:, None]
    roughness = torch.linspace(0.0, 1.0, ROUGHNESSES).clamp(min=MIN_ROUGHNESS)[None]
    low = (0.12 * roughness[0] ** 2).log()[:, None]
    edge = torch.exp(low + (math.log(2.0) - low) * torch.linspace(0.0, 1.0, RINGS + 1))
    edge[:, 0] = 0.0
    along = 1.0 - (edge[:, 1:] + edge[:, :-1]) ** 2 / 8.0
    across = (1.0 - along**2).clamp(min=0.0).sqrt()[..., None]
    azimuth = (torch.arange(SPOKES) + 0.5) * math.pi / SPOKES
    local = torch.stack(
        [across * azimuth.cos(), across * azimuth.sin(), along[..., None].expand(-1, -1, SPOKES)], -1
    )
    area = (edge[:, 1:] ** 2 - edge[:, :-1] ** 2) * math.pi / SPOKES
    sine = (1.0 - cosine**2).sqrt()
    zero, one = torch.zeros_like(sine), torch.ones_like(sine)
    frame = torch.stack(
        [torch.cat(v, -1) for v in ((cosine, zero, -sine), (zero, one, zero), (sine, zero, cosine))], 1
    )
    light = torch.einsum("smk,ckx->csmx", local.flatten(1, 2), frame)
    return Cells(cosine, roughness, light, area.repeat_interleave(SPOKES, dim=1)[None])


def true_lobe(cells: Cells, f0: float) -> tuple[Tensor, Tensor]:
    """Return F D V n.l of every cell and direction (C, S, M), scaled to integrate to 1, and its integral."""
    alpha2 = cells.roughness[..., None] ** 4
    cos_view, cos_light = cells.cosine[..., None], cells.light[..., 2].clamp(min=0.0)
    view = cells.mirror * torch.tensor([-1.0, 1.0, 1.0])
    half = torch.nn.functional.normalize(cells.light + view[:, :, None], dim=-1)
    distribution = alpha2 / (alpha2 + (1.0 - alpha2) * (half[..., 0] ** 2 + half[..., 1] ** 2)) ** 2
    masking = cos_light * torch.sqrt(alpha2 + (1.0 - alpha2) * cos_view**2)
    masking = masking + cos_view * torch.sqrt(alpha2 + (1.0 - alpha2) * cos_light**2)
    fresnel = f0 + (1.0 - f0) * (1.0 - (half * view[:, :, None]).sum(-1).clamp(0.0, 1.0)) ** 5
    lobe = fresnel * distribution * cos_light / masking.clamp(min=1e-9)
    integral = (lobe * cells.solid_angle).sum(-1, keepdim=True)
    return lobe / integral, integral


def prefiltered_lobe(cells: Cells, centre: Tensor, alpha: Tensor) -> Tensor:
    """Return the lobe (C, S, M) of `lightprobe.light.lobes` around unit `centre` (C, S, 3), alpha (C, S)."""
    alpha2 = alpha[..., None] ** 2
    chord2 = (cells.light - centre[:, :, None]).square().sum(-1)
    lobe = (1.0 - 0.5 * chord2).clamp(min=0.0) / (alpha2 + 0.25 * (1.0 - alpha2) * chord2) ** 2
    a2 = alpha2.double()
    k = torch.where((1.0 - a2).abs() < 1e-3, 1e-3, 1.0 - a2)
    high = a2 + 0.5 * k
    integral = (
        4.0 * math.pi / k * ((1.0 + 2.0 * a2 / k) * (1.0 / a2 - 1.0 / high) - 2.0 / k * (high / a2).log())
    )
    return lobe / integral.float()


def mixture(cells: Cells, parameters: Tensor) -> Tensor:
    """Return the mixture (C, S, M) of parameters (C, S, 6): bends, factors on the roughness, shares."""
    normal = torch.tensor([0.0, 0.0, 1.0])
    bend, factor, share = parameters.split(2, dim=-1)
    total = (1.0 - share.sum(-1, keepdim=True)) * cells.light[..., 2].clamp(min=0.0) / math.pi
    for k in range(2):
        centre = normal + bend[..., k, None] * (cells.mirror - normal)
        alpha = ((cells.roughness * factor[..., k]) ** 2).clamp(MIN_ROUGHNESS**2, MAX_ALPHA)
        lobe = prefiltered_lobe(cells, torch.nn.functional.normalize(centre, dim=-1), alpha)
        total = total + share[..., k, None] * lobe
    return total


def parameters_of(table: Tensor) -> Tensor:
    """Return the parameters (..., 6) of what is optimised: bends, log(alpha / r^2), logits of the shares."""
    share = torch.nn.functional.pad(table[..., 4:], (0, 1)).softmax(-1)
    return torch.cat([table[..., :2], (0.5 * table[..., 2:4]).exp(), share[..., :2]], dim=-1)


def first_guess(cells: Cells) -> Tensor:
    """Return a table (C, S, 6): bent towards the normal with roughness, narrowed by foreshortening."""
    r, c = torch.broadcast_tensors(cells.roughness, cells.cosine)
    bend, apart = 1.0 - 0.35 * r**2, 0.08 * (0.3 + r)
    narrow, likely = 0.4 * (1.0 - r) * c.log(), torch.full_like(r, 2)
    return torch.stack([bend - apart, bend + apart, narrow, narrow, likely, likely], dim=-1)


def lamps(cells: Cells) -> Tensor:
    """Return what each direction sends under lamps spread evenly over the sphere, (C, S, M, lamps)."""
    k = torch.arange(LAMPS) + 0.5
    height, turn = 1.0 - 2.0 * k / LAMPS, math.pi * (1.0 + math.sqrt(5.0)) * k
    ring = (1.0 - height**2).sqrt()
    centre = torch.stack([ring * turn.cos(), (ring * turn.sin()).abs(), height], dim=-1)
    other = centre * torch.tensor([1.0, -1.0, 1.0])
    both = sum(torch.exp(CONCENTRATION * (cells.light @ side.T - 1.0)) for side in (centre, other))
    return 0.5 * both * cells.solid_angle[..., None]


def unevenness(table: Tensor) -> Tensor:
    """Return the sum of squared second differences along both axes, which keeps neighbouring cells alike."""
    scaled = table * torch.tensor([3.0, 3.0, 1.0, 1.0, 1.0, 1.0])
    along, across = (
        (t[2:] - 2.0 * t[1:-1] + t[:-2]).square().sum() for t in (scaled, scaled.transpose(0, 1))
    )
    return along + across


@dataclass(frozen=True)
class Goal:
    """The true lobe of one F0, and how far a mixture is from it."""

    f0: float
    dielectric: Tensor  # (C, S, 1) the part of the dielectric's lobe in it
    lobe: Tensor  # (C, S, M)
    norm: tuple[Tensor, Tensor]  # of the lobe, under lamps and points

    def errors(self, cells: Cells, lamp: Tensor, metal: Tensor, dielectric: Tensor) -> tuple[Tensor, Tensor]:
        """Return the relative squared errors (C, S), under lamps and points, of blended parameters."""
        parameters = metal + self.dielectric * (dielectric - metal)
        soft, point = energies(cells, lamp, mixture(cells, parameters) - self.lobe)
        return soft / self.norm[0], point / self.norm[1]


def make_goals(cells: Cells, lamp: Tensor) -> list[Goal]:
    """Return the goals of all F0; the dielectric is the last of them."""
    last = REFLECTANCES[-1]
    base = true_lobe(cells, last)[1]
    goals = []
    for f0 in REFLECTANCES:
        lobe, integral = true_lobe(cells, f0)
        goals.append(Goal(f0, (1.0 - f0) / (1.0 - last) * base / integral, lobe, energies(cells, lamp, lobe)))
    return goals


def energies(cells: Cells, lamp: Tensor, lobe: Tensor) -> tuple[Tensor, Tensor]:
    """Return the summed squared responses (C, S) of a lobe (C, S, M) to lamps and to points."""
    soft = torch.einsum("csm,csmj->csj", lobe, lamp).square().sum(-1)
    return soft, (lobe.square() * cells.solid_angle).sum(-1)


def fit(cells: Cells, lamp: Tensor, goals: list[Goal]) -> tuple[Tensor, Tensor]:
    """Return the parameters (C, S, 6) for F0 = 1 and for the dielectric."""
    tables = [first_guess(cells).requires_grad_() for _ in range(2)]
    optimiser = torch.optim.Adam(tables, lr=RATE)
    for step in range(STEPS):
        optimiser.param_groups[0]["lr"] = RATE * 0.5 * (1.0 + math.cos(math.pi * step / STEPS)) + 3e-4
        optimiser.zero_grad()
        for goal in goals:  # one at a time bounds the memory
            soft, point = goal.errors(cells, lamp, *(parameters_of(table) for table in tables))
            (soft + POINT_SHARE * point).sum().backward()
        (SMOOTHNESS * (unevenness(tables[0]) + unevenness(tables[1]))).backward()
        optimiser.step()
    metal, dielectric = (parameters_of(table).detach() for table in tables)
    return metal, dielectric


def main() -> None:
    """Fit, print the errors, write the table (F0, roughness, cosine, 6): bends, factors, shares."""
    cells = make_cells()
    lamp = lamps(cells)
    goals = make_goals(cells, lamp)
    fitted = fit(cells, lamp, goals)
    for goal in goals:
        error = goal.errors(cells, lamp, *fitted)[0].sqrt()
        print(
            f"F0 = {goal.f0}: error under lamps; rows r, columns n.v",
            *(f"{c:.3f}" for c in cells.cosine[:, 0]),
        )
        for roughness, row in zip(cells.roughness[0].tolist(), error.T.tolist(), strict=True):
            print(f"{roughness:.3f}  " + " ".join(f"{value:.3f}" for value in row))
    values = (1000.0 * torch.stack(fitted).transpose(1, 2)).round()
    values[..., 5] = values[..., 5].minimum(1000.0 - values[..., 4])  # rounded shares, too, sum to at most 1
    nodes = [[[[v / 1000.0 for v in cell] for cell in row] for row in table] for table in values.tolist()]
    TABLE.write_text(json.dumps(nodes, separators=(",", ":")) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
