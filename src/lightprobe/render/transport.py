"""The photo as a linear function of its light, and the light that explains a photo.

With geometry and material fixed, the split-sum render is A E: A = F T L, with E the light's texels, L the
prefilter, T the look-up taps of each pixel and F what each pixel reflects per channel. A is applied, never
built. All entries of A are non-negative.
"""

import copy
import functools
import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from lightprobe.light import cubemap
from lightprobe.light.photometry import beyond_clipping, one_sided_residual
from lightprobe.light.prefilter import BLOCKS, Prefilter
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import Shading
from lightprobe.render.taps import look_up
from lightprobe.render.visibility import OpenLight

_TINY = 1e-30  # keeps a division by nothing finite
_LEAST_SHARE = 0.05  # of the mean channel: fainter ones are compared as if they were this bright
_FIRST_TRIAL, _LEAST_TRIAL = 4.0, 0.5  # steps before the line search; 1 is safe, 4 still common


@dataclass(frozen=True)
class LitPixels:
    """A light, and what pixels show under it."""

    light: Tensor  # (6, R, R, 3) >= 0
    radiance: Tensor  # (P, 3)


class Transport:
    """The linear operator from a cubemap (6, R, R, 3) to the radiance (P, 3) of pixels; no autograd."""

    @torch.no_grad()
    def __init__(
        self, gbuffer: GBuffer, prefilter: Prefilter, rows: Tensor | None = None, *, often: bool = False
    ):
        """Precompute taps and factors for the rows (P,) int64 of the G-buffer, or for all of them.

        often: whether it will be applied often enough to write matrices of few pixels out.
        """
        if rows is not None:
            gbuffer = gbuffer.select(rows)
        shading = Shading.of(gbuffer, prefilter)
        self._factors, seen = shading.factors, shading.visibility
        self._open = None if seen is None else OpenLight(seen, shading.normal)
        self._looked_up = look_up(shading.taps, prefilter, often=often)
        self.resolution = prefilter.resolution

    def select(self, rows: Tensor) -> "Transport":
        """Return the operator of the pixels at `rows` (K,) int64 alone."""
        part = copy.copy(self)
        part._factors = self._factors[:, rows]
        part._open = None if self._open is None else self._open.select(rows)
        part._looked_up = self._looked_up.select(rows)
        part.__dict__.pop("white", None)  # the cached value is of all pixels
        return part

    @functools.cached_property
    def white(self) -> Tensor:
        """The radiance (P, 3) under a light of 1 everywhere; a constant light's is its colour times this."""
        return self.apply(torch.ones(6, self.resolution, self.resolution, 3, device=self._factors.device))

    def lit(self, env: Tensor) -> LitPixels:
        """Return a light (6, R, R, 3), 0 where it is negative, with what the pixels show under it."""
        env = env.clamp(min=0)
        return LitPixels(env, self.apply(env))

    def apply(self, env: Tensor) -> Tensor:
        """Return the radiance (P, 3) under the light env (6, R, R, 3)."""
        lobes, blocks = self._looked_up.apply(env)
        if self._open is not None:
            lobes = torch.cat([lobes, self._open.apply(blocks).flatten(0, 1)])
        return (self._factors * lobes.reshape(self._factors.shape)).sum(0)

    def adjoint(self, radiance: Tensor) -> Tensor:
        """Return the transpose of `apply` on (P, 3): (6, R, R, 3)."""
        lobes = self._factors * radiance
        if self._open is None:
            return self._looked_up.adjoint(lobes.reshape(-1, 3), lobes.new_zeros(6 * BLOCKS**2, 3))
        return self._looked_up.adjoint(lobes[0], self._open.adjoint(lobes[1:]))


@torch.no_grad()
def solve_light(
    transport: Transport,
    observed: Tensor,
    weight: Tensor,
    clipped: Tensor,
    prior: Tensor,
    regularisation: float | Tensor,
    iterations: int,
    start: LitPixels | None = None,
    chroma: float = 0.0,
) -> LitPixels:
    """Return the light E (6, R, R, 3) >= 0 that explains the photo and stays near `prior`; deterministic.

    Minimises, with mean_w the mean over pixels weighted by `weight` and mean_omega that over solid angle,

        mean_w |A E - observed|^2  +  gain^2 * mean_omega regularisation |E - prior|^2
                                   +  chroma * gain^2 * mean_omega g^2 |U - mean_c U|^2 / (1 + u)

    gain^2 = mean_w |A 1|^2 is what the object reflects of a white light. So `regularisation` has no
    dimension: it does not depend on the number of pixels, the exposure, or how dark the object is; it may be one number
    or (6, R, R, 3). Texels the
    photo does not pin go to the prior. observed (P, 3) linear; weight (P,) >= 0; where clipped (P, 3) bool, a
    brighter render costs nothing. The last term holds the channels together (`_ChannelCoupling`).

    Conjugate gradients on the texels off the bound. A trial step along the direction is projected to E >= 0,
    and an exact line search follows between the light and the projected point: all of that segment is valid,
    so an iteration costs one application and one adjoint. The preconditioner M is the majorant of the Hessian
    that comes free with A >= 0 (`_Problem`). The search begins at `start`, by default at the prior.
    """
    state = start or transport.lit(prior)
    coupling = _ChannelCoupling.of(state.light, prior, chroma)
    problem = _Problem.build(transport, observed, weight, clipped, prior, regularisation, coupling)
    direction = previous = None
    trial = torch.full((), _FIRST_TRIAL, device=prior.device)
    for _ in range(iterations):
        gradient = problem.gradient(state)
        free = (state.light > 0) | (gradient < 0)
        gradient = torch.where(free, gradient, 0.0)
        scaled = gradient / problem.majorant
        direction = _conjugate(scaled, gradient, free, direction, previous)
        previous = gradient, (scaled * gradient).sum()
        move = (state.light + trial * direction).clamp(min=0) - state.light
        state, share = problem.step(state, move, gradient)
        direction = move / trial
        trial = (2 * share * trial).clamp(min=_LEAST_TRIAL)
    return state


def _conjugate(
    scaled: Tensor,
    gradient: Tensor,
    free: Tensor,
    direction: Tensor | None,
    previous: tuple[Tensor, Tensor] | None,
) -> Tensor:
    """Return the next search direction (Polak and Ribiere, share >= 0, restarted when it points uphill)."""
    if direction is None or previous is None:
        return -scaled
    old_gradient, old_product = previous
    share = ((scaled * (gradient - old_gradient)).sum() / old_product.clamp(min=_TINY)).clamp(min=0.0)
    conjugate = torch.where(free, share * direction - scaled, 0.0)
    return torch.where((conjugate * gradient).sum() < 0, conjugate, -scaled)


@dataclass(frozen=True)
class _ChannelCoupling:
    """The last term of `solve_light`: chroma g^2 |U - mean_c U|^2 / (1 + u), U = E / m.

    m is the mean colour of the prior, g the mean of its channels, and u the mean of U over channels in the
    light that the search starts from: bright places may be coloured, too. Lights differ far more in
    brightness than in colour, while a dielectric that is taken for a coloured metal asks for a light of much
    contrast in one channel and little in another. |U - mean_c U|^2 is at most |U|^2, so that a diagonal
    bounds the term's Hessian from above.
    """

    stiffness: Tensor  # (6, R, R, 1): all but |U - mean_c U|^2
    mean: Tensor  # (3,): m

    @staticmethod
    def of(light: Tensor, prior: Tensor, chroma: float) -> "_ChannelCoupling | None":
        """Return the term for a search that starts from `light` (6, R, R, 3), None where it weighs nothing."""
        if chroma == 0:
            return None
        mean = prior.mean((0, 1, 2))
        grey = mean.mean()
        mean = torch.maximum(mean, (_LEAST_SHARE * grey.double() + _TINY).to(mean.dtype))
        return _ChannelCoupling(chroma * grey.square() / (1 + (light / mean).mean(-1, keepdim=True)), mean)

    def weighted(self, factor: Tensor) -> "_ChannelCoupling":
        """Return the term times `factor` (6, R, R, 1)."""
        return replace(self, stiffness=self.stiffness * factor)

    def deviation(self, light: Tensor) -> Tensor:
        """Return U - mean_c U, (6, R, R, 3), of a light or of a change of one."""
        relative = light / self.mean
        return relative - relative.mean(-1, keepdim=True)

    def gradient(self, light: Tensor) -> Tensor:
        """Return half the gradient, (6, R, R, 3)."""
        return self.stiffness * self.deviation(light) / self.mean

    def curvature(self, move: Tensor) -> Tensor:
        """Return the term () for a change of the light."""
        return (self.stiffness * self.deviation(move).square()).sum()

    def majorant(self) -> Tensor:
        """Return a diagonal (6, R, R, 3) that is no less than the Hessian."""
        return self.stiffness / self.mean.square()


@dataclass(frozen=True)
class _Problem:
    """The objective of `solve_light`; gradients and curvatures leave out its factor 2.

    majorant: M = A^T W A 1 + diagonals of the other terms. For A >= 0, x^T A^T W A x <= x^T diag(A^T W A 1) x
    by Cauchy-Schwarz, so a step of gradient / M never raises the objective (De Pierro 1995).
    """

    transport: Transport
    observed: Tensor  # (P, 3)
    weight: Tensor  # (P, 1), sums to 1
    clipped: Tensor  # (P, 3) bool
    prior: Tensor  # (6, R, R, 3)
    stiffness: Tensor  # (6, R, R, 1) or (6, R, R, 3)
    majorant: Tensor  # (6, R, R, 3)
    coupling: _ChannelCoupling | None

    @staticmethod
    def build(
        transport: Transport,
        observed: Tensor,
        weight: Tensor,
        clipped: Tensor,
        prior: Tensor,
        regularisation: float | Tensor,
        coupling: _ChannelCoupling | None,
    ) -> "_Problem":
        """Return the problem; when no pixel has any weight, every light solves it."""
        weight = (weight / weight.sum().clamp(min=_TINY))[:, None]
        gain = (weight * transport.white.square()).sum(0).mean()
        solid_angle = cubemap.solid_angles(prior.shape[1], prior.device)[..., None]
        unit = gain * solid_angle / (4.0 * math.pi)
        stiffness = regularisation * unit
        majorant = transport.adjoint(weight * transport.white) + stiffness
        if coupling is not None:
            coupling = coupling.weighted(unit)
            majorant = majorant + coupling.majorant()
        majorant = majorant.clamp(min=_TINY)
        return _Problem(transport, observed, weight, clipped, prior, stiffness, majorant, coupling)

    def residual(self, render: Tensor) -> Tensor:
        """Return render - observed, zero where a clipped pixel is rendered brighter."""
        return one_sided_residual(render, self.observed, self.clipped)

    def gradient(self, state: LitPixels) -> Tensor:
        """Return half the gradient of the objective, (6, R, R, 3)."""
        data = self.transport.adjoint(self.weight * self.residual(state.radiance))
        gradient = data + self.stiffness * (state.light - self.prior)
        return gradient if self.coupling is None else gradient + self.coupling.gradient(state.light)

    def step(self, state: LitPixels, move: Tensor, gradient: Tensor) -> tuple[LitPixels, Tensor]:
        """Return the best state between the present one and `move` away, and its share () of the move.

        Exact while no clipped pixel changes sides on the way.
        """
        change = self.transport.apply(move)
        active = ~beyond_clipping(state.radiance, self.observed, self.clipped)
        curvature = (self.weight * active * change.square()).sum() + (self.stiffness * move.square()).sum()
        if self.coupling is not None:
            curvature = curvature + self.coupling.curvature(move)
        share = (-(gradient * move).sum() / curvature.clamp(min=_TINY)).clamp(0, 1)
        return LitPixels(state.light + share * move, state.radiance + share * change), share
