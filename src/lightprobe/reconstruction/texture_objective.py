"""The third pass's objective: the textures alone, at the photos' full size, on random pixels of several photos a
step.

With the shape at rest, which point of the surface a pixel sees is known once and for all. So a step costs
what its pixels cost, however large the photos are, and fine relief and print get the many visits they need.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.core.config import DecomposeConfig
from lightprobe.core.device import draw_rows, generator, to_device
from lightprobe.geometry.textures import bilinear_taps
from lightprobe.kernels import weighted_gather
from lightprobe.light.photometry import displayed_error
from lightprobe.reconstruction.image_objective import PassObjective
from lightprobe.reconstruction.lights import Lights, solve_target_light
from lightprobe.reconstruction.losses import brightness_anchor, grey_world, material_prior
from lightprobe.reconstruction.photos import Target
from lightprobe.reconstruction.surface_model import SurfaceModel
from lightprobe.reconstruction.trials.schedule import metals_tried
from lightprobe.render.asset import Asset, gbuffer_of, shading_normals
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade
from lightprobe.render.surface import Surface, View, visible_surface
from lightprobe.render.visibility import PointVisibility
from lightprobe.training import ParameterGroup, Stage
from lightprobe.training.loop import visited

_POOL = 65_536  # pixels kept of a photo
_PHOTOS = 4  # looked at in a step
_PIXELS = 8192  # of each
_RATE = 0.01  # Adam step of all textures
_SMOOTHNESS = 0.01  # weight of the difference between texels a texel apart
_RELIGHT = 3  # epochs between solves of a photo's light, which has long settled


@dataclass(frozen=True)
class PhotoPixels:
    """Some pixels of a photo that lie wholly inside its mask, and the surface they show."""

    name: str
    view: View
    surface: Surface  # K points
    color: Tensor  # (K, 3) linear
    clipped: Tensor  # (K, 3) bool

    @staticmethod
    def of(asset: Asset, target: Target, seed: int) -> "PhotoPixels":
        """Return at most `_POOL` pixels of a photo of the asset, drawn at random."""
        surface = visible_surface(asset.mesh.vertices, asset.mesh.faces, target.view)
        inside = target.inside(surface.pixel)
        surface = surface.select(draw_rows(inside, _POOL, generator(seed, f"pool/{target.name}")))
        at = surface.pixel
        return PhotoPixels(target.name, target.view, surface, target.color[at], target.clipped[at])

    def select(self, rows: Tensor) -> "PhotoPixels":
        """Return the pixels at `rows` (K,) int64."""
        return PhotoPixels(
            self.name, self.view, self.surface.select(rows), self.color[rows], self.clipped[rows]
        )

    def sample(self, seed: int, step: int) -> "PhotoPixels":
        """Return at most `_PIXELS` of the pixels, drawn at random."""
        every = torch.arange(len(self.color), device=self.color.device)
        return self.select(draw_rows(every, _PIXELS, generator(seed, f"texture/{self.name}", step)))

    def tensors(self) -> tuple[Tensor, ...]:
        """Return the fields of the surface, the colours (K, 3), and where these are clipped (K, 3)."""
        return *vars(self.surface).values(), self.color, self.clipped


class TextureObjective(PassObjective):
    """Fit the textures of a surface, and the lights, to pixels of photos."""

    model: SurfaceModel

    def __init__(
        self,
        model: SurfaceModel,
        photos: list[PhotoPixels],
        lights: Lights,
        stage: Stage,
        config: DecomposeConfig,
        seed: int,
    ):
        self.model, self.lights, self.config = model, lights, config
        self._photos, self._stage, self._seed = photos, stage, seed
        self._mesh = model.start
        self._normals = model.start.normals()

    def groups(self) -> list[ParameterGroup]:
        """Return the texels, and the lights that are fitted by gradients."""
        texels = {"color": self.model.color, "finish": self.model.finish}
        return [ParameterGroup(texels, _RATE), *self.lights.groups()]

    def refresh(self, iteration: int, fraction: float) -> None:
        """Do nothing: the shape is at rest, and so are its shadows and its brightness."""

    def photos(self, iteration: int) -> str:
        """Return the names of the photos of a step."""
        return ", ".join(f"'{self._photos[i].name}'" for i, _ in self._visits(iteration))

    @property
    def recordable(self) -> bool:
        """Whether a step depends on what it is given alone: not where the lights are parameters, too."""
        return not self.lights.gradient

    def given(self, iteration: int) -> tuple[Tensor, ...]:
        """Return what `loss` needs of a step's photos, whose lights are solved anew where it is time.

        Of each of the N photos `PhotoPixels.tensors`; then, for all P pixels, how far beside them to look (P,
        2), in texels; the photos' prefiltered lights (N, T, 3) and what these cost (); the cast (3,) of all
        lights.
        """
        step, visits = self._stage.first_step + iteration, self._visits(iteration)
        seen = [self._photos[i].sample(self._seed, step) for i, _ in visits]
        rows, levels = [self.lights.index[photo.name] for photo in seen], []
        for (_, epoch), photo, row in zip(visits, seen, rows, strict=True):
            if not self.lights.gradient and epoch % _RELIGHT == 0:
                self.lights.maps[row] = self._solve(photo, row)
            levels.append(self.lights.prefilter.apply(self.lights.maps[row]))
        pixels = sum(len(photo.color) for photo in seen)
        random = generator(self._seed, "texture-smoothness", step)
        angle = 2 * math.pi * torch.rand(pixels, generator=random)
        beside = to_device(torch.stack([angle.cos(), angle.sin()], 1), seen[0].color.device)
        cost = torch.stack([self.lights.grey_cost(row) for row in rows]).mean()
        photos = (tensor for photo in seen for tensor in photo.tensors())
        return *photos, beside, torch.stack(levels), cost, self.lights.color_cast()

    def loss(self, iteration: int, fraction: float, *given: Tensor) -> Tensor:
        """Return the mean image loss () of the photos `given`, and what their materials cost."""
        *tensors, beside, levels, cost, cast = given
        count = len(tensors) // len(levels)
        fields = [tensors[k : k + count] for k in range(0, len(tensors), count)]
        surfaces, colors = [Surface(*each[:-2]) for each in fields], [(each[-2], each[-1]) for each in fields]
        material, neighbours = self._materials(surfaces, beside)
        parts = material.split([len(color) for color, _ in colors])
        image = material.new_zeros(())
        for surface, (color, clipped), part, light in zip(surfaces, colors, parts, levels, strict=True):
            render = shade(self._gbuffer(surface, part), self.lights.prefilter, light)
            image = image + displayed_error(render, color, clipped)
        decided = metals_tried(self.config, self.config.pass1_iterations)
        loss = (
            image / len(surfaces)
            + cost
            + _SMOOTHNESS * (material - neighbours).abs().mean()
            + material_prior(material, self.config, decided=decided)
            + brightness_anchor(self.model.color, self.model.mean_color, self.config)
        )
        return loss + grey_world(material[:, :3], cast) if self.config.priors else loss

    def _visits(self, iteration: int) -> list[tuple[int, int]]:
        """Return (photo, epoch) for each photo of a step."""
        first, count = iteration * _PHOTOS, len(self._photos)
        places = range(first, first + _PHOTOS)
        return [(visited(self._seed, f"order/{self._stage.name}", count, k), k // count) for k in places]

    def _materials(self, surfaces: Sequence[Surface], beside: Tensor) -> tuple[Tensor, Tensor]:
        """Return the material (P, 8) at all points of the surfaces, and the same `beside` (P, 2) texels away."""
        size = round(len(self.model.color) ** 0.5)
        uv = torch.cat([surface.interpolate(self._mesh.uvs, self._mesh.uv_faces) for surface in surfaces])
        index, weight = bilinear_taps(torch.cat([uv, uv + beside / size]), size)
        # Part by part: putting the channels of all texels side by side would cost more than the pixels do.
        parts = [weighted_gather(part, index, weight) for part in (self.model.color, self.model.finish)]
        material, neighbours = torch.cat(parts, 1).chunk(2)
        return material, neighbours

    @torch.no_grad()
    def _solve(self, photo: PhotoPixels, row: int) -> Tensor:
        start, pull = self.lights.maps[row], self.lights.pull(photo.name)
        rows = torch.arange(min(self.config.light_solve_pixels, len(photo.color)), device=start.device)
        some = photo.select(rows * len(photo.color) // max(len(rows), 1))
        material, _ = self._materials([some.surface], some.color.new_zeros(len(rows), 2))
        gbuffer = self._gbuffer(some.surface, material)
        return solve_target_light(some.color, some.clipped, gbuffer, start, rows, self.config, pull=pull)

    def _gbuffer(self, surface: Surface, material: Tensor) -> GBuffer:
        normal = shading_normals(surface, self._mesh, self._normals, self.model.tangents, material[:, 5:])
        visibility, faces = None, self._mesh.faces
        if self.model.visibility is not None:
            visibility = PointVisibility.of(self.model.visibility, faces, surface.face, surface.barycentric)
        view = self._photos[0].view  # for its size, which no shading asks for
        return gbuffer_of(surface, view, normal, material, visibility)
