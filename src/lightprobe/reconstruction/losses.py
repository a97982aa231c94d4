"""Losses of Phase I: of images, and of materials that are unusual. Colours are linear and premultiplied.

Images are compared after tone mapping. `frame_loss` and `color_change` are nvdiffrec's (Munkberg et al.
2022), which the paper says it adopts: their means run over the whole frame, so that they weigh less for an
object that fills less of it.
"""

from typing import Any

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig, ImageLoss
from lightprobe.imaging import srgb_encode
from lightprobe.light.photometry import one_sided, tone_map
from lightprobe.reconstruction.photos import Target

SMOOTHNESS = 0.03  # weight of the material's change under a small displacement; nvdiffrec's
USUAL_ROUGHNESS = 0.4  # what the prior pulls to; docs/decisions/material-priors.md
ROUGHNESS_PRIOR = 0.03  # weight of the squared distance from that: sharp lobes make the light too free
LATE_ROUGHNESS_PRIOR = 0.006  # of what is no metal, once that is decided: photos tell more by then than usage
BRIGHTNESS_ANCHOR = 0.1  # weight of the squared log of the mean base colour over the one that was chosen
GREY_WORLD = 0.02  # weight of the pull of the base colour to where the mean light over all photos is grey
_ALIKE = (0.15, 0.2)  # by how much displayed colour and roughness vary within one metal
DARK_METAL = 0.33  # of the mean base colour: darker metals cost less, in proportion
_RAMP = 500  # steps over which nvdiffrec's smoothness comes in


def image_loss(render: Tensor, cover: Tensor, target: Target, background: Tensor, weight: float) -> Tensor:
    """Return L1 of tone-mapped colour over `background` (3,) plus `weight` times the squared coverage error.

    render (N, 3) linear premultiplied, cover (N,): the picture to compare with the photo `target`. All pixels
    where photo or render show the object count; the sum is divided by the photo's object area, so that the
    loss does not depend on how much of the frame is empty.
    """
    seen = ((target.alpha > 0) | (cover.detach() > 0)).nonzero()[:, 0]
    photo, alpha, clipped = target.color[seen], target.alpha[seen], target.clipped[seen]
    render, cover = render.index_select(0, seen), cover.index_select(0, seen)
    ours = tone_map(one_sided(render, photo, clipped) + (1 - cover)[:, None] * background)
    theirs = tone_map(photo + (1 - alpha)[:, None] * background)
    area = alpha.sum().clamp(min=1)
    return (ours - theirs).abs().sum() / (3 * area) + weight * (cover - alpha).square().sum() / area


def frame_loss(
    render: Tensor, cover: Tensor, target: Target, background: Tensor, weight: float, kind: ImageLoss
) -> Tensor:
    """Return the loss of colours within the photo's mask plus `weight` times the mean squared coverage error.

    render (N, 3) linear, premultiplied, shown over `background` (3,); cover (N,).
    """
    alpha = target.alpha
    ours = (render + (1 - cover)[:, None] * background) * alpha[:, None]
    theirs = (target.color + (1 - alpha)[:, None] * background) * alpha[:, None]
    if kind is ImageLoss.L2:
        color = (ours - theirs).square().mean()
    else:
        color = (tone_map(ours) - tone_map(theirs)).abs().mean()
    return color + weight * (cover - alpha).square().mean()


def color_change(here: Tensor, there: Tensor, covered: float, step: int) -> Tensor:
    """Return the mean difference of base colours (K, 3) at visible points and beside, at `step` of a pass.

    covered: the share of the frame that shows the surface.
    """
    return min(1.0, step / _RAMP) * covered * (here - there).abs().mean()


def neighbour_difference(maps: Tensor) -> Tensor:
    """Return the mean absolute difference of maps (H, W, C) to the texels beside, plus that to the texels below."""
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
    """Return what materials (N, >= 5), channels as in `material_field`, cost for being unusual.

    decided: whether trials have decided what is metal (`trials.metals`). From then on it costs to be neither
    metal nor none, where before it costs to be metal; what is dark goes on being pulled away from metal. The
    roughness of what is no metal is pulled less by then: its diffuse part tells of the light. A metal that
    may be as sharp as it likes only bends its light.

    Photos under unknown lights leave some things nearly open: a mirror under a free light can imitate any
    shading, and a sharp lobe under a blurred light a wide lobe under a sharp light. A dark metal is no
    mirror. It reflects less than a dielectric, as soot and leather do, which nothing else in the material can
    say, so it has next to no price.
    """
    # Slices would each cost a gradient of the whole.
    red, green, blue, roughness, metallic = material.unbind(1)[:5]
    color = (red + green + blue).detach()
    price = (color / (DARK_METAL * color.mean()).clamp(min=1e-6)).clamp(max=1)
    early, late = (ROUGHNESS_PRIOR, LATE_ROUGHNESS_PRIOR) if config.priors else (0.0, 0.0)
    unusual = (roughness - USUAL_ROUGHNESS).square()
    if decided:
        metal = torch.lerp(metallic, torch.minimum(metallic, 1 - metallic), price)
        pulled = ((late + (early - late) * metallic.detach()) * unusual).mean()
    else:
        metal, pulled = metallic, early * unusual.mean()
    return config.metallic_prior * (price * metal).mean() + pulled


def brightness_anchor(base_color: Tensor, mean: Tensor, config: DecomposeConfig) -> Tensor:
    """Return what a difference between the mean of base colours (N, 3) and the chosen `mean` () costs ().

    The squared logarithm of the ratio, geometric mean over channels; nothing without `config.priors`.
    """
    if not config.priors:
        return mean.new_zeros(())
    return BRIGHTNESS_ANCHOR * (base_color.mean(0).clamp(min=1e-3).log().mean() - mean.log()).square()


def grey_world(base_color: Tensor, cast: Tensor) -> Tensor:
    """Return a loss that moves the mean of base colours (N, 3) along `cast` (3,).

    `cast` is by how much (in logarithms, mean 0) the photos' lights are brighter in a channel than in the
    mean. A light too red is a surface not red enough; over many photos lights are grey (the grey-world
    assumption).
    """
    return -GREY_WORLD * (cast * base_color.mean(0).clamp(min=1e-3).log()).sum()


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
