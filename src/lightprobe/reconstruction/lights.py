"""The environments of the training photos while the asset is still changing.

With geometry and material held, a photo is linear in its light. So each visit can solve for the light in
closed form (`LightUpdate.SOLVE`) instead of taking one gradient step (`LightUpdate.GRADIENT`, the paper).

Photos of one place (`Photo.light_group`) were taken under one light, up to exposure and white balance. What one of them
does not show of it, the others may: a light is pulled to the mean of the others'. What stands close by, the table above
all, is seen at another place in the mirror of another view. Where its plane is known (`View.support`), it is looked up
where the mirror's ray meets it, and the lights of a place are all but one; else they are pulled where their pixels do not
pin them, no more.
"""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig, LightUpdate
from lightprobe.core.device import generator, to_device
from lightprobe.light import prefilter as prefilters
from lightprobe.light.photometry import tone_weight
from lightprobe.reconstruction.photos import Target
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.refit import refit_contrast
from lightprobe.render.transport import Transport, solve_light
from lightprobe.training import ParameterGroup
from lightprobe.training.recording import CudaRecorder, RecordedStep, recorder_for

# Of solved lights while the asset changes, as too smooth a light asks for too glossy a surface; and of held-out
# photos' lights and those that are kept.
REGULARISATION, FINAL_REGULARISATION = 0.001, 0.003
# Of both, of a light that other photos show as well, with what is near at its distance and without.
SUPPORTED_REGULARISATION, SHARED_REGULARISATION = 0.2, 0.01
GREY = 0.005  # weight of the deviation from grey of a light that is fitted by gradients; nvdiffrec's
_ITERATIONS = 5  # of a solve, which starts from the light of the previous visit
_RATE = 0.005  # Adam step of a light that is fitted by gradients (paper, 4.2)
_DARKEST = 1e-6  # mean radiance that a light is compared with at least


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
    expected: Tensor | None = None,
) -> Tensor:
    """Return the light (6, R, R, 3) that explains the pixels `rows` (K,) of the G-buffer, or all, best.

    observed (K, 3): their linear colours; clipped (K, 3) bool: where these are only bounds from below. The
    light is solved `times` times, first from `start`, then from the last light. Places that the pixels do not
    pin are pulled towards the mean colour of the light that a solve starts from, with the weight
    `regularisation`, or towards `expected` (6, R, R, 3), of mean 1, times this colour, with that of shared lights.

    Pixels weigh as tone mapping has it, by the brighter of their photo and of what the last light shows
    there: what either takes for a highlight weighs little (docs/decisions/light-weights.md).
    """
    transport = Transport(gbuffer, prefilters.cached(start.shape[1], start.device), rows)
    light = start
    for _ in range(times):
        last = transport.lit(light)
        weight = tone_weight(torch.maximum(observed.mean(1), last.radiance.mean(1)))
        mean = light.mean((0, 1, 2))
        prior, pull = mean.expand_as(light), regularisation
        if expected is not None:
            prior = mean * expected
            pull = SHARED_REGULARISATION if gbuffer.support is None else SUPPORTED_REGULARISATION
        solved = solve_light(
            transport,
            observed,
            weight,
            clipped,
            prior,
            regularisation=pull,
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

    def __init__(self, config: DecomposeConfig, device: torch.device, pixels: int, times: int = 1):
        """Solve lights on `device`, each `times` times."""
        self._config, self._device, self._pixels, self._times = config, device, pixels, times
        self._vertices = -1  # of the surface seen last
        self._recorder: CudaRecorder | None = None
        self._solve: RecordedStep | None = None

    @torch.no_grad()
    def __call__(
        self,
        observed: Tensor,
        clipped: Tensor,
        gbuffer: GBuffer,
        rows: Tensor,
        start: Tensor,
        expected: Tensor | None = None,
    ) -> Tensor:
        """Return the light from `start` (6, R, R, 3) that explains the rows (K,) int64, K > 0, best.

        observed (P, 3), clipped (P, 3) bool: as in `solve_target_light`, of all pixels of the G-buffer. expected: as
        there; a solver is given one every time, or never.
        """
        vertices = 0 if gbuffer.visibility is None else len(gbuffer.visibility.vertices.unoccluded)
        if vertices != self._vertices:  # the old record would never fit again
            self._vertices, self._recorder, self._solve = vertices, recorder_for(self._device), None
        if self._recorder is not None:
            count = max(self._pixels, len(rows))
            rows = rows[torch.arange(count, device=rows.device) * len(rows) // count]
        part = gbuffer.select(rows)
        if self._solve is None:
            self._solve = RecordedStep(self._step(part, shared=expected is not None), self._recorder)
        pull = () if expected is None else (expected,)
        return self._solve(observed[rows], clipped[rows], start, *pull, *part.tensors())

    def _step(self, like: GBuffer, *, shared: bool) -> Callable[..., Tensor]:
        def step(observed: Tensor, clipped: Tensor, start: Tensor, *tensors: Tensor) -> Tensor:
            seen = like.holding(tensors[shared:])
            return solve_target_light(
                observed,
                clipped,
                seen,
                start,
                None,
                self._config,
                self._times,
                expected=tensors[0] if shared else None,
            )

        return step


def expected_light(others: Sequence[Tensor]) -> Tensor | None:
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
    ):
        """Start with grey lights of the photos `names`. groups: what each shares its light by; without: none does."""
        self.index = {name: i for i, name in enumerate(names)}
        self._groups = dict(enumerate(groups))
        self.config = config
        self.seed = seed
        resolution = config.light_resolution
        self.gradient = config.light_update is LightUpdate.GRADIENT
        shape = (6, resolution, resolution, 3)
        self.maps = [torch.full(shape, 0.5, device=device, requires_grad=self.gradient) for _ in names]
        self.prefilter = prefilters.cached(resolution, device)
        self._solver = LightSolver(config, device, config.light_solve_pixels)
        self._shared_solver = LightSolver(config, device, config.light_solve_pixels)

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
            expected = self.expected(row)
            solver = self._solver if expected is None else self._shared_solver
            self.maps[row] = solver(observed, clipped, gbuffer, rows, self.maps[row], expected)
        return self.prefilter.apply(self.maps[row]), self.grey_cost(row)

    def expected(self, row: int) -> Tensor | None:
        """Return what a photo's light is pulled to, as in `solve_target_light`; None where it shares it with none."""
        return self.expected_in(self._groups.get(row), row)

    def expected_in(self, group: str | None, own: int | None) -> Tensor | None:
        """Return what the light of a photo of a group is pulled to, (6, R, R, 3); own: its row, None if held out."""
        rows = [row for row, other in self._groups.items() if other == group and row != own]
        return expected_light([self.maps[row] for row in rows]) if group is not None else None

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
