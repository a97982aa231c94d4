"""The environments of the training photos while the asset is still changing.

With geometry and material held, a photo is linear in its light. So each visit can solve for the light in
closed form (`LightUpdate.SOLVE`) instead of taking one gradient step (`LightUpdate.GRADIENT`, the paper).
"""

from collections.abc import Callable, Mapping

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


def solve_target_light(
    observed: Tensor,
    clipped: Tensor,
    gbuffer: GBuffer,
    start: Tensor,
    rows: Tensor | None,
    config: DecomposeConfig,
    times: int = 1,
    *,
    regularisation: float | None = None,
) -> Tensor:
    """Return the light (6, R, R, 3) that explains the pixels `rows` (K,) of the G-buffer, or all, best, from
    `start`.

    observed (K, 3): their linear colours; clipped (K, 3) bool: where these are only bounds from below. It is
    solved so `times` times, each time from the last light. Places that the pixels do not pin are pulled
    towards the mean colour of the light it starts from, with `regularisation` or, by default, the weaker pull
    that `config` has while the asset changes: a light that is too smooth asks for a surface that is too
    glossy.

    Pixels weigh as tone mapping has it, by the brighter of their photo and of what the last light shows
    there: what either takes for a highlight weighs little (docs/decisions/light-weights.md).
    """
    transport = Transport(gbuffer, prefilters.cached(start.shape[1], start.device), rows)
    pull = config.light_regularisation if regularisation is None else regularisation
    light = start
    for _ in range(times):
        last = transport.lit(light)
        weight = tone_weight(torch.maximum(observed.mean(1), last.radiance.mean(1)))
        prior = light.mean((0, 1, 2)).expand_as(light)
        solved = solve_light(
            transport,
            observed,
            weight,
            clipped,
            prior,
            regularisation=pull,
            iterations=config.light_solve_iterations,
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
        self, observed: Tensor, clipped: Tensor, gbuffer: GBuffer, rows: Tensor, start: Tensor
    ) -> Tensor:
        """Return the light from `start` (6, R, R, 3) that explains the rows (K,) int64 of the G-buffer, K >
        0, best.

        observed (P, 3), clipped (P, 3) bool: as in `solve_target_light`, of all pixels of the G-buffer.
        """
        vertices = 0 if gbuffer.visibility is None else len(gbuffer.visibility.vertices.unoccluded)
        if vertices != self._vertices:  # the old record would never fit again
            self._vertices, self._recorder, self._solve = vertices, recorder_for(self._device), None
        if self._recorder is not None:
            count = max(self._pixels, len(rows))
            rows = rows[torch.arange(count, device=rows.device) * len(rows) // count]
        part = gbuffer.select(rows)
        if self._solve is None:
            self._solve = RecordedStep(self._step(part), self._recorder)
        return self._solve(observed[rows], clipped[rows], start, *part.tensors())

    def _step(self, like: GBuffer) -> Callable[..., Tensor]:
        def step(observed: Tensor, clipped: Tensor, start: Tensor, *tensors: Tensor) -> Tensor:
            seen = like.holding(tensors)
            return solve_target_light(observed, clipped, seen, start, None, self._config, self._times)

        return step


class Lights:
    """One cubemap (6, R, R, 3) per training photo; separate tensors, so that Adam leaves unvisited lights
    alone.
    """

    def __init__(self, names: list[str], config: DecomposeConfig, device: torch.device, seed: int):
        """Start with grey lights of the photos `names`."""
        self.index = {name: i for i, name in enumerate(names)}
        self.config = config
        self.seed = seed
        resolution = config.light_resolution
        self.gradient = config.light_update is LightUpdate.GRADIENT
        shape = (6, resolution, resolution, 3)
        self.maps = [torch.full(shape, 0.5, device=device, requires_grad=self.gradient) for _ in names]
        self.prefilter = prefilters.cached(resolution, device)
        self._solver = LightSolver(config, device, config.light_solve_pixels)

    def rows(self, target: Target, gbuffer: GBuffer, step: int, count: int) -> Tensor:
        """Return up to `count` rows (K,) int64 of the G-buffer that lie inside the mask, drawn without
        replacement.
        """
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
            self.maps[row] = self._solver(observed, clipped, gbuffer, rows, self.maps[row])
        return self.prefilter.apply(self.maps[row]), self.grey_cost(row)

    def grey_cost(self, row: int) -> Tensor:
        """Return what a light fitted by gradients costs () for not being grey; a solved one costs nothing."""
        light = self.maps[row]
        if not self.gradient:
            return light.new_zeros(())
        return self.config.light_grey * (light - light.mean(-1, keepdim=True)).abs().mean()

    def color_cast(self) -> Tensor:
        """Return by how much the lights are brighter in each channel than on the average, (3,), in
        logarithms.
        """
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

    def parameters(self) -> dict[str, Tensor]:
        """Return the lights that are fitted by gradients, `light.<photo>` each; none where they are solved."""
        return {f"light.{name}": self.maps[i] for name, i in self.index.items()} if self.gradient else {}

    def groups(self) -> list[ParameterGroup]:
        """Return the same with their rate, in radiance."""
        parameters = self.parameters()
        return [ParameterGroup(parameters, self.config.learning_rate_light)] if parameters else []

    def stacked(self) -> Tensor:
        """Return all lights (N, 6, R, R, 3)."""
        return torch.stack([light.detach() for light in self.maps])

    def solved(self) -> dict[str, Tensor]:
        """Return `stacked` by name where lights are solved and not fitted by gradients."""
        return {} if self.gradient else {"lights": self.stacked()}

    def load_solved(self, tensors: Mapping[str, Tensor]) -> None:
        """Take over what `solved` returned; raise `KeyError` or `ValueError` where it does not fit."""
        if not self.gradient:
            self.load(tensors["lights"])

    def clamp(self) -> None:
        """Keep gradient-fitted lights non-negative."""
        if self.gradient:
            with torch.no_grad():
                for light in self.maps:
                    light.clamp_(min=0)

    @torch.no_grad()
    def load(self, stacked: Tensor) -> None:
        """Take over lights (N, 6, R, R, 3) >= 0; raise `ValueError` when they are not one for each of these."""
        wanted = (len(self.maps), *self.maps[0].shape)
        if tuple(stacked.shape) != wanted or bool((stacked < 0).any()):
            raise ValueError(f"'lights' are {tuple(stacked.shape)}, not {wanted} and 0 or more")
        for light, stored in zip(self.maps, stacked, strict=True):
            light.copy_(stored)
