"""Stacking of probe pixels onto the sphere: a kernel-weighted average that never stores its pixels x texels matrix.

    n (N, 3) unit normals   v (N, 3) unit, surface -> camera   w (M, 3) unit, surface -> light   h = (w + v)/|w + v|
    a2 (N,) squared GGX width alpha^2 (r^4 for roughness r; the paper prints r^2)     c (N, 3) linear colours

    D_p(w) = a2 / (pi ((n.h)^2 (a2 - 1) + 1)^2) max(n.w, 0)                                       [paper, Eq. 4, 1/sr]
    W(w)   = sum_p D_p(w)            P(w) = sum_p c_p D_p(w) / W(w), or 0 where W(w) = 0          [paper, Eq. 5]

With g = dLoss/dP the gradient is dLoss/dc_p = sum_w D_p(w) g(w) / W(w), a second pass of the same shape.

Every backend computes the bracket as |n x h|^2 + a2 (n.h)^2, which it equals for unit vectors. The printed form subtracts
two numbers near 1 in the core of a sharp lobe, and in float32 loses most of its digits there.
Where w = -v there is no h, and D is taken as if h were perpendicular to n.
"""

from typing import Any

import torch
from torch import Tensor

from lightprobe.kernels import dispatch

LEAST_ALPHA2 = 1e-8  # a narrower lobe is beyond what float32 directions resolve


def stack_probes(
    colors: Tensor, normals: Tensor, views: Tensor, alpha2: Tensor, directions: Tensor
) -> tuple[Tensor, Tensor]:
    """Return radiance P (M, 3) and weight W (M,) in `directions`; P is differentiable in `colors`, W in nothing.

    colors, normals, views (N, 3), alpha2 (N,) in (0, 1], directions (M, 3): float32 (float64 goes to the
    reference); vectors of unit length. Sums run over pixels in their order, so the bits do not depend on the
    number of threads. Raises ValueError on wrong shapes or mixed dtypes. Differentiable once.
    """
    dispatch.require_shape("colors", colors, normals.shape[0], 3)
    lobes = _lobes(normals, views, alpha2, directions)
    return _StackProbes.apply(colors, *lobes)


def probe_weight(normals: Tensor, views: Tensor, alpha2: Tensor, directions: Tensor) -> Tensor:
    """Return only the weight W (M,) of `stack_probes`: how much the pixels saw of each direction."""
    lobes = _lobes(normals, views, alpha2, directions)
    return dispatch.choose("stacking", *lobes).stack(torch.zeros_like(lobes[0]), *lobes)[1]


def _lobes(normals: Tensor, views: Tensor, alpha2: Tensor, directions: Tensor) -> tuple[Tensor, ...]:
    """Return the checked arguments, cut off from the graph."""
    dispatch.require_shape("normals", normals, None, 3)
    dispatch.require_shape("views", views, normals.shape[0], 3)
    dispatch.require_shape("alpha2", alpha2, normals.shape[0])
    dispatch.require_shape("directions", directions, None, 3)
    return normals.detach(), views.detach(), alpha2.detach().clamp(min=LEAST_ALPHA2), directions.detach()


def lobe_frames(normals: Tensor, views: Tensor, alpha2: Tensor) -> Tensor:
    """Return (N, 13): t, t.v, b, b.v, n, n.v, a2 of the frame (t, b, n) in which the backends evaluate each lobe.

    With w in the frame and s = n.w + n.v, k = (t.w + t.v)^2 + (b.w + b.v)^2: |w + v|^2 = k + s^2 and the bracket of
    D is (k + a2 s^2)/(k + s^2). So D needs 12 fused operations for w, no square root and one division, and nothing
    cancels in the core of the lobe. The frame is Duff et al.'s (2017), in float64 to start exact.
    """
    n, v = normals.double(), views.double()
    x, y, z = n.unbind(1)
    sign = torch.copysign(torch.ones_like(z), z)
    a = -1 / (sign + z)
    b = x * y * a
    t = torch.stack([1 + sign * x * x * a, sign * b, -sign * x], 1)
    axes = [t, torch.stack([b, sign + y * y * a, -y], 1), n]
    columns = [part for axis in axes for part in (axis, (axis * v).sum(dim=1, keepdim=True))]
    return torch.cat([*columns, alpha2[:, None].double()], dim=1).float()


class _StackProbes(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, colors: Tensor, *lobes: Tensor) -> tuple[Tensor, Tensor]:
        total, weight = dispatch.choose("stacking", colors, *lobes).stack(colors, *lobes)
        ctx.save_for_backward(weight, *lobes)
        ctx.mark_non_differentiable(weight)
        return _divide(total, weight), weight

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, grad: Tensor, _: Tensor) -> tuple[Tensor | None, ...]:
        weight, *lobes = ctx.saved_tensors
        backend = dispatch.choose("stacking", grad, *lobes)
        return backend.stack_backward(_divide(grad, weight), *lobes), None, None, None, None


def _divide(value: Tensor, weight: Tensor) -> Tensor:
    """Return `value` (M, 3) / `weight` (M,), and 0 where the weight is 0."""
    return torch.where(weight[:, None] == 0, 0, value / weight[:, None])  # so written that NaN stays visible
