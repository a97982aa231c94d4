"""How bright the suns and lamps of a predicted light are, and where exactly, by the photo's own shadows.

The photo is linear in its light, and a source's part of it has the object's own shadows, sharp ones. Per
channel,

    minimise  mean_p w_p (sum_k a_k x_k + sum_j b_j y_j - I)^2_p N / v  +  sum_k (x_k - 1)^2 / s_x^2
              + sum_j (y_j - 1)^2 / s_y^2,    x, y >= 0

a_k is the image of source k as predicted, b_j that of the rest of the light, times the squared component of
the direction along one of the six half axes (these sum to 1). x and y are factors on the prediction; v is the
mean square that no factors explain. Errors of an object are alike all over a part of it, so all pixels count
as only N independent ones. Clipped pixels are one-sided. Iteratively reweighted non-negative least squares:
the weights w make the sum one of absolute displayed errors, at the render's brightness. Plain squares,
weighted by the photo's brightness, let the errors of normals and roughness dim the sources by a third
(docs/decisions/key-lights.md).

The key source is moved as well, to where N ln(error there / error here) says more than its distance in units
of the deviation that predicted directions have.

The uncertainty of a source is one standard deviation of its irradiance relative to it. It has two parts: that
of the fit, from its inverse Hessian, and the deviation of fitted key lights from true ones where the object
is a reconstructed one, as a photo cannot tell what its object gets wrong. The uncertainty of a direction has
the same two parts.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from lightprobe.geometry.mesh import Mesh, face_normals
from lightprobe.kernels import gather_rows
from lightprobe.light import cubemap
from lightprobe.light import prefilter as prefilters
from lightprobe.light.environment import Environment
from lightprobe.light.photometry import beyond_clipping, exposure_unit, one_sided_residual, tone_slope
from lightprobe.light.prefilter import BLOCKS, DRAFT
from lightprobe.light.resize import resize_light
from lightprobe.light.sources import LightSource, SplitLight, split_light
from lightprobe.prediction.observation import Observation
from lightprobe.render.depth_maps import DepthMaps, frames
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import reflectance
from lightprobe.render.transport import Transport

_PIXELS = 1536  # of the photo, at most
_INDEPENDENT = 20.0  # pixels that all pixels together count as
_SOURCE_SPREAD, _REST_SPREAD = 0.4, 0.1  # what is expected of the factors' departure from 1
_ROUNDS = 4  # of weights, clipped pixels and v
_SEARCH_ROUNDS = 2  # the same while the key source is looked for
_FLOOR = 0.005  # displayed error below which all pixels count alike
_SHADOW_SIDE = 256  # pixels of a depth map
_DRAFTED = 32  # texels along a cubemap edge up to which the refinement's prefilter, already there, does
_RINGS = tuple(math.radians(angle) for angle in (8.0, 4.0, 2.0))  # of directions that are tried
_AROUND = 6  # on each ring
_TINY = 1e-12  # relative; what is smaller is rounding
_BLACK = 1e-3  # of the predicted irradiance: a source with less is not there; least base of a deviation
# Deviations of fitted key lights from true ones, relative and in radians, see docs/decisions/key-lights.md
_USUAL_ERROR, _USUAL_TURN = 0.65, math.radians(4)


@dataclass(frozen=True)
class _Pixels:
    """The trusted pixels that decide."""

    gbuffer: GBuffer
    transport: Transport
    maps: DepthMaps
    diffuse: Tensor  # (P, 3) what is reflected of diffuse light
    color: Tensor  # (P, 3)
    clipped: Tensor  # (P, 3) bool
    resolution: int

    @staticmethod
    def of(observation: Observation, mesh: Mesh, resolution: int, seed: int) -> "_Pixels":
        """Return some of the trusted pixels of an observation of the object with this mesh."""
        device = observation.rows.device
        chosen = observation.drawn(_PIXELS, seed, "sources").to(device)
        seen = observation.gbuffer.select(observation.rows[chosen])
        outward = torch.nn.functional.normalize(face_normals(mesh.vertices, mesh.faces), dim=1, eps=1e-20)
        facing = gather_rows(outward, seen.face)
        maps = DepthMaps.of(mesh.vertices, mesh.faces, seen.position, facing, _SHADOW_SIDE)
        accuracy = DRAFT if resolution <= _DRAFTED else None
        transport = Transport(seen, prefilters.cached(resolution, device, accuracy))
        color, clipped = observation.pixels.color[chosen], observation.clipped[chosen]
        return _Pixels(seen, transport, maps, reflectance(seen).diffuse, color, clipped, resolution)

    def lit(self, source: LightSource, *, as_point: bool = False) -> Tensor:
        """Return the image (P, 3) of a source, with the shadows that its disc casts, or its middle alone."""
        gbuffer, device = self.gbuffer, self.color.device
        texels = source.texels(self.resolution, device)
        image = self.transport.apply(texels)
        if gbuffer.visibility is None:
            return image
        blocks = resize_light(texels, BLOCKS).reshape(-1, 3)
        coarse = gbuffer.visibility.light(blocks, gbuffer.normal)[:, :3]
        towards = torch.tensor(source.direction, device=device)
        directions = towards[None] if as_point else _disc(towards, source.angular_radius)
        share = sum(self.maps.visibility(axes)[0] for axes in frames(directions)) / len(directions)
        irradiance = torch.tensor(source.irradiance, device=device)
        arriving = (share * (gbuffer.normal @ towards).clamp(min=0))[:, None] * irradiance
        return (image + self.diffuse * (arriving.to(coarse) / math.pi - coarse)).clamp(min=0)

    def rest(self, light: Environment) -> list[Tensor]:
        """Return the images (P, 3) of the six parts of a light."""
        axis = cubemap.directions(light.resolution, light.device)
        parts = [(sign * axis[..., i]).clamp(min=0).square() for i in range(3) for sign in (1, -1)]
        return [self.transport.apply(light.texels * part[..., None]) for part in parts]


@dataclass(frozen=True)
class _Solution:
    """Factors of the K sources and the rest's parts, per channel."""

    factors: np.ndarray  # (3, K + 6)
    error: float  # mean square of what is not explained, displayed
    deviation: np.ndarray  # (3, K + 6) of the factors


@torch.no_grad()
def fitted_sources(observation: Observation, environment: Environment, mesh: Mesh, seed: int) -> SplitLight:
    """Return a predicted light as its sources, fitted to the photo, and the rest as predicted.

    A source that the photo shows nothing of is left out; only the strongest has a doubt about its direction.
    `mesh`: of the object that `observation` is of. Deterministic; the sources scale with the photo's
    exposure.
    """
    split = split_light(environment)
    if not split.sources:
        return split
    pixels = _Pixels.of(observation, mesh, environment.resolution, seed)
    rest = pixels.rest(split.rest)
    weaker = split.sources[1:]
    others = [pixels.lit(source) for source in weaker] + rest
    key, doubt = _moved(pixels, split.sources[0], others)
    solved = _solve(pixels, [pixels.lit(key), *others])
    predicted = [replace(key, direction_uncertainty=doubt), *weaker]
    fitted = [(source, _scaled(source, solved, k)) for k, source in enumerate(predicted)]
    present = [now for before, now in fitted if sum(now.irradiance) > _BLACK * sum(before.irradiance)]
    return SplitLight(split.rest, tuple(sorted(present, key=lambda source: -sum(source.irradiance))))


def _scaled(source: LightSource, solved: _Solution, index: int) -> LightSource:
    """Return source `index` with its factors, and with the deviation of its luma relative to it."""
    factor = solved.factors[:, index]
    share = np.asarray(source.irradiance)
    least = _BLACK * share.sum()
    relative = float((solved.deviation[:, index] * share).sum() / max((factor * share).sum(), least, 1e-30))
    return replace(source.scaled(torch.from_numpy(factor)), uncertainty=math.hypot(relative, _USUAL_ERROR))


def _moved(pixels: _Pixels, key: LightSource, others: list[Tensor]) -> tuple[LightSource, float]:
    """Return the key source where it explains the photo best beside `others`, and its direction's doubt.

    During the search the source throws the shadows of a point: a fifth of the depth maps.
    """

    def error(source: LightSource) -> float:
        return _solve(pixels, [pixels.lit(source, as_point=True), *others], _SEARCH_ROUNDS).error

    best, errors = (key, error(key)), []

    def gain(turned: LightSource, found: float) -> float:
        apart = math.acos(min(1.0, sum(a * b for a, b in zip(turned.direction, key.direction, strict=True))))
        return -_INDEPENDENT * math.log(found) - (apart / _USUAL_TURN) ** 2

    for ring in _RINGS:
        tried = []
        for direction in _ring(torch.tensor(best[0].direction, dtype=torch.float64), ring):
            x, y, z = direction.tolist()
            source = replace(key, direction=(x, y, z))
            tried.append((source, error(source)))
        errors.append((ring, float(np.mean([found for _, found in tried]))))
        best = max([best, *tried], key=lambda one: gain(*one))
    return best[0], _direction_doubt(best[1], errors)


def _direction_doubt(least: float, errors: list[tuple[float, float]]) -> float:
    """Return a direction's deviation in radians by the `errors` (radius, mean error) on rings around it.

    exp(-N error / (2 least)) is a Gaussian of the direction where the error is a parabola.
    """
    growth = [max(error / least - 1, 1e-4) / ring**2 for ring, error in errors]
    return min(math.hypot(1 / math.sqrt(_INDEPENDENT * float(np.median(growth))), _USUAL_TURN), math.pi / 2)


def _solve(pixels: _Pixels, columns: list[Tensor], rounds: int = _ROUNDS) -> _Solution:
    """Return the factors of the images `columns` (P, 3), sources first and the rest's six parts last."""
    matrix = torch.stack(columns, 0).double().permute(2, 1, 0)  # (3, P, M)
    photo, clipped = pixels.color.double(), pixels.clipped
    unit = exposure_unit(photo)
    spread = matrix.new_tensor([_SOURCE_SPREAD] * (len(columns) - 6) + [_REST_SPREAD] * 6)
    factors = matrix.new_ones(3, len(columns))
    for _ in range(rounds):
        render = (matrix @ factors[..., None])[..., 0].T
        slope, residual = tone_slope(render / unit), one_sided_residual(render, photo, clipped) / unit
        weight = slope.square() / (slope * residual.abs() + _FLOOR)
        weight = torch.where(beyond_clipping(render, photo, clipped), 0.0, weight)
        weight = weight / weight.sum(0).clamp(min=1e-30)
        noise = (weight * residual.square()).sum(0).clamp(min=1e-8) * unit**2  # (3,)
        pull = (_INDEPENDENT * weight / noise).T[..., None]  # (3, P, 1)
        hessian = matrix.mT @ (pull * matrix) + torch.diag(spread**-2)
        right = (matrix.mT @ (pull * photo.T[..., None]))[..., 0] + spread**-2
        factors = torch.stack([_non_negative(h, r) for h, r in zip(hessian, right, strict=True)])
    deviation = torch.linalg.inv(hessian).diagonal(dim1=1, dim2=2).sqrt()
    render = (matrix @ factors[..., None])[..., 0].T
    shown = tone_slope(render / unit) * one_sided_residual(render, photo, clipped) / unit
    error = float(shown.square().mean().clamp(min=1e-8))
    return _Solution(factors.cpu().numpy(), error, deviation.cpu().numpy())


def _non_negative(hessian: Tensor, right: Tensor) -> Tensor:
    """Return x >= 0 (M,) that minimises x^T H x / 2 - x^T r for a positive definite H (M, M).

    The active set of Lawson and Hanson on the normal equations (Bro and de Jong 1997). SciPy's has to load
    all of `scipy.optimize`, a fifth of a second of the first prediction of a process.
    """
    h, r = hessian.cpu().double().numpy(), right.cpu().double().numpy()
    x = np.linalg.solve(h, r)
    if (x >= 0).all():  # mostly
        return torch.from_numpy(x).to(hessian)
    x, free = np.zeros(len(r)), np.zeros(len(r), bool)
    for _ in range(3 * len(r)):  # rounding could send it in circles
        downhill = np.where(free, 0.0, r - h @ x)
        if downhill.max() <= _TINY * np.abs(r).max():
            break
        free[downhill.argmax()] = True
        wanted = _free_minimum(h, r, free)
        while (
            wanted[free] <= 0
        ).any():  # back to where the first meets its bound, which holds it from then on
            low = free & (wanted <= 0)
            x += (x[low] / (x[low] - wanted[low])).min() * (wanted - x)
            free &= x > _TINY * x.max()
            x[~free] = 0
            wanted = _free_minimum(h, r, free)
        x = wanted
    return torch.from_numpy(x).to(hessian)


def _free_minimum(h: np.ndarray, r: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return the minimiser (M,) over the values that are `free` (M,) bool, the others being 0."""
    x = np.zeros(len(r))
    x[free] = np.linalg.solve(h[np.ix_(free, free)], r[free])
    return x


def _ring(middle: Tensor, angle: float) -> Tensor:
    """Return `_AROUND` unit directions (N, 3) at `angle` around `middle` (3,)."""
    first, second, axis = frames(middle[None])[0]
    turn = torch.arange(_AROUND, dtype=middle.dtype) * (2 * math.pi / _AROUND)
    across = turn.cos()[:, None] * first + turn.sin()[:, None] * second
    return math.cos(angle) * axis + math.sin(angle) * across


def _disc(towards: Tensor, radius: float) -> Tensor:
    """Return five directions (5, 3) for a disc: its middle, and four at its root mean square radius."""
    first, second, axis = frames(towards[None])[0]
    angle = radius / math.sqrt(2) * math.sqrt(5 / 4)
    across = torch.stack([first, -first, second, -second])
    return torch.cat([axis[None], math.cos(angle) * axis + math.sin(angle) * across])
