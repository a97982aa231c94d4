"""The start of Phase I: a lattice and signed distances on it, of the masks' visual hull, a ball, or noise."""

from dataclasses import dataclass

import numpy as np
import scipy
import torch

from lightprobe.core.config import DecomposeConfig, StartShape
from lightprobe.core.device import generator
from lightprobe.core.errors import ConvergenceError
from lightprobe.geometry.tet_lattice import TetLattice, build_lattice
from lightprobe.reconstruction.photos import Target
from lightprobe.scene import Hull, carved_hull
from lightprobe.scene.photo import Photo, Scene

BOX = 1.15  # half edge of the lattice, in object radii
_INSIDE = 0.1  # share of the vertices that start inside, of noise
OUTER_BAND = 3.0  # lattice cells kept outside the hull: the surface may grow this far


@dataclass(frozen=True)
class Start:
    """The lattice and the distances to start from."""

    lattice: TetLattice
    distance: torch.Tensor  # (V,) float32, inside < 0


def start_shape(
    scene: Scene, config: DecomposeConfig, seed: int, photos: list[Photo], targets: list[Target]
) -> Start:
    """Return the lattice and the distances that the first pass starts from, of photos with their pixels."""
    if config.start is not StartShape.HULL:
        return start_from_box(config.start, config.lattice_cells, seed)
    cameras = [
        photo.camera.resized(target.view.width, target.view.height).normalised(scene.similarity)
        for photo, target in zip(photos, targets, strict=True)
    ]
    masks = [t.alpha.reshape(t.view.height, t.view.width).cpu().numpy() for t in targets]
    # The box leaves the surface room to grow beyond the hull, whose radius is 1 only up to a voxel.
    hull = carved_hull(cameras, masks, config.hull_voxels, lo=(-BOX,) * 3, hi=(BOX,) * 3)
    return start_from_hull(hull, config.lattice_cells)


def hull_distance(hull: Hull) -> np.ndarray:
    """Return the smoothed signed distance (N, N, N) float32 of a hull's voxels, normalised units, inside < 0."""
    voxel = (hull.hi[0] - hull.lo[0]) / hull.occupancy.shape[0]
    outside = scipy.ndimage.distance_transform_edt(~hull.occupancy)
    inside = scipy.ndimage.distance_transform_edt(hull.occupancy)
    # Voxel distances are half a voxel off on either side and stepped: a light blur removes the steps.
    return scipy.ndimage.gaussian_filter((outside - inside).astype(np.float32), 0.7) * np.float32(voxel)


def start_from_hull(hull: Hull, cells: int) -> Start:
    """Return lattice and distances around a hull, `cells` per edge; raise `ConvergenceError` if it is empty."""
    if not hull.occupancy.any():
        raise ConvergenceError(
            "The masks have no common visual hull: cameras or masks are wrong; "
            "look at them with `lightprobe inspect`."
        )
    field = hull_distance(hull)
    lower, extent = np.asarray(hull.lo, np.float64), float(hull.hi[0] - hull.lo[0])
    cell = extent / cells

    def at(points: np.ndarray) -> np.ndarray:
        voxels = (points - lower) / extent * field.shape[0] - 0.5
        return scipy.ndimage.map_coordinates(field, voxels.reshape(-1, 3).T, order=1, mode="nearest").reshape(
            points.shape[:-1]
        )

    centers = (np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), -1) + 0.5) * cell + lower
    lattice = build_lattice(at(centers) < OUTER_BAND * cell, lower, cell)
    distance = at(lattice.vertices.double().numpy()).astype(np.float32)
    return Start(lattice, torch.from_numpy(distance))


def start_from_box(shape: StartShape, cells: int, seed: int) -> Start:
    """Return the lattice of the whole box with the distances of a ball of radius 1, or with noise.

    Noise is uniform over one cell, a tenth of the vertices inside.
    """
    cell = 2 * BOX / cells
    lattice = build_lattice(np.ones((cells,) * 3, bool), np.full(3, -BOX), cell)
    if shape is StartShape.SPHERE:
        return Start(lattice, lattice.vertices.norm(dim=1) - 1)
    noise = torch.rand(len(lattice.vertices), generator=generator(seed, "sdf-noise"))
    return Start(lattice, (noise - _INSIDE) * cell)
