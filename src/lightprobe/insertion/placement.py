"""Placement of the virtual object: the ground under the known object, the height, and the place in the photo.

All in the normalised frame, z up. The ground is a horizontal plane.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.device import generator
from lightprobe.core.errors import ConfigError
from lightprobe.geometry.mesh import face_normals
from lightprobe.insertion.virtual_object import VirtualObject
from lightprobe.scene.camera import Camera, Similarity

_FOOT = 0.05  # of the object's height, above its lowest point, in which it can touch the ground
_SECTORS = 24  # around its axis, whose lowest points tell how high the ground is
_PLAUSIBLE = 0.08, 2.5  # heights relative to the known object's that a file's units are believed for
_FLAT = 0.05  # of the largest side: what is no higher lies flat, and its height is no measure
_USUAL = 0.6  # the height otherwise
_GAP = 0.15  # of the virtual object's radius, between it and the object
_BEARINGS = 24  # places around the object that are tried
_LARGEST_SCALE = 100.0  # heights relative to the known object's
_SPREAD = 20_000  # points that tell where the virtual object is
_CELLS = 48  # of the grid in which two objects are found to be in one place


@dataclass(frozen=True)
class Placement:
    """Where the user wants the virtual object; None: chosen here."""

    at: tuple[float, float] | None = None
    """Pixel of the photo, from the upper left corner, at which the middle of the object's foot stands."""
    scale: float | None = None
    """Height relative to the known object's."""
    turn: float = 0.0
    """Degrees about the vertical, anticlockwise seen from above."""

    def check(self) -> None:
        """Raise `ConfigError` for numbers that cannot be meant."""
        if self.at is not None and not all(map(math.isfinite, self.at)):
            raise ConfigError(f"--at {self.at[0]},{self.at[1]} is no pixel.")
        if self.scale is not None and not 1 / _LARGEST_SCALE <= self.scale <= _LARGEST_SCALE:
            raise ConfigError(f"--scale {self.scale:g} must be from 0.01 to {_LARGEST_SCALE:g}.")
        if not math.isfinite(self.turn):
            raise ConfigError("--turn must be a number of degrees.")


@dataclass(frozen=True)
class PlacedObject:
    """The virtual object at its place."""

    virtual: VirtualObject  # normalised frame
    ground: float  # height of the ground
    at: tuple[float, float]  # pixel of its foot
    scale: float  # height relative to the known object's
    warnings: tuple[str, ...]


def ground_height(vertices: Tensor) -> float:
    """Return the height of the ground under a mesh (V, 3): the median of the lowest points of sectors around
    it.

    A single bulge below, where photos from above see nothing, moves the ground as little as a missing foot.
    """
    points = vertices.detach().cpu().numpy().astype(np.float64)
    low, height = points[:, 2].min(), np.ptp(points[:, 2])
    foot = points[points[:, 2] <= low + _FOOT * height]
    middle = (foot[:, :2].min(0) + foot[:, :2].max(0)) / 2
    angle = np.arctan2(foot[:, 1] - middle[1], foot[:, 0] - middle[0])
    sector = ((angle / (2 * np.pi) + 0.5) * _SECTORS).astype(int) % _SECTORS
    lowest = np.full(_SECTORS, np.inf)
    np.minimum.at(lowest, sector, foot[:, 2])
    return float(np.median(lowest[np.isfinite(lowest)]))


def place(
    virtual: VirtualObject,
    known: Tensor,
    similarity: Similarity,
    camera: Camera,
    mask: np.ndarray,
    placement: Placement,
) -> PlacedObject:
    """Return the virtual object where `placement` asks, or beside the known object (V, 3), free and in the
    frame.

    camera: normalised frame; mask (H, W): coverage of the known object in the photo.
    Raises `ConfigError` for a pixel that does not see the ground.
    """
    placement.check()
    ground, height = ground_height(known), float(known[:, 2].amax() - known[:, 2].amin())
    scale, warnings = _scale(virtual, height * similarity.scale, placement)
    standing = _standing(virtual, scale * height / _measure(virtual), placement.turn, ground)
    if placement.at is None:
        spot, free = _beside(standing, known, camera, mask)
        if not free:
            warnings.append("There is no free place beside the known object; give one with --at and --scale.")
    else:
        spot = ground_point(camera, placement.at, ground)
    moved = standing.vertices + standing.vertices.new_tensor([spot[0], spot[1], 0.0])
    if placement.at is not None and _overlap(_surface_points(moved, standing.faces), known):
        warnings.append("The virtual object stands within the known object; give another place with --at.")
    pixel = camera.project(np.array([[spot[0], spot[1], ground]]))[0]
    at = (float(pixel[0]), float(pixel[1]))
    return PlacedObject(replace(standing, vertices=moved), ground, at, scale, tuple(warnings))


def ground_point(camera: Camera, at: tuple[float, float], ground: float) -> np.ndarray:
    """Return the point (2,) of the ground that a pixel sees; raise `ConfigError` when it sees none."""
    if not (0 <= at[0] <= camera.width and 0 <= at[1] <= camera.height):
        size = f"{camera.width} x {camera.height}"
        raise ConfigError(f"--at {at[0]:g},{at[1]:g} lies outside of the photo's {size}.")
    local = np.array([(at[0] - camera.cx) / camera.fx, -(at[1] - camera.cy) / camera.fy, -1.0])
    ray = camera.camera_to_world[:3, :3] @ local
    along = (ground - camera.position[2]) / ray[2] if abs(ray[2]) > 1e-9 else -1.0
    if not 0 < along < 1e4:
        raise ConfigError(
            f"--at {at[0]:g},{at[1]:g} does not see the ground; give a pixel below the horizon."
        )
    return (camera.position + along * ray)[:2]


def _scale(virtual: VirtualObject, known: float, placement: Placement) -> tuple[float, list[str]]:
    """Return the height relative to the known object's, `known` in the user's units, and warnings."""
    if placement.scale is not None:
        return placement.scale, []
    own = _measure(virtual) / known
    if _PLAUSIBLE[0] <= own <= _PLAUSIBLE[1]:
        return own, []
    return _USUAL, [
        f"In its file's units the virtual object would be {own:.3g} times as high as the known object, so it is drawn "
        f"{_USUAL} times as high; --scale gives another height."
    ]


def _measure(virtual: VirtualObject) -> float:
    """Return the height of a virtual object, or of a flat one, such as a rug, the largest of its sides; > 0."""
    height, largest = float(virtual.size[2]), float(virtual.size.max())
    return max(height if height > _FLAT * largest else largest, 1e-9)


def _standing(virtual: VirtualObject, factor: float, turn: float, ground: float) -> VirtualObject:
    """Return the virtual object scaled and turned, the middle of its foot on the ground at x = y = 0."""
    cos, sin = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    rotation = torch.tensor([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]], dtype=torch.float64)
    points = virtual.vertices.double()
    points = (points - (points.amin(0) + points.amax(0)) / 2) @ rotation * factor  # large coordinates round
    points[:, 2] += ground - ground_height(points)
    foot = points[points[:, 2] <= ground + _FOOT * factor * float(virtual.size[2])][:, :2]
    points[:, :2] -= (foot.amin(0) + foot.amax(0)) / 2
    return replace(virtual, vertices=points.float(), normals=virtual.normals @ rotation.float())


def _beside(
    standing: VirtualObject, known: Tensor, camera: Camera, mask: np.ndarray
) -> tuple[np.ndarray, bool]:
    """Return the best of the places around the known object, and whether it is free and in the frame.

    Best: all of it in the frame, nothing before or behind the known object, far from the frame's edges.
    """
    points = standing.vertices[:: max(1, len(standing.vertices) // 2000)].numpy().astype(np.float64)
    known_points = known.numpy().astype(np.float64)[:, :2]
    middle = (known_points.min(0) + known_points.max(0)) / 2
    radius = np.linalg.norm(points[:, :2], axis=1).max()
    reach = np.linalg.norm(known_points - middle, axis=1).max() + (1 + _GAP) * radius
    best, score = middle, -np.inf
    for bearing in 2 * np.pi * np.arange(_BEARINGS) / _BEARINGS:
        spot = middle + reach * np.array([np.cos(bearing), np.sin(bearing)])
        x, y, depth = camera.project(points + np.array([spot[0], spot[1], 0.0])).T
        share_x, share_y = x / camera.width, y / camera.height
        margin = np.minimum(np.minimum(share_x, 1 - share_x), np.minimum(share_y, 1 - share_y))
        inside = (margin > 0) & (depth > 0)
        column, row = (np.clip(v, 0, n - 1).astype(int) for v, n in ((x, camera.width), (y, camera.height)))
        hidden = float((mask[row, column] * inside).mean())
        value = float(inside.mean()) - hidden + 0.5 * min(float(margin.min()), 0.1)
        if value > score:
            best, score = spot, value
    return best, score >= 0.97


def _surface_points(vertices: Tensor, faces: Tensor) -> Tensor:
    """Return points (N, 3) spread evenly over a mesh (V, 3), (F, 3), its vertices among them."""
    area = face_normals(vertices, faces).norm(dim=1)
    random = generator(0, "surface")
    face = torch.multinomial(area + 1e-30, _SPREAD, replacement=True, generator=random)
    share = -torch.rand(_SPREAD, 3, generator=random).clamp(min=1e-9).log()  # a flat Dirichlet distribution
    share = share / share.sum(1, keepdim=True)
    return torch.cat([vertices, (vertices[faces[face].long()] * share[..., None]).sum(1)])


def _overlap(points: Tensor, known: Tensor) -> bool:
    """Return whether the known object (V, 3) has vertices within a virtual object with surface points (N, 3).

    Within: in a cell of the ground where the virtual object is, between its lowest and its highest point.
    """
    both = torch.cat([points, known.to(points)])
    low, size = points.amin(0), (points.amax(0) - points.amin(0)).clamp(min=1e-9)
    cell = ((both - low) / size[:2].amax() * _CELLS).long()
    within = ((both[:, :2] >= low[:2]) & (both[:, :2] <= low[:2] + size[:2])).all(1)
    key = torch.where(within, cell[:, 0] * (2 * _CELLS) + cell[:, 1], -1)
    mine, others = key[: len(points)], key[len(points) :]
    top = torch.full((4 * _CELLS**2,), -torch.inf).to(points)
    bottom = -top
    top = top.scatter_reduce(0, mine.clamp(min=0), points[:, 2], "amax")
    bottom = bottom.scatter_reduce(0, mine.clamp(min=0), points[:, 2], "amin")
    hit = others >= 0
    heights, cells = known.to(points)[hit, 2], others[hit]
    margin = 0.02 * float(size[2])
    return bool(((heights > bottom[cells] + margin) & (heights < top[cells] - margin)).any())
