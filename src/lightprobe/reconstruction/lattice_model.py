"""The first pass's unknowns: signed distances and offsets on a lattice, and the material field."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from lightprobe.core.config import DecomposeConfig, SdfMode
from lightprobe.core.device import generator, to_device
from lightprobe.core.errors import ConvergenceError
from lightprobe.geometry.marching_tetrahedra import Crossing, marching_tetrahedra, sign_change_loss
from lightprobe.geometry.mesh import EdgeFaces, edge_faces, vertex_normals
from lightprobe.reconstruction.distances import CoarseGrids, DistanceMlp
from lightprobe.reconstruction.material_field import MATERIAL_RATE, ScaledMaterial
from lightprobe.reconstruction.moving_visibility import MovingVisibility
from lightprobe.reconstruction.start import Start
from lightprobe.reconstruction.trials.schedule import lids_tried
from lightprobe.render.asset import gbuffer_of
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.silhouette import outline_vertices
from lightprobe.render.surface import View, face_camera, visible_surface
from lightprobe.training import ParameterGroup

GEOMETRY_RATE = 0.015  # Adam step of the shape (paper, 4.2): distances in cells, offsets before the tanh
START = 0.45  # mean linear base colour that Phase I starts with
_JUDGED = 4096  # visible points whose material has a price in a step
_COARSE_RATE = 3.0  # of the coarse grids, relative to single vertices: their gradients hold less noise
_MLP_RATE = 0.1  # of the network of distances: Adam moves every weight by it; a full step loses the surface


@dataclass(frozen=True)
class RasterisedView:
    """What a model shows to one camera, before shading."""

    gbuffer: GBuffer
    screen: Tensor  # (V, 3) projected vertices
    faces: Tensor  # (F, 3)
    edges: EdgeFaces
    regularisation: Tensor  # scalar


def _named(prefix: str, module: nn.Module) -> dict[str, Tensor]:
    return {f"{prefix}.{name}": parameter for name, parameter in module.named_parameters()}


class LatticeModel(nn.Module):
    """Distances (direct or MLP), bounded offsets, and the material field."""

    def __init__(self, start: Start, config: DecomposeConfig, device: torch.device, seed: int):
        super().__init__()
        self.lattice = start.lattice.to(device)
        self.config = config
        self.seed = seed
        initial = start.distance.to(device)
        if config.sdf is SdfMode.MLP:
            self.mlp = DistanceMlp(generator(seed, "sdf")).to(device)
            self.mlp.fit(self.lattice.vertices, initial, steps=400, random=generator(seed, "sdf-fit"))
        else:
            self.distance = nn.Parameter(initial)
            self.coarse = CoarseGrids(self.lattice)
        self.offset = nn.Parameter(torch.zeros_like(self.lattice.vertices))
        # Whether a lid may close a cavity: until the first trial has looked for one and, if there is, the
        # second has tried to open it. Never where the texture is to move the surface from the start. On the
        # CPU: each step asks.
        self.lid_in_doubt = torch.tensor(0 < config.texture_gradient_from < 1 and lids_tried(config))
        self.visibility: MovingVisibility | None = None
        self.material = ScaledMaterial(START, config, device, seed)

    def groups(self) -> list[ParameterGroup]:
        """Return the parameters and their rates: distances in object radii, offsets before the bounding tanh."""
        if self.config.sdf is SdfMode.MLP:
            shape = [ParameterGroup(_named("mlp", self.mlp), _MLP_RATE * GEOMETRY_RATE)]
        else:
            # Adam moves every touched entry by about its rate: a lattice value by some hundredths of a cell.
            cells, coarse = GEOMETRY_RATE * self.lattice.cell, _named("coarse", self.coarse)
            shape = [ParameterGroup({"distance": self.distance}, cells)]
            shape.append(ParameterGroup(coarse, _COARSE_RATE * cells))
        return [
            *shape,
            ParameterGroup({"offset": self.offset}, GEOMETRY_RATE),
            ParameterGroup(_named("field", self.material.field), MATERIAL_RATE),
        ]

    def chosen(self) -> dict[str, Tensor]:
        """Return what is chosen or found and not trained, by name."""
        return {"brightness": self.material.brightness, "lid_in_doubt": self.lid_in_doubt}

    def distances(self) -> Tensor:
        """Return the signed distances (V,), positive on the lattice's border so that the surface is closed."""
        if self.config.sdf is SdfMode.MLP:
            free = self.mlp(self.lattice.vertices)
        else:
            free = self.distance + self.coarse()
        return torch.where(self.lattice.boundary, free.detach().clamp(min=0.5 * self.lattice.cell), free)

    def positions(self) -> Tensor:
        """Return where the lattice's vertices are, (V, 3), moved by their offsets."""
        return self.lattice.vertices + 0.45 * self.lattice.cell * torch.tanh(self.offset)

    def surface(self, distance: Tensor, crossing: Crossing) -> tuple[Tensor, Tensor]:
        """Return vertices (N, 3) and faces (F, 3) of the zero set; raise `ConvergenceError` when it is empty.

        distance (V,): the signed distances at the lattice's vertices, whose sign changes `crossing` holds.
        """
        vertices, faces = marching_tetrahedra(self.lattice, crossing, self.positions(), distance)
        if len(faces) == 0:
            raise ConvergenceError(
                "The surface vanished while fitting; check the masks and cameras with `inspect`."
            )
        return vertices, faces

    @property
    def mean_color(self) -> Tensor:
        """The mean () that base colours are held at."""
        return self.material.mean_color

    @torch.no_grad()
    def brighten(self, factor: float) -> None:
        """Multiply all base colours, and the mean they are held at, by `factor`."""
        self.material.brightness.mul_(factor)
        self.visibility = None if self.visibility is None else self.visibility.brightened(factor)

    @torch.no_grad()
    def reshape(self, distance: Tensor) -> None:
        """Take the surface whose signed distances at the lattice's vertices are `distance` (V,).

        Raises `ValueError` where distances are not free but those of a network.
        """
        if self.config.sdf is SdfMode.MLP:
            raise ValueError("distances of a network cannot be set")
        self.distance.add_(distance - self.distances())
        self.update_visibility()

    def rasterise(self, view: View, step: int, progress: float) -> RasterisedView:
        """Return what the camera sees; `progress` in [0, 1] drives the regularisers' schedule."""
        distance = self.distances()
        crossing = Crossing.of(self.lattice, distance)
        vertices, faces = self.surface(distance, crossing)
        screen = view.project(vertices)
        gbuffer, material = self._shown(view, vertices, faces, screen, progress)
        weight = self.config.sdf_regularisation * max(0.05, 1 - 0.95 * progress / 0.25)
        loss = weight * sign_change_loss(self.lattice, crossing, distance)
        covered = len(gbuffer.position) / (gbuffer.height * gbuffer.width)
        points = gbuffer.position.detach()
        if self._texture_moves(progress):
            # The points are detached: what a material costs must not move the surface to where it is cheaper.
            points = self._some(points, step)
            material = self.material(points)
        loss = loss + self.material.loss(points, material, step, covered)
        edges = edge_faces(faces, outline_vertices(screen, faces))
        return RasterisedView(gbuffer, screen, faces, edges, loss)

    @torch.no_grad()
    def gbuffers(self, views: Sequence[View], progress: float) -> Iterator[GBuffer]:
        """Yield the G-buffers of the present surface in several views."""
        vertices, faces = self.present()
        for view in views:
            yield self._shown(view, vertices, faces, view.project(vertices), progress)[0]

    def _some(self, points: Tensor, step: int) -> Tensor:
        """Return some of the points (N, 3), drawn at random: (K, 3)."""
        random = generator(self.seed, "judged", step)
        rows = torch.randint(0, max(len(points), 1), (min(_JUDGED, len(points)),), generator=random)
        return points.index_select(0, to_device(rows, points.device))

    def _texture_moves(self, progress: float) -> bool:
        """Return whether the surface follows its texture: whether pictures have a gradient to points' places.

        Not yet where a lid is in doubt: it would bend to what photos show behind it, and look closed when it
        is tried.
        """
        return progress >= self.config.texture_gradient_from and not self.lid_in_doubt

    def _shown(
        self, view: View, vertices: Tensor, faces: Tensor, screen: Tensor, progress: float
    ) -> tuple[GBuffer, Tensor]:
        """Return the G-buffer of a surface projected to `screen`, and the material (P, 8) of its pixels."""
        surface = visible_surface(vertices, faces, view, screen)
        visibility = None if self.visibility is None else self.visibility.at(vertices, faces, surface)
        position = surface.position
        material = self.material(position if self._texture_moves(progress) else position.detach())
        normal = surface.interpolate(vertex_normals(vertices, faces), faces)
        # The offset bends the normal the field is shaded with, and must not hide errors of shape early on.
        ramp = self.config.normal_ramp
        share = 1.0 if ramp == 0 else min(1.0, progress / ramp)
        normal = face_camera(
            torch.nn.functional.normalize(normal, dim=1, eps=1e-12) + material[:, 5:] * share, surface.view
        )
        return gbuffer_of(surface, view, normal, material, visibility), material

    def present(self) -> tuple[Tensor, Tensor]:
        """Return vertices (N, 3) and faces (F, 3) of the present surface; errors as in `surface`."""
        distance = self.distances()
        return self.surface(distance, Crossing.of(self.lattice, distance))

    @torch.no_grad()
    def update_visibility(self) -> None:
        """Find anew what the present surface sees of itself."""
        if self.config.shadows:
            vertices, faces = self.present()
            side = self.config.depth_map_side // 2  # the surface will have moved on by the next step
            self.visibility = MovingVisibility.of(vertices, faces, self.material(vertices)[:, :3], side)

    def project(self) -> None:
        """Do nothing: every quantity is valid by construction."""

    @torch.no_grad()
    def extract(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the present surface as arrays, vertices (V, 3) float32 and faces (F, 3) int32."""
        vertices, faces = self.present()
        return vertices.cpu().numpy(), faces.cpu().numpy()
