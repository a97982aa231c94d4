"""The environments of the training photos while the asset is still changing.

With geometry and material held, a photo is linear in its light. So each visit can solve for the light in
closed form (`LightUpdate.SOLVE`) instead of taking one gradient step (`LightUpdate.GRADIENT`, the paper).

Photos of one place (`Photo.light_group`) were taken under one light, up to exposure and white balance. What one of them
does not show of it, the others may: a light is pulled to the mean of the others'. What stands close by, the table above
all, is seen at another place in the mirror of another view. Where its plane is known (`View.support`), it is looked up
where the mirror's ray meets it, and the lights of a place are all but one; else they are pulled where their pixels do not
pin them, no more. And what a photo shows of its support beside the object is that part of its light, in its exposure.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig, LightUpdate
from lightprobe.core.device import generator, to_device
from lightprobe.light import prefilter as prefilters
from lightprobe.light.photometry import tone_weight
from lightprobe.light.resize import magnify_light
from lightprobe.reconstruction.photos import Target
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.refit import refit_contrast
from lightprobe.render.seen_light import SeenLight
from lightprobe.render.transport import Transport, solve_light
from lightprobe.training import ParameterGroup
from lightprobe.training.recording import CudaRecorder, RecordedStep, recorder_for

# Of solved lights while the asset changes, as too smooth a light asks for too glossy a surface; and of held-out
# photos' lights and those that are kept.
REGULARISATION, FINAL_REGULARISATION = 0.001, 0.003
# Of both, of a light that other photos show as well, with what is near at its distance and without.
SUPPORTED_REGULARISATION, SHARED_REGULARISATION = 0.2, 0.01
SEEN_REGULARISATION = 0.1  # beside these, of a light where its photo shows it
GREY = 0.005  # weight of the deviation from grey of a light that is fitted by gradients; nvdiffrec's
_ITERATIONS = 5  # of a solve, which starts from the light of the previous visit
_RATE = 0.005  # Adam step of a light that is fitted by gradients (paper, 4.2)
_DARKEST = 1e-6  # mean radiance that a light is compared with at least


@dataclass(frozen=True)
class LightPull:
    """What else is known of the light of a photo than what its pixels of the object tell."""

    shape: Tensor | None = None  # (6, R, R, 3), of mean 1: the light in the photos of the same place
    seen: SeenLight | None = None  # what the photo shows of the support

    def tensors(self) -> tuple[Tensor, ...]:
        """Return what is held, each (6, R, R) or (6, R, R, 3), as `holding` takes it."""
        seen = () if self.seen is None else (self.seen.radiance, self.seen.share, self.seen.clipped)
        return seen if self.shape is None else (self.shape, *seen)

    def holding(self, tensors: Sequence[Tensor]) -> "LightPull":
        """Return a pull of the same kind that has other `tensors` (6, R, R, ...)."""
        first = int(self.shape is not None)
        shape, seen = (tensors[0] if first else None), tensors[first:]
        return LightPull(shape, SeenLight(*seen) if seen else None)

    def magnified(self, resolution: int) -> "LightPull":
        """Return the pull of a light of a finer resolution."""
        shape = None if self.shape is None else magnify_light(self.shape, resolution)
        return LightPull(shape, None if self.seen is None else self.seen.resized(resolution))

    def prior(
        self, light: Tensor, regularisation: float, *, supported: bool
    ) -> tuple[Tensor, Tensor | float]:
        """Return what a light that is now `light` (6, R, R, 3) is pulled to, and with which weight, (6, R, R, 3) or one.

        regularisation: of a light that is pulled to its mean colour, as no other photo shows it; supported: whether
        what is near is looked up at its distance.
        """
        prior, weight = light.mean((0, 1, 2)).expand_as(light), regularisation
        if self.shape is not None:
            prior, weight = (
                prior * self.shape,
                SUPPORTED_REGULARISATION if supported else SHARED_REGULARISATION,
            )
        if self.seen is None:
            return prior, weight
        satisfied = self.seen.clipped & (light >= self.seen.radiance)
        held = SEEN_REGULARISATION * self.seen.share[..., None] * ~satisfied
        return (weight * prior + held * self.seen.radiance) / (weight + held), weight + held


NO_PULL = LightPull()


def solve_target_light(
    observed: Tensor,
    clipped: Tensor,
    gbuffer: GBuffer,
    start: Tensor,
    rows: Tensor | None,
    config: DecomposeConfig,
    times: int = 1,
    *,
    regularisation: float = REGULARISATION,
    pull: LightPull = NO_PULL,
) -> Tensor:
    """Return the light (6, R, R, 3) that explains the pixels `rows` (K,) of the G-buffer, or all, best.

    observed (K, 3): their linear colours; clipped (K, 3) bool: where these are only bounds from below. The
    light is solved `times` times, first from `start`, then from the last light. Places that the pixels do not
    pin are pulled towards the mean colour of the light that a solve starts from, with the weight
    `regularisation`, or towards what `pull` tells of the light.

    Pixels weigh as tone mapping has it, by the brighter of their photo and of what the last light shows
    there: what either takes for a highlight weighs little (docs/decisions/light-weights.md).
    """
    transport = Transport(gbuffer, prefilters.cached(start.shape[1], start.device), rows, often=True)
    supported = gbuffer.support is not None
    return solve_through(
        transport,
        observed,
        clipped,
        start,
        config,
        times,
        regularisation=regularisation,
        pull=pull,
        supported=supported,
    )


def solve_through(
    transport: Transport,
    observed: Tensor,
    clipped: Tensor,
    start: Tensor,
    config: DecomposeConfig,
    times: int,
    *,
    regularisation: float = REGULARISATION,
    pull: LightPull = NO_PULL,
    supported: bool = False,
) -> Tensor:
    """Return what `solve_target_light` does for the K pixels of a transport; supported: as in `LightPull.prior`."""
    light = start
    for _ in range(times):
        last = transport.lit(light)
        weight = tone_weight(torch.maximum(observed.mean(1), last.radiance.mean(1)))
        prior, stiffness = pull.prior(light, regularisation, supported=supported)
        solved = solve_light(
            transport,
            observed,
            weight,
            clipped,
            prior,
            regularisation=stiffness,
            iterations=_ITERATIONS,
            start=last,
            chroma=config.light_chroma,
        )
        light = refit_contrast(transport, solved, observed, clipped)
    return light


class LightSolver:
    """`solve_target_light` from up to `pixels` pixels of a photo, recorded on a GPU: many small operators.

    The record holds for a surface of one number of vertices. It reads `pixels` pixels, so that on a GPU the
    pixels of a photo that has fewer count as often as it takes.
    """

    def __init__(self, config: DecomposeConfig, device: torch.device, pixels: int):
        """Solve lights on `device`."""
        self._config, self._device, self._pixels = config, device, pixels
        self._vertices = -1  # of the surface seen last
        self._recorder: CudaRecorder | None = None
        self._solves: dict[tuple[bool, bool], RecordedStep] = {}  # by what pulls the light

    @torch.no_grad()
    def __call__(
        self,
        observed: Tensor,
        clipped: Tensor,
        gbuffer: GBuffer,
        rows: Tensor,
        start: Tensor,
        pull: LightPull = NO_PULL,
    ) -> Tensor:
        """Return the light from `start` (6, R, R, 3) that explains the rows (K,) int64, K > 0, best.

        observed (P, 3), clipped (P, 3) bool: as in `solve_target_light`, of all pixels of the G-buffer. pull: as there.
        """
        vertices = 0 if gbuffer.visibility is None else len(gbuffer.visibility.vertices.unoccluded)
        if vertices != self._vertices:  # the old record would never fit again
            self._vertices, self._recorder, self._solves = vertices, recorder_for(self._device), {}
        if self._recorder is not None:
            count = max(self._pixels, len(rows))
            rows = rows[torch.arange(count, device=rows.device) * len(rows) // count]
        part = gbuffer.select(rows)
        kind = pull.shape is None, pull.seen is None
        if kind not in self._solves:
            self._solves[kind] = RecordedStep(self._step(part, pull), self._recorder)
        return self._solves[kind](observed[rows], clipped[rows], start, *pull.tensors(), *part.tensors())

    def _step(self, like: GBuffer, pull: LightPull) -> Callable[..., Tensor]:
        first = len(pull.tensors())  # of the G-buffer's

        def step(observed: Tensor, clipped: Tensor, start: Tensor, *tensors: Tensor) -> Tensor:
            seen, known = like.holding(tensors[first:]), pull.holding(tensors[:first])
            return solve_target_light(observed, clipped, seen, start, None, self._config, pull=known)

        return step


def mean_shape(others: Sequence[Tensor]) -> Tensor | None:
    """Return the mean of lights (6, R, R, 3) of one place, each over its own mean colour; None for none."""
    if not others:
        return None
    return torch.stack([light / light.mean((0, 1, 2)).clamp(min=_DARKEST) for light in others]).mean(0)


class Lights:
    """One cubemap (6, R, R, 3) per training photo; separate tensors: Adam leaves unvisited lights alone."""

    def __init__(
        self,
        names: list[str],
        config: DecomposeConfig,
        device: torch.device,
        seed: int,
        groups: Sequence[str | None] = (),
        seen: Mapping[str, SeenLight] | None = None,
    ):
        """Start with grey lights of the photos `names`.

        groups: what each shares its light by; without: none does. seen: what photos show of their lights.
        """
        self.index = {name: i for i, name in enumerate(names)}
        self._groups = dict(zip(names, groups, strict=False))
        self._seen = {name: light.resized(config.light_resolution) for name, light in (seen or {}).items()}
        self.config = config
        self.seed = seed
        resolution = config.light_resolution
        self.gradient = config.light_update is LightUpdate.GRADIENT
        shape = (6, resolution, resolution, 3)
        self.maps = [torch.full(shape, 0.5, device=device, requires_grad=self.gradient) for _ in names]
        self.prefilter = prefilters.cached(resolution, device)
        self._solver = LightSolver(config, device, config.light_solve_pixels)

    def rows(self, target: Target, gbuffer: GBuffer, step: int, count: int) -> Tensor:
        """Return up to `count` distinct rows (K,) int64 of the G-buffer that lie inside the mask, at random."""
        inside = target.inside(gbuffer.pixel)
        draw = torch.randperm(len(inside), generator=generator(self.seed, f"rows/{target.name}", step))
        return inside[to_device(draw[:count], inside.device)]

    def levels(self, target: Target, gbuffer: GBuffer, step: int) -> tuple[Tensor, Tensor]:
        """Return the prefiltered light (T, 3) of the photo for this step, and its regularisation loss ()."""
        row = self.index[target.name]
        if self.gradient:
            return self.prefilter.apply(self.maps[row]), self.grey_cost(row)
        rows = self.rows(target, gbuffer, step, self.config.light_solve_pixels)
        if len(rows) > 0:
            observed, clipped = target.color[gbuffer.pixel], target.clipped[gbuffer.pixel]
            pull = self.pull(target.name)
            self.maps[row] = self._solver(observed, clipped, gbuffer, rows, self.maps[row], pull)
        return self.prefilter.apply(self.maps[row]), self.grey_cost(row)

    def pull(self, name: str, lights: Mapping[str, Tensor] | None = None) -> LightPull:
        """Return what else is known of the light of a photo; `lights` of some photos stand for the present ones."""
        return LightPull(self.shape_of(name, self._groups.get(name), lights), self._seen.get(name))

    def shape_of(
        self, name: str, group: str | None, lights: Mapping[str, Tensor] | None = None
    ) -> Tensor | None:
        """Return the light in other photos of the group of photo `name`, held out or not, as in `LightPull.shape`.

        lights: as in `pull`.
        """
        if group is None:
            return None
        known = lights or {other: self.maps[row] for other, row in self.index.items()}
        return mean_shape(
            [light for other, light in known.items() if self._groups.get(other) == group and other != name]
        )

    def grey_cost(self, row: int) -> Tensor:
        """Return what a light fitted by gradients costs () for not being grey; a solved one costs nothing."""
        light = self.maps[row]
        if not self.gradient:
            return light.new_zeros(())
        return GREY * (light - light.mean(-1, keepdim=True)).abs().mean()

    def color_cast(self) -> Tensor:
        """Return the log of how much brighter the lights are in each channel than on the average, (3,)."""
        means = self.stacked().mean((1, 2, 3)).clamp(min=1e-4).log().mean(0)
        return means - means.mean()

    @torch.no_grad()
    def dim(self, factor: float) -> None:
        """Divide every light by `factor`, in place: an optimiser may hold them."""
        for light in self.maps:
            light.div_(factor)

    @torch.no_grad()
    def replace(self, name: str, light: Tensor) -> None:
        """Put `light` (6, R, R, 3) in place of a photo's, in place."""
        self.maps[self.index[name]].copy_(light)

    def groups(self) -> list[ParameterGroup]:
        """Return the lights that are fitted by gradients, `light.<photo>` each, and their rate, in radiance."""
        lights = {f"light.{name}": self.maps[i] for name, i in self.index.items()}
        return [ParameterGroup(lights, _RATE)] if self.gradient and lights else []

    def stacked(self) -> Tensor:
        """Return all lights (N, 6, R, R, 3)."""
        return torch.stack([light.detach() for light in self.maps])

    @torch.no_grad()
    def clamp(self) -> None:
        """Keep gradient-fitted lights non-negative."""
        for light in self.maps if self.gradient else ():
            light.clamp_(min=0)

    @torch.no_grad()
    def load(self, stacked: Tensor) -> None:
        """Take over lights (N, 6, R, R, 3) >= 0, one for each photo; raise `ValueError` when they are not."""
        wanted = (len(self.maps), *self.maps[0].shape)
        if tuple(stacked.shape) != wanted or bool((stacked < 0).any()):
            raise ValueError(f"'lights' are {tuple(stacked.shape)}, not {wanted} and 0 or more")
        for light, stored in zip(self.maps, stacked, strict=True):
            light.copy_(stored)
