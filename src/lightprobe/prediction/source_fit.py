"""How bright the suns and lamps of a predicted light are, and where exactly, by the photo's own shadows.

A predicted map is blurred, and shares its light between a lamp and what is around it as the network expects. The photo
decides: it is linear in its light, and a lamp's part of it has the object's own shadows, sharp ones. Per channel,

    minimise  mean_p w_p (sum_k a_k x_k + sum_j b_j y_j - I)^2_p / v  N  +  sum_k (x_k - 1)^2 / s_x^2
              + sum_j (y_j - 1)^2 / s_y^2,    x, y >= 0

a_k is the image of source k as predicted, b_j that of the rest of the light, times the squared component of the
direction along one of the six half axes (these sum to 1). x and y are factors on the prediction; w weighs pixels as in
`prediction.solve`, clipped pixels are one-sided, v is the mean square that no factors explain. Errors of an object are
alike all over a part of it, so all pixels count as only N independent ones. Non-negative least squares.

The key source is also moved: to where the same problem leaves the smallest rest, along a shrinking pattern of six
directions around it, unless that is as good as nothing.

The uncertainty of a source is one standard deviation of its irradiance relative to it, from the inverse Hessian of the
above: large where the photo does not tell the source from the rest, or the object explains the photo badly. That of
its direction comes from how fast the rest grows around the best place.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize
import torch
from torch import Tensor

from lightprobe.core.device import draw_rows, generator
from lightprobe.geometry.mesh import Mesh, face_normals
from lightprobe.kernels import gather_rows
from lightprobe.light import cubemap
from lightprobe.light import prefilter as prefilters
from lightprobe.light.environment import Environment
from lightprobe.light.photometry import beyond_clipping, relative_tone_weight
from lightprobe.light.prefilter import BLOCKS
from lightprobe.light.resize import resize_light
from lightprobe.light.sources import LightSource, SplitLight, split_light
from lightprobe.prediction.observation import Observation
from lightprobe.render.depth_maps import DepthMaps, frames
from lightprobe.render.split_sum import reflectance
from lightprobe.render.transport import Transport

_PIXELS = 3072
_INDEPENDENT = 100.0  # pixels that all pixels together count as
_SOURCE_SPREAD, _REST_SPREAD = 1.0, 0.5  # what is expected of the factors' departure from 1
_ROUNDS = 3  # of clipped pixels and of v
_SHADOW_SIDE = 512  # pixels of a depth map
_RINGS = tuple(math.radians(angle) for angle in (8.0, 4.0, 2.0))  # of directions that are tried
_AROUND = 6  # on each ring
_BETTER = 0.99  # of the mean square error: less is no reason to move
_LEAST_DIRECTION = math.radians(1.0)  # of the uncertainty of any direction


@dataclass(frozen=True)
class _Pixels:
    """The trusted pixels that decide."""

    observation: Observation
    transport: Transport
    maps: DepthMaps
    rows: Tensor  # (P,) of the G-buffer
    diffuse: Tensor  # (P, 3) what is reflected of diffuse light
    color: Tensor  # (P, 3)
    clipped: Tensor  # (P, 3) bool
    weight: Tensor  # (P,), sums to 1
    resolution: int

    @staticmethod
    def of(observation: Observation, mesh: Mesh, resolution: int, seed: int) -> "_Pixels":
        """Return some of the trusted pixels of an observation of the object with this mesh."""
        every = torch.arange(len(observation.rows), device=observation.rows.device)
        chosen = draw_rows(every, _PIXELS, generator(seed, "sources")).to(every.device)
        rows = observation.rows[chosen]
        seen = observation.gbuffer.select(rows)
        outward = torch.nn.functional.normalize(face_normals(mesh.vertices, mesh.faces), dim=1, eps=1e-20)
        maps = DepthMaps.of(mesh.vertices, mesh.faces, seen.position, gather_rows(outward, seen.face), _SHADOW_SIDE)
        color = observation.pixels.color[chosen]
        weight = relative_tone_weight(color, observation.light_level)
        transport = Transport(seen, prefilters.cached(resolution, rows.device))
        return _Pixels(
            replace(observation, gbuffer=seen), transport, maps, rows, reflectance(seen).diffuse, color,
            observation.clipped[chosen], weight / weight.sum(), resolution,
        )  # fmt: skip

    def lit(self, source: LightSource) -> Tensor:
        """Return the image (P, 3) of a source, with sharp shadows where the object casts any."""
        texels = source.texels(self.resolution, self.rows.device)
        image = self.transport.apply(texels)
        gbuffer = self.observation.gbuffer
        if gbuffer.visibility is None:
            return image
        blocks = resize_light(texels, BLOCKS).reshape(-1, 3)
        coarse = gbuffer.visibility.light(blocks, gbuffer.normal)[:, :3]
        towards = torch.tensor(source.direction, device=self.rows.device)
        share = sum(self.maps.visibility(axes)[0] for axes in frames(_disc(towards, source.angular_radius))) / 5
        arriving = (share * (gbuffer.normal @ towards).clamp(min=0))[:, None] * torch.tensor(source.irradiance)
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
    error: float  # weighted mean square of what is not explained, all channels, in units of the photo's
    hessian: np.ndarray  # (3, K + 6, K + 6)


@torch.no_grad()
def fitted_sources(observation: Observation, environment: Environment, mesh: Mesh, seed: int) -> SplitLight:
    """Return a predicted light as its sources, fitted to the photo it was predicted from, and the rest as predicted.

    `mesh`: of the object that `observation` is of. Deterministic; the sources scale with the photo's exposure.
    """
    split = split_light(environment)
    if not split.sources:
        return split
    pixels = _Pixels.of(observation, mesh, environment.resolution, seed)
    rest = pixels.rest(split.rest)
    images = [pixels.lit(source) for source in split.sources]
    solved = _solve(pixels, images + rest)
    key, solved, images, doubt = _moved(pixels, split.sources[0], images, rest, solved)
    sources = [replace(key, direction_uncertainty=doubt), *split.sources[1:]]
    return SplitLight(split.rest, tuple(_scaled(source, solved, k) for k, source in enumerate(sources)))


def _scaled(source: LightSource, solved: _Solution, index: int) -> LightSource:
    """Return source `index` with its factors, and with the deviation of its luma relative to it."""
    factor = solved.factors[:, index]
    deviation = np.sqrt([np.linalg.inv(h)[index, index] for h in solved.hessian])
    share = np.asarray(source.irradiance)
    relative = float((deviation * share).sum() / max((factor * share).sum(), 1e-3 * share.sum()))
    return replace(source.scaled(torch.from_numpy(factor)), uncertainty=relative)


def _moved(
    pixels: _Pixels, key: LightSource, images: list[Tensor], rest: list[Tensor], solved: _Solution
) -> tuple[LightSource, _Solution, list[Tensor], float]:
    """Return the key source where it explains the photo best, all that follows from it, and its direction's doubt."""
    best, errors, begin = (key, images[0], solved), [], solved.error
    for ring in _RINGS:
        tried = []
        for direction in _ring(torch.tensor(best[0].direction, dtype=torch.float64), ring):
            x, y, z = direction.tolist()
            source = replace(key, direction=(x, y, z))
            image = pixels.lit(source)
            tried.append((source, image, _solve(pixels, [image, *images[1:], *rest])))
        errors.append((ring, float(np.mean([one[2].error for one in tried]))))
        nearest = min(tried, key=lambda one: one[2].error)
        if nearest[2].error < best[2].error:
            best = nearest
    if best[2].error > _BETTER * begin:
        best = (key, images[0], solved)
    return best[0], best[2], [best[1], *images[1:]], _direction_doubt(best[2].error, errors)


def _direction_doubt(least: float, errors: list[tuple[float, float]]) -> float:
    """Return the deviation of a direction, in radians, by how the error grows on rings (radius, mean error) around it.

    exp(-N error / (2 least)) is a Gaussian of the direction where the error is a parabola.
    """
    growth = [max(error / max(least, 1e-30) - 1, 1e-4) / ring**2 for ring, error in errors]
    deviation = 1 / math.sqrt(_INDEPENDENT * float(np.median(growth)))
    return float(min(max(deviation, _LEAST_DIRECTION), math.pi / 2))


def _solve(pixels: _Pixels, columns: list[Tensor]) -> _Solution:
    """Return the factors of the images `columns` (P, 3), sources first and the rest's six parts last."""
    matrix = torch.stack(columns, 0).double().cpu().numpy()  # (M, P, 3)
    photo, clipped = pixels.color.double().cpu().numpy(), pixels.clipped
    spread = np.array([_SOURCE_SPREAD] * (len(columns) - 6) + [_REST_SPREAD] * 6)
    weight = np.repeat(pixels.weight.double().cpu().numpy()[:, None], 3, 1)
    factors = np.ones((3, len(columns)))
    error = np.full(3, np.inf)
    hessian = np.zeros((3, len(columns), len(columns)))
    for _ in range(_ROUNDS):
        render = np.einsum("mpc,cm->pc", matrix, factors)
        hidden = beyond_clipping(torch.from_numpy(render), torch.from_numpy(photo), clipped.cpu()).numpy()
        active = np.where(hidden, 0.0, weight)
        error = np.maximum((active * (render - photo) ** 2).sum(0), 1e-8 * (weight * photo**2).sum(0) + 1e-30)
        for c in range(3):
            root = np.sqrt(_INDEPENDENT * active[:, c] / error[c])
            system = np.concatenate([(root * matrix[:, :, c]).T, np.diag(1 / spread)])
            factors[c], _ = scipy.optimize.nnls(system, np.concatenate([root * photo[:, c], 1 / spread]))
            hessian[c] = system.T @ system
    render = np.einsum("mpc,cm->pc", matrix, factors)
    hidden = beyond_clipping(torch.from_numpy(render), torch.from_numpy(photo), clipped.cpu()).numpy()
    return _Solution(factors, float((np.where(hidden, 0.0, weight) * (render - photo) ** 2).sum()), hessian)


def _ring(middle: Tensor, angle: float) -> Tensor:
    """Return `_AROUND` unit directions (N, 3) at `angle` around `middle` (3,)."""
    first, second, axis = frames(middle[None])[0]
    turn = torch.arange(_AROUND, dtype=middle.dtype) * (2 * math.pi / _AROUND)
    across = turn.cos()[:, None] * first + turn.sin()[:, None] * second
    return math.cos(angle) * axis + math.sin(angle) * across


def _disc(towards: Tensor, radius: float) -> Tensor:
    """Return five directions (5, 3) that stand for a disc: its middle, and four at its root mean square radius."""
    first, second, axis = frames(towards[None])[0]
    angle = radius / math.sqrt(2) * math.sqrt(5 / 4)
    across = torch.stack([first, -first, second, -second])
    return torch.cat([axis[None], math.cos(angle) * axis + math.sin(angle) * across])
