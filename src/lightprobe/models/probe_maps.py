"""What one photo says about its light, gathered on the sphere: the input of the sphere network.

Every map lives on a cubemap of 6 x 16 x 16 texels and is relative to the photo's light level s, so that
nothing depends on exposure. Per texel, with `e` against the logarithm of nothing:

    3   log(P0 + e), P0 the stacked average light each pixel saw (Equation 5 with the untrained network's colours)
    3   log(P + e), P the stacked colours of the illumination MLP
    3   stacked: share of clipped pixels, roughness, log of the white-furnace luma
    6   log(max(E, 0) + e) of the coarse least-squares lights of two strengths (`render.coarse_transport`)
    1   log coverage: the mean distribution of the pixels against its mean over the sphere
    3   cosine with up, with the mean view direction, and with what lies to the right of both

Local averages and the global inversion fail in different places; both come with what tells how far to trust
them. The last three say where light tends to come from, in a frame that means the same for every object and
camera.
"""

import torch
from torch import Tensor

from lightprobe.core.config.distillation import AlphaRule
from lightprobe.light import cubemap
from lightprobe.light.photometry import luma, relative_tone_weight
from lightprobe.light.prefilter import BLOCKS
from lightprobe.light.resize import magnify_light
from lightprobe.models.probe_distribution import stack
from lightprobe.models.probe_pixels import ProbePixels
from lightprobe.render.coarse_transport import CoarseTransport

RESOLUTION = 16  # texels along a cubemap edge of what the sphere network sees
STRENGTHS = (0.3, 0.03)  # of the pull of the two coarse lights, strong and weak
CHANNELS = 19  # see `probe_maps`
BLACK = 0.02  # e, relative to the light level
SOLVED_PIXELS = 1024  # that the coarse lights are solved from


def coarse_lights(transport: CoarseTransport, color: Tensor, light_level: Tensor) -> Tensor:
    """Return the coarse lights (2, 384, 3) / `light_level` that explain the pixels' colours (P, 3)."""
    weight = relative_tone_weight(color, light_level)[:, None].expand_as(color)
    return transport.solve(color, weight, light_level, STRENGTHS) / light_level


def probe_maps(
    pixels: ProbePixels,
    colors: Tensor,
    clipped: Tensor,
    light_level: Tensor,
    solved: Tensor,
    up: Tensor,
    rule: AlphaRule,
) -> Tensor:
    """Return the maps (19, 6, 16, 16) of N sampled pixels; no gradient.

    colors (N, 3): the illumination MLP's; clipped (N, 3) bool; solved (2, 384, 3): from `coarse_lights`; up
    (3,) unit.
    """
    directions = cubemap.directions(RESOLUTION, colors.device)
    flat = directions.reshape(-1, 3)
    relative = pixels.color / light_level + BLACK
    whiteness = luma(pixels.furnace)
    kinds = torch.stack([clipped.float().mean(1), pixels.roughness, (whiteness + BLACK).log()], 1)
    seen, weight = stack(pixels, relative / (pixels.furnace + BLACK), flat, rule)
    learned, _ = stack(pixels, colors / light_level, flat, rule)
    what, _ = stack(pixels, kinds, flat, rule)
    mean_weight = cubemap.sphere_mean(weight.reshape(6, RESOLUTION, RESOLUTION))
    coverage = (weight / mean_weight.clamp(min=1e-12) + 1e-3).log()[:, None]
    lights = [magnify_light(one.reshape(6, BLOCKS, BLOCKS, 3), RESOLUTION).reshape(-1, 3) for one in solved]
    view = torch.nn.functional.normalize(pixels.view.mean(0), dim=0)
    right = torch.nn.functional.normalize(torch.linalg.cross(up, view), dim=0, eps=1e-6)
    frame = torch.stack([up, view, right], 1)
    logs = [(part.clamp(min=0) + BLACK).log() for part in (seen, learned)]
    logs += [(part.clamp(min=0) + BLACK).log() for part in lights]
    maps = torch.cat([*logs[:2], what, *logs[2:], coverage, flat @ frame], 1)
    return maps.T.reshape(CHANNELS, 6, RESOLUTION, RESOLUTION).contiguous()


def turned(maps: Tensor, turn: Tensor) -> Tensor:
    """Return the maps (B, 19, 6, 16, 16) of the same photos with the world turned or mirrored.

    turn (B,) int64 chooses among `cubemap.symmetries`.
    """
    index, handedness = (part[turn] for part in cubemap.symmetries(RESOLUTION, maps.device))
    flat = maps.flatten(2)
    flat = flat.gather(2, index[:, None].expand_as(flat))
    flat[:, -1] *= handedness[:, None]  # what was right of up and view is left of both in a mirror
    return flat.view_as(maps)
