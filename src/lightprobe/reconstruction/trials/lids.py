"""Cavities that a visual hull closes with a lid: the mouth of a vase, the inside of a cup or a bowl.

A lid is a connected part of the surface that faces one way, flat or domed. The cavity behind it follows the
rest of the surface at the distance of a wall, as the inside of a vessel follows its outside, down to some
depth.

Notation: V vertices of the surface, F faces, L vertices of the lattice; lengths are in object radii.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy

_AXES = np.concatenate([np.eye(3), -np.eye(3)])  # ways that a lid may face
_FACING = math.cos(math.radians(40))  # least cosine between a lid's normals and its axis
_SMALLEST = 0.015  # share of the surface that is worth opening
_SMOOTHING = 8  # rounds in which normals are averaged with those around: a hull's surface is rough
_RINGS = 2  # of vertices on either side of a dent's steep sides that are bridged: photos have bent the lid
_GAP = 0.25  # share of a lid's area, up to which a dent that it surrounds is a part of it
_NEAREST, _BLUR = 24, 2.0  # vertices whose tangent planes are averaged, and over how many lattice cells
_TOUCHING = 1.5  # lattice cells between a lid and the first lattice vertices of the cavity behind it


@dataclass(frozen=True)
class ClosedSurface:
    """A surface that bounds a solid."""

    vertices: np.ndarray  # (V, 3) float32
    normals: np.ndarray  # (V, 3) float32, unit, outwards
    faces: np.ndarray  # (F, 3) int32


@dataclass(frozen=True)
class LatticeSolid:
    """A solid as signed distances on a lattice."""

    distance: np.ndarray  # (L,) float32, inside < 0
    points: np.ndarray  # (L, 3) float32
    edges: np.ndarray  # (E, 2) int64: which points are neighbours
    cell: float  # how far apart these are


@dataclass(frozen=True)
class Lid:
    """A part of a surface that may close a cavity."""

    vertices: np.ndarray  # (V,) bool: which of the surface's vertices belong to it
    radius: float  # of the disc with its area


def without_voids(solid: LatticeSolid, border: np.ndarray) -> np.ndarray:
    """Return the signed distances (L,) float32 of a solid whose voids, which nothing can see, are filled.

    border (L,) bool: the lattice's outermost points, which are outside. Filled points are a cell deep.
    """
    outside = solid.distance >= 0
    voids = outside & ~_connected(outside, border, solid.edges)
    return np.where(voids, np.float32(-solid.cell), solid.distance)


def find_lids(surface: ClosedSurface) -> list[Lid]:
    """Return the parts of a surface that may be lids, the largest first."""
    vertices, faces, count = surface.vertices, surface.faces, len(surface.vertices)
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    links = scipy.sparse.coo_array((np.ones(len(pairs)), pairs.T), shape=(count, count)).tocsr()
    links = ((links + links.T) > 0).astype(np.float64)
    smooth = _averaged(surface.normals, links)
    areas = _vertex_areas(vertices, faces)
    lids = []
    for axis in _AXES:
        facing = np.flatnonzero(smooth @ axis > _FACING)
        parts, labels = scipy.sparse.csgraph.connected_components(links[facing][:, facing], directed=False)
        sizes = np.bincount(labels, areas[facing], minlength=parts)
        for part in np.flatnonzero(sizes > _SMALLEST * areas.sum()):
            chosen = np.zeros(count, bool)
            chosen[facing[labels == part]] = True
            chosen = _with_dents(chosen, links, areas, vertices @ axis)
            lids.append(Lid(chosen, math.sqrt(areas[chosen].sum() / math.pi)))
    return sorted(lids, key=lambda lid: -lid.radius)


def hollowed(
    solid: LatticeSolid, surface: ClosedSurface, lid: Lid, *, wall: float, depth: float
) -> np.ndarray:
    """Return the signed distances (L,) float32, inside < 0, of a solid with a cavity behind a lid.

    The cavity stays `wall` away from all of the surface but the lid, and goes no further than `depth` from
    the lid. Away from the surface the distances are bounds. Where there is no room they are those of the
    solid.
    """
    if lid.vertices.all():
        return solid.distance
    near = np.flatnonzero(solid.distance < solid.cell)
    points, own = solid.points[near], lid.vertices
    to_lid = scipy.spatial.cKDTree(surface.vertices[own]).query(points)[0]
    to_wall = _depth_below(points, surface.vertices[~own], surface.normals[~own], solid.cell)
    hollow = np.full(len(solid.distance), -np.inf)
    hollow[near] = np.minimum(to_wall - wall, depth - to_lid)
    behind_lid = np.zeros(len(hollow), bool)
    behind_lid[near] = to_lid < _TOUCHING * solid.cell
    empty = hollow > 0
    pockets = empty & ~_connected(empty, behind_lid, solid.edges)
    if np.array_equal(empty, pockets):
        return solid.distance
    hollow[pockets] = -np.inf
    return np.maximum(solid.distance, hollow).astype(np.float32)


def _depth_below(points: np.ndarray, vertices: np.ndarray, normals: np.ndarray, cell: float) -> np.ndarray:
    """Return how far points (K, 3) are below a surface, (K,), of its vertices (W, 3) and unit normals (W, 3).

    The mean distance from the tangent planes of the nearest vertices (implicit moving least squares, Kolluri
    2005): the distance from the nearest vertex itself would have its gradient towards that vertex and not
    along the normal.
    """
    distance, nearest = scipy.spatial.cKDTree(vertices).query(points, k=min(_NEAREST, len(vertices)))
    weight = np.exp((distance[:, :1] ** 2 - distance**2) / (_BLUR * cell) ** 2)
    planes = ((vertices[nearest] - points[:, None]) * normals[nearest]).sum(2)
    return np.where(planes[:, 0] > 0, (weight * planes).sum(1) / weight.sum(1), -distance[:, 0])


def _connected(chosen: np.ndarray, ends: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return which of the chosen (L,) bool a path of chosen ones connects to a chosen one of the `ends`."""
    count = len(chosen)
    kept = edges[chosen[edges].all(1)]
    links = scipy.sparse.coo_array((np.ones(len(kept)), kept.T), shape=(count, count))
    labels = scipy.sparse.csgraph.connected_components(links, directed=False)[1]
    return chosen & np.isin(labels, np.unique(labels[chosen & ends]))


def _with_dents(
    chosen: np.ndarray, links: "scipy.sparse.csr_array", areas: np.ndarray, height: np.ndarray
) -> np.ndarray:
    """Return a lid, (V,) bool, with the sides of its dents, around which a pillar would be left behind it.

    links (V, V): of neighbours; areas (V,): of the vertices; height (V,): along the way that the lid faces.
    What stands out of the lid, as a knob does, is no part of it.
    """
    closed, top = chosen, height[chosen].max()
    for _ in range(_RINGS):
        closed = closed | (links @ closed > 0)
    for _ in range(_RINGS):
        closed = closed & ~(links @ ~closed > 0)
    closed = chosen | closed & (height <= top)
    rest = np.flatnonzero(~closed)
    parts, labels = scipy.sparse.csgraph.connected_components(links[rest][:, rest], directed=False)
    beside = np.zeros(parts, bool)
    beside[labels[links[rest] @ closed > 0]] = True
    highest = np.full(parts, -np.inf)
    np.maximum.at(highest, labels, height[rest])
    small = np.bincount(labels, areas[rest], minlength=parts) < _GAP * areas[closed].sum()
    dents = beside & small & (highest <= top)
    closed[rest[dents[labels]]] = True
    return closed


def _averaged(normals: np.ndarray, links: "scipy.sparse.csr_array") -> np.ndarray:
    """Return unit normals (V, 3), averaged with those of linked vertices again and again."""
    for _ in range(_SMOOTHING):
        normals = normals + links @ normals
        normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return normals


def _vertex_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return a third of the area of all faces at each vertex, (V,)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
    return np.bincount(faces.reshape(-1), np.repeat(areas, 3), minlength=len(vertices))
