"""The three-sphere protocol: how well a light lights a diffuse, a matte and a mirror sphere.

Maps (H, 2H, 3) are equirectangular as in `light.equirect`. Each is tone-mapped first: x^(1/2.4), then scaled
so that the median of its own positive values is .5; nothing is cut off. The spheres are seen from the photo's
camera, from afar (parallel rays, v the same for every pixel), and compared over their discs.

Notation: n the normal of a disc's pixel, l a direction of the map, w its solid angle, h the half vector of l
and v.

    diffuse  sum_l w (n.l) T(l) / pi            white, Lambertian
    matte    sum_l w D (n.l) T(l) / sum_l w D (n.l)    GGX of roughness .369 (alpha = r^2), reflecting all it receives
    mirror   T(2 (n.v) n - v)

A mirror sphere seen from afar shows every direction on the same area of its disc, so its scores are taken
over the texels of the map by solid angle: exact, where a raster of the disc would hit or miss the sun.

Each error is over pixels p and colour channels c, the squared error summed over c and averaged over p:

    si_rmse   after the one factor that fits prediction to truth best
    angular   the mean angle in degrees between RGB vectors
    n_rmse    after scaling both so that their own .1 and 99.9 percentiles become 0 and 1
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from lightprobe.light import equirect

ROUGHNESS = 0.369  # of the matte sphere
GAMMA, MIDDLE = 2.4, 0.5  # of its tone curve, and where the median goes
HEIGHT = 128  # rows of the maps compared; smaller truths stay as they are
_LOBE_HEIGHT = 32  # rows of the maps that light the two rough spheres
_SIDE = 32  # pixels across the disc of the rough ones
_PERCENTILES = (0.1, 99.9)  # that n_rmse scales to 0 and 1
_FLAT = 3e-3  # of its brightness: a smaller range is taken for none
_TINY = 1e-12  # keeps a division by nothing finite

SPHERES = ("diffuse", "matte", "mirror")


@dataclass(frozen=True)
class Disc:
    """The pixels of one sphere."""

    values: Tensor  # (P, 3)
    weight: Tensor  # (P,) share of the disc; sums to 1


class ThreeSpheres:
    """Three spheres seen from one direction; holds what of their lighting does not depend on the map."""

    def __init__(self, view: Tensor, up: Tensor, side: int = _SIDE):
        """Take the unit direction `view` (3,) from object to camera, and the picture's up direction (3,).

        side: pixels across the discs of the rough spheres.
        """
        self.frame = _frame(view.double(), up.double())  # (3, 3) rows right, up, towards the camera
        local, self.inside = _disc_normals(side)
        self.normals = (local @ self.frame).float()
        self.view = self.frame[2].float()
        directions = equirect.directions(_LOBE_HEIGHT).reshape(-1, 3)
        solid = equirect.solid_angles(_LOBE_HEIGHT).reshape(-1)
        cosine = (self.normals @ directions.T).clamp_(min=0)
        half = (2 + 2 * directions @ self.view).clamp(min=_TINY).rsqrt()
        nh = (self.normals @ directions.T + (self.normals @ self.view)[:, None]) * half
        alpha2 = ROUGHNESS**4
        lobe = (nh.square_().mul_(alpha2 - 1).add_(1)).square_().reciprocal_().mul_(cosine).mul_(solid)
        self._matte = lobe / lobe.sum(1, keepdim=True)
        self._diffuse = cosine * (solid / math.pi)

    def light(self, map: Tensor) -> dict[str, Disc]:
        """Return the discs, by the names in `SPHERES`, under a linear map (H, 2H, 3), reduced to 128 rows."""
        tone_mapped = balanced(reduced(map.cpu().float(), HEIGHT))
        height = tone_mapped.shape[0]
        if height >= _LOBE_HEIGHT:
            coarse = reduced(tone_mapped, _LOBE_HEIGHT).reshape(-1, 3)
        else:
            coarse = equirect.sample(tone_mapped, equirect.directions(_LOBE_HEIGHT).reshape(-1, 3))
        even = torch.full((len(self.normals),), 1 / len(self.normals))
        texels = Disc(tone_mapped.reshape(-1, 3), equirect.solid_angles(height).reshape(-1) / (4 * math.pi))
        diffuse, matte = Disc(self._diffuse @ coarse, even), Disc(self._matte @ coarse, even)
        return dict(zip(SPHERES, (diffuse, matte, texels), strict=True))

    def picture(self, map: Tensor, mirror_side: int = 128) -> Tensor:
        """Return the three spheres side by side on black, (S, 3 S, 3), S = `mirror_side`, under a map.

        The map is tone-mapped as for the scores; what exceeds 1 is cut off only by the display.
        """
        tone_mapped = balanced(reduced(map.cpu().float(), HEIGHT))
        discs = self.light(map)
        local, inside = _disc_normals(mirror_side)
        normals = (local @ self.frame).float()
        mirrored = 2 * (normals @ self.view)[:, None] * normals - self.view
        frames = [torch.zeros(mirror_side, mirror_side, 3)]
        frames[0][inside] = equirect.sample(tone_mapped, mirrored)
        for name in ("matte", "diffuse"):
            small = torch.zeros(*self.inside.shape, 3)
            small[self.inside] = discs[name].values
            frames.insert(0, _enlarged(small, self.inside, mirror_side) * inside[..., None])
        return torch.cat(frames, 1)


def sphere_scores(mine: dict[str, Disc], true: dict[str, Disc]) -> dict[str, float]:
    """Return the errors of one map's discs against the true map's, as `<sphere>_<error>`.

    Errors that are not defined for a black map are nan.
    """
    scores = {}
    for name in SPHERES:
        a, b, weight = mine[name].values.double(), true[name].values.double(), true[name].weight.double()
        scores[f"{name}_si_rmse"] = si_rmse(a, b, weight)
        scores[f"{name}_angular"] = angular_error(a, b, weight)
        scores[f"{name}_n_rmse"] = n_rmse(a, b, weight)
    return scores


def balanced(map: Tensor) -> Tensor:
    """Return the linear map (H, 2H, 3) tone-mapped: x^(1/2.4), the median of its positive values at .5."""
    bent = map.clamp(min=0) ** (1 / GAMMA)
    positive = bent[bent > 0].numpy()
    return bent if len(positive) == 0 else MIDDLE / float(np.median(positive)) * bent


def si_rmse(values: Tensor, true: Tensor, weight: Tensor) -> float:
    """Return the scale-invariant error of (P, 3) under weights (P,) that sum to 1."""
    share = weight[:, None]
    scale = (share * values * true).sum() / (share * values * values).sum().clamp(min=_TINY)
    return math.sqrt(float((share * (scale * values - true) ** 2).sum()))


def angular_error(values: Tensor, true: Tensor, weight: Tensor) -> float:
    """Return the mean angle in degrees between colours (P, 3); black ones, without hue, do not count."""
    size = torch.linalg.cross(values, true).norm(dim=1)
    angle = torch.rad2deg(torch.atan2(size, (values * true).sum(1)))
    weight = weight * (values.norm(dim=1) > 0) * (true.norm(dim=1) > 0)
    return float((weight * angle).sum() / weight.sum())


def n_rmse(values: Tensor, true: Tensor, weight: Tensor) -> float:
    """Return the error of (P, 3) after scaling each by its own .1 and 99.9 percentiles over all channels."""
    a, b = (_unit_range(part, weight) for part in (values, true))
    return math.sqrt(float((weight[:, None] * (a - b) ** 2).sum()))


def reduced(map: Tensor, height: int) -> Tensor:
    """Return the map (H, 2H, 3) averaged by solid angle to `height` rows, or as it is if not larger."""
    if map.shape[0] <= height:
        return map
    if map.shape[0] % height:  # an odd size: to the next multiple first, smoothly
        rows = height * math.ceil(map.shape[0] / height)
        map = equirect.sample(map, equirect.directions(rows).reshape(-1, 3)).reshape(rows, 2 * rows, 3)
    factor = map.shape[0] // height
    weight = equirect.solid_angles(map.shape[0]).to(map)[..., None]
    blocks = (height, factor, 2 * height, factor)
    return (map * weight).reshape(*blocks, 3).sum((1, 3)) / weight.reshape(*blocks, 1).sum((1, 3))


def _unit_range(values: Tensor, weight: Tensor) -> Tensor:
    flat, order = values.reshape(-1), np.argsort(values.reshape(-1).numpy())
    reached = np.cumsum(weight[:, None].expand_as(values).reshape(-1).numpy()[order])
    places = np.searchsorted(reached, [share / 100 * reached[-1] for share in _PERCENTILES])
    low, high = (float(flat[order[min(place, len(order) - 1)]]) for place in places)
    # A sphere of one brightness has only the range of quadrature and rounding, which machines differ in.
    if high - low <= max(_FLAT * abs(high), _TINY):
        return torch.zeros_like(values)
    return (values - low) / (high - low)


def _frame(view: Tensor, up: Tensor) -> Tensor:
    """Return the axes (3, 3) right, up and towards the camera."""
    back = view / view.norm()
    right = torch.linalg.cross(up, back)
    if float(right.norm()) < 1e-6:
        right = torch.linalg.cross(torch.eye(3, dtype=up.dtype)[int(back.abs().argmin())], back)
    right = right / right.norm()
    return torch.stack([right, torch.linalg.cross(back, right), back])


def _disc_normals(side: int) -> tuple[Tensor, Tensor]:
    """Return normals (P, 3) float64, in the camera's axes, of a disc's pixels, and the disc (side, side)."""
    centres = (torch.arange(side, dtype=torch.float64) + 0.5) * (2 / side) - 1
    y, x = torch.meshgrid(-centres, centres, indexing="ij")
    under_root = 1 - x * x - y * y
    inside = under_root > 0
    return torch.stack([x, y, under_root.clamp(min=0).sqrt()], -1)[inside], inside


def _enlarged(small: Tensor, inside: Tensor, side: int) -> Tensor:
    """Return a disc's picture (s, s, 3) at (side, side, 3), its rim continued outwards, none of it dark."""
    planes = torch.cat([small * inside[..., None], inside[..., None].to(small)], -1).permute(2, 0, 1)[None]
    spread = torch.nn.functional.avg_pool2d(planes, 3, stride=1, padding=1)
    filled = torch.where(inside, planes[:, :3], spread[:, :3] / spread[:, 3:].clamp(min=_TINY))
    large = torch.nn.functional.interpolate(filled, (side, side), mode="bilinear", align_corners=False)
    return large[0].permute(1, 2, 0)
