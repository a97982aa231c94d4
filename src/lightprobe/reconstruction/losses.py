"""Image losses of Phase I. Colours are linear and premultiplied; comparison happens after tone mapping."""

from typing import Any

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig
from lightprobe.imaging import srgb_encode
from lightprobe.light.photometry import one_sided, tone_map
from lightprobe.reconstruction.photos import Target

USUAL_ROUGHNESS = 0.4  # what the prior pulls to; docs/decisions/material-priors.md
_ALIKE = (0.15, 0.2)  # by how much displayed colour and roughness vary within one metal
_DARK = 0.33  # of the mean base colour: darker metals cost less, in proportion


def image_loss(render: Tensor, cover: Tensor, target: Target, background: Tensor, weight: float) -> Tensor:
    """Return L1 of tone-mapped colour over `background` (3,) plus `weight` times the squared coverage error.

    render (N, 3) linear premultiplied, cover (N,): the picture to compare with the photo `target`.

    All pixels where photo or render show the object count; the sum is divided by the photo's object area, so
    that the loss does not depend on how much of the frame is empty.
    """
    seen = ((target.alpha > 0) | (cover.detach() > 0)).nonzero()[:, 0]
    photo, alpha, clipped = target.color[seen], target.alpha[seen], target.clipped[seen]
    render, cover = render.index_select(0, seen), cover.index_select(0, seen)
    ours = tone_map(one_sided(render, photo, clipped) + (1 - cover)[:, None] * background)
    theirs = tone_map(photo + (1 - alpha)[:, None] * background)
    area = alpha.sum().clamp(min=1)
    return (ours - theirs).abs().sum() / (3 * area) + weight * (cover - alpha).square().sum() / area


def neighbour_difference(maps: Tensor) -> Tensor:
    """Return the mean absolute difference of texels beside each other plus that of texels below, for maps (H,
    W, C).
    """
    return _NeighbourDifference.apply(maps)


class _NeighbourDifference(torch.autograd.Function):
    """The gradient is made along the way: through slices it would take a dozen passes over the maps."""

    @staticmethod
    def forward(ctx: Any, maps: Tensor) -> Tensor:
        total, gradient = maps.new_zeros(()), torch.zeros_like(maps)
        for axis in (0, 1):
            count = maps.shape[axis] - 1
            difference = maps.narrow(axis, 1, count) - maps.narrow(axis, 0, count)
            total += difference.abs().mean()
            sign = difference.sign_().div_(difference.numel())
            gradient.narrow(axis, 1, count).add_(sign)
            gradient.narrow(axis, 0, count).sub_(sign)
        ctx.save_for_backward(gradient)
        return total

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, outer: Tensor) -> Tensor:
        (gradient,) = ctx.saved_tensors
        return outer * gradient


def material_prior(material: Tensor, config: DecomposeConfig, *, decided: bool) -> Tensor:
    """Return what materials (N, >= 5), channels as in `material.field`, cost for being unusual.

    decided: whether it has been tried what is metal (`reconstruction.metal_trials`). From then on it costs to
    be neither metal nor none, where before it costs to be metal; what is dark goes on being pulled away from
    metal. The roughness of what is no metal is pulled with `late_roughness_prior` then: its diffuse part
    tells of the light. A metal that may be as sharp as it likes only bends its light.

    Photos under unknown lights leave some things nearly open: a mirror under a free light can imitate any
    shading, and a sharp lobe under a blurred light a wide lobe under a sharp one. A dark metal is no mirror.
    It reflects less than a dielectric, as soot and leather do, which nothing else in the material can say, so
    it has next to no price.
    """
    red, green, blue, roughness, metallic = material.unbind(1)[
        :5
    ]  # slices would each cost a gradient of the whole
    color = (red + green + blue).detach()
    price = (color / (_DARK * color.mean()).clamp(min=1e-6)).clamp(max=1)
    unusual = (roughness - USUAL_ROUGHNESS).square()
    metal = torch.lerp(metallic, torch.minimum(metallic, 1 - metallic), price) if decided else metallic
    early, late = config.roughness_prior, config.late_roughness_prior
    pulled = (
        ((late + (early - late) * metallic.detach()) * unusual).mean() if decided else early * unusual.mean()
    )
    return config.metallic_prior * (price * metal).mean() + pulled


def brightness_anchor(base_color: Tensor, mean: Tensor) -> Tensor:
    """Return the squared logarithm of the geometric mean, over channels, of base colours (N, 3) over `mean`
    ().
    """
    return (base_color.mean(0).clamp(min=1e-3).log().mean() - mean.log()).square()


def color_gauge(base_color: Tensor, cast: Tensor) -> Tensor:
    """Return a loss that moves the mean of base colours (N, 3) along `cast` (3,).

    `cast` is by how much (in logarithms, mean 0) the photos' lights are brighter in a channel than in the
    mean. A light too red is a surface not red enough; over many photos lights are grey (the grey-world
    assumption).
    """
    return -(cast * base_color.mean(0).clamp(min=1e-3).log()).sum()


def metal_parsimony(base_color: Tensor, roughness: Tensor, metallic: Tensor) -> Tensor:
    """Return the entropy of the metals' base colours (N, 3), where roughness and metallic are (N,).

    What a metal is coloured and what it mirrors are one product, and light left over in a place of the map
    becomes colour in a place of the metal. But objects are made of few materials (Barron and Malik 2015,
    section 4.1.2). Points count by how metallic they are; the density is a sum of Gaussians around all points
    of like roughness.
    """
    share = metallic.detach()
    place = torch.cat([srgb_encode(base_color) / _ALIKE[0], roughness.detach()[:, None] / _ALIKE[1]], 1)
    length = place.square().sum(1)
    squared = (length[:, None] + length - 2 * place @ place.T).clamp(min=0)
    density = torch.exp(-0.5 * squared) @ share / share.sum().clamp(min=1e-6)
    return -(share * density.clamp(min=1e-6).log()).mean()
