"""Light that reaches a surface past the object itself: cosine and uniform averages over the open directions.

    w_k (K, 3) unit directions, dw_k their solid angles, L_k (K, 3) the light averaged over them
    v_pk = sum over c of weight[p, c] unoccluded[index[p, c], k] / 255, the share of direction k that pixel p has open
    c_pk = max(n_p.w_k, 0) dw_k

    diffuse_p = sum_k c v L / sum_k c      ambient_p = sum_k dw v L / sum_k dw v      open_p = sum_k c v / sum_k c

With nothing in the way diffuse is irradiance / pi, and open is 1. For one light the P x K matrices are not stored; for
many, `occlusion_weights` makes them.
"""

from typing import Any

import torch
from torch import Tensor

from lightprobe.kernels import dispatch


def occluded_light(
    light: Tensor,
    normals: Tensor,
    unoccluded: Tensor,
    index: Tensor,
    weight: Tensor,
    directions: Tensor,
    angles: Tensor,
) -> Tensor:
    """Return (P, 7): diffuse 3, ambient 3 and open, for each pixel; differentiable once, in `light`, `normals`.

    light (K, 3), normals (P, 3) unit, weight (P, C), directions (K, 3), angles (K,): float32 (float64 goes to
    the reference); unoccluded (V, K) uint8; index (P, C) int32 or int64 in [0, V). Sums have a fixed order.
    Raises ValueError on wrong shapes or dtypes and IndexError on an index outside the rows.
    """
    dispatch.require_shape("light", light, directions.shape[0], 3)
    _require(normals, unoccluded, index, weight, directions, angles)
    return _OccludedLight.apply(light, normals, unoccluded, index, weight.detach(), directions, angles)


def occlusion_weights(
    normals: Tensor, unoccluded: Tensor, index: Tensor, weight: Tensor, directions: Tensor, angles: Tensor
) -> Tensor:
    """Return what a light is multiplied by in `occluded_light`, (2, P, K): of diffuse, and of ambient.

    Rows of the first sum to open, of the second to 1, or to 0 where nothing is open. Arguments and errors as there; not
    differentiable.
    """
    _require(normals, unoccluded, index, weight, directions, angles)
    out = normals.new_empty(2, normals.shape[0], directions.shape[0])
    case = normals.detach(), unoccluded, index, weight.detach(), directions, angles
    dispatch.choose("occlusion", *case).weights(out, *case)
    return out


def _require(
    normals: Tensor, unoccluded: Tensor, index: Tensor, weight: Tensor, directions: Tensor, angles: Tensor
) -> None:
    """Raise what `occluded_light` raises."""
    count = directions.shape[0]
    dispatch.require_shape("normals", normals, weight.shape[0], 3)
    dispatch.require_shape("unoccluded", unoccluded, None, count)
    dispatch.require_shape("index", index, *weight.shape)
    dispatch.require_shape("directions", directions, count, 3)
    dispatch.require_shape("angles", angles, count)
    dispatch.require_index("index", index, unoccluded.shape[0])
    if unoccluded.dtype != torch.uint8:
        raise ValueError(f"unoccluded must be uint8, not {unoccluded.dtype}.")


class _OccludedLight(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *case: Tensor) -> Tensor:
        out = dispatch.choose("occlusion", *case).occluded_light(*case)
        ctx.save_for_backward(out, *case)
        return out

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, ...]:
        out, *case = ctx.saved_tensors
        backend = dispatch.choose("occlusion", grad, *case)
        wants_light, wants_normals = ctx.needs_input_grad[:2]
        return (
            backend.light_gradient(grad, *case[1:]) if wants_light else None,
            backend.normal_gradient(grad, out, *case) if wants_normals else None,
            *([None] * 5),
        )
