"""The second pass's unknowns: vertex positions of a fixed mesh, and its textures."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import torch
from torch import Tensor, nn

from lightprobe.core.config import DecomposeConfig, Smoothed, VertexUnit
from lightprobe.core.device import generator, to_device
from lightprobe.geometry.mesh import Mesh, edge_faces, uv_tangents
from lightprobe.geometry.textures import Textures, bilinear_taps
from lightprobe.kernels import gather_rows, scatter_rows, weighted_gather
from lightprobe.light.prefilter import MIN_ROUGHNESS
from lightprobe.reconstruction.lattice_model import GEOMETRY_RATE, RasterisedView
from lightprobe.reconstruction.losses import (
    SMOOTHNESS,
    brightness_anchor,
    color_change,
    material_prior,
    neighbour_difference,
)
from lightprobe.reconstruction.material_field import MATERIAL_RATE
from lightprobe.reconstruction.trials.schedule import metals_tried
from lightprobe.render.asset import Asset, textured_gbuffer, textured_visibility
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.surface import Surface, View, visible_surface
from lightprobe.training import ParameterGroup

# Weight of the squared Laplacian of the displacements, in their unit: ours, and nvdiffrec's 10 000 of a mean over
# coordinates.
_LAPLACIAN = {VertexUnit.EDGE: 0.5, VertexUnit.RADIUS: 3333.0}
_BESIDE = 0.005  # standard deviation, of the texture's edge, of where base colours are compared
_COMPARED = 4096  # points


class SurfaceModel(nn.Module):
    """A textured mesh whose vertices and texels move; the connectivity and texture coordinates stay."""

    mean_color: Tensor  # () that base colours are held at

    def __init__(self, asset: Asset, config: DecomposeConfig, seed: int = 0):
        super().__init__()
        self.config = config
        self.seed = seed
        self.start = asset.mesh
        self.edges = edge_faces(asset.mesh.faces)
        # In units of the mean edge one step means the same on a fine and a coarse mesh.
        ends = asset.mesh.vertices[self.edges.vertices]
        edge = float((ends[:, 0] - ends[:, 1]).norm(dim=1).mean())
        self.unit = edge if config.vertex_unit is VertexUnit.EDGE else 1.0
        self.displacement = nn.Parameter(torch.zeros_like(asset.mesh.vertices))
        channels = asset.textures.flat()
        self.color = nn.Parameter(channels[:, :3].clone())
        self.start_color = channels[:, :3]
        self.finish = nn.Parameter(channels[:, 3:].clone())  # roughness, metallic, normal
        mean = channels[:, :3].mean(0).clamp(min=1e-3).log().mean().exp()
        self.register_buffer("mean_color", mean)
        self.tangents = uv_tangents(asset.mesh)
        self.visibility = asset.visibility
        count = torch.bincount(self.edges.vertices.reshape(-1), minlength=len(asset.mesh.vertices))
        self.degree = count[:, None].float()

    def groups(self) -> list[ParameterGroup]:
        """Return the parameters and their rates: displacements in `unit`, texels as they are."""
        return [
            ParameterGroup({"displacement": self.displacement}, GEOMETRY_RATE),
            ParameterGroup({"color": self.color}, MATERIAL_RATE),
            ParameterGroup({"finish": self.finish}, self.config.learning_rate_finish),
        ]

    def chosen(self) -> dict[str, Tensor]:
        """Return what is chosen and not trained, by name."""
        return {"mean_color": self.mean_color}

    def texels(self) -> Tensor:
        """Return all channels (S * S, 8)."""
        return torch.cat([self.color, self.finish], 1)

    def mesh(self) -> Mesh:
        """Return the present mesh."""
        vertices = self.start.vertices + self.unit * self.displacement
        return replace(self.start, vertices=vertices)

    def rasterise(self, view: View, step: int, progress: float) -> RasterisedView:
        """Return what the camera sees."""
        mesh, texels = self.mesh(), self.texels()
        screen = view.project(mesh.vertices)
        gbuffer, surface = self._shown(view, mesh, texels, screen)
        laplacian = _LAPLACIAN[self.config.vertex_unit] * (
            1 - progress if self.config.laplacian_fades else 1.0
        )
        loss = laplacian * self._laplacian_change() + self._texture_loss(texels)
        if self.config.smoothed is Smoothed.BASE_COLOR:
            covered = len(gbuffer.pixel) / (view.height * view.width)
            loss = loss + SMOOTHNESS * self._color_change(surface, covered, step)
        return RasterisedView(gbuffer, screen, mesh.faces, self.edges, loss)

    @torch.no_grad()
    def gbuffers(self, views: Sequence[View], progress: float) -> Iterator[GBuffer]:
        """Yield the G-buffers of the present surface in several views."""
        mesh, texels = self.mesh(), self.texels()
        for view in views:
            yield self._shown(view, mesh, texels, view.project(mesh.vertices))[0]

    def _shown(self, view: View, mesh: Mesh, texels: Tensor, screen: Tensor) -> tuple[GBuffer, Surface]:
        surface = visible_surface(mesh.vertices, mesh.faces, view, screen)
        return textured_gbuffer(surface, view, mesh, texels, self.tangents, self.visibility), surface

    def _color_change(self, surface: Surface, covered: float, step: int) -> Tensor:
        """Return how base colours at some visible points differ from those beside them."""
        random = generator(self.seed, "texture-jitter", step)
        count = min(_COMPARED, len(surface.pixel))
        drawn = torch.randint(0, max(len(surface.pixel), 1), (count,), generator=random)
        rows = to_device(drawn, self.color.device)
        jitter = _BESIDE * to_device(torch.randn(count, 2, generator=random), self.color.device)
        uv = surface.select(rows).interpolate(self.start.uvs, self.start.uv_faces).detach()
        size = round(len(self.color) ** 0.5)
        here, there = (weighted_gather(self.color, *bilinear_taps(at, size)) for at in (uv, uv + jitter))
        return color_change(here, there, covered, step - self.config.pass1_iterations)

    def _laplacian_change(self) -> Tensor:
        """Return the mean squared uniform Laplacian of the displacement, in its unit."""
        a, b = gather_rows(self.displacement, self.edges.vertices).unbind(1)
        pull = torch.cat([b - a, a - b])
        ends = torch.cat([self.edges.vertices[:, 0], self.edges.vertices[:, 1]])
        laplacian = scatter_rows(pull, ends, len(self.displacement)) / self.degree.clamp(min=1)
        return laplacian.square().sum(1).mean()

    def _texture_loss(self, texels: Tensor) -> Tensor:
        """Return the weighted mean difference of neighbouring texels plus the priors of the material."""
        config, loss = self.config, texels.new_zeros(())
        if config.smoothness_texture > 0:  # each of these passes over all texels
            size = round(len(texels) ** 0.5)
            loss = loss + config.smoothness_texture * neighbour_difference(texels.view(size, size, -1))
        if config.normal_prior > 0:
            bends = torch.stack(self.finish.unbind(1)[2:4])
            loss = loss + 0.2 * config.normal_prior * bends.square().mean()
        if config.metallic_prior > 0 or config.priors:
            decided = metals_tried(config, config.pass1_iterations)
            loss = loss + material_prior(texels, config, decided=decided)
        return loss + brightness_anchor(self.color, self.mean_color, config)

    @torch.no_grad()
    def update_visibility(self) -> None:
        """Find anew what the present surface sees of itself, if it is not the start's."""
        moved = bool(self.displacement.any()) or not torch.equal(self.color, self.start_color)
        if self.config.shadows and moved:
            self.visibility = textured_visibility(self.mesh(), self.texels(), self.config.depth_map_side)

    @torch.no_grad()
    def brighten(self, factor: float) -> None:
        """Multiply all base colours, and the mean they are held at, by `factor`."""
        self.color.mul_(factor)
        self.mean_color.mul_(factor)
        self.visibility = None if self.visibility is None else self.visibility.brightened(factor)
        self.project()

    @torch.no_grad()
    def project(self) -> None:
        """Bring texels back into their valid ranges after a step."""
        self.color.clamp_(0, 1)
        self.finish[:, 0].clamp_(MIN_ROUGHNESS, 1)
        self.finish[:, 1].clamp_(0, 1)
        self.finish[:, 2:4].clamp_(-0.7, 0.7)
        self.finish[:, 4].clamp_(0.3, 1)

    @torch.no_grad()
    def asset(self) -> Asset:
        """Return the present state as an asset, normals of unit length."""
        self.update_visibility()
        return Asset(self.mesh(), Textures.of_bent(self.texels()), self.visibility)
