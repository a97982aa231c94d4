"""Triangle meshes with texture coordinates, and the derived quantities shading needs.

Notation: V positions, F faces, U texture vertices. Positions and texture coordinates have their own face
arrays, so a vertex on a UV seam keeps one position and one smooth normal.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from lightprobe.kernels import gather_rows, scatter_rows


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh in the normalised frame, counter-clockwise seen from outside."""

    vertices: Tensor  # (V, 3) float32
    faces: Tensor  # (F, 3) int32
    uvs: Tensor  # (U, 2) float32 in [0, 1], v downwards in the image (row = v * height)
    uv_faces: Tensor  # (F, 3) int32 into uvs
    normal_faces: Tensor | None = None  # (F, 3) int32 into `normals()`, split at creases; None: all smooth

    def to(self, device: torch.device) -> "Mesh":
        """Return the mesh on another device."""
        parts = {name: part.to(device) for name, part in vars(self).items() if part is not None}
        return replace(self, **parts)

    @property
    def normal_index(self) -> Tensor:
        """The normal of each corner of each face, (F, 3) integer into `normals()`."""
        return self.faces if self.normal_faces is None else self.normal_faces

    def normals(self) -> Tensor:
        """Return the area-weighted unit normals (N, 3), differentiable in the positions."""
        count = len(self.vertices) if self.normal_faces is None else int(self.normal_faces.max()) + 1
        return _average_normals(face_normals(self.vertices, self.faces), self.normal_index, count)


def face_normals(vertices: Tensor, faces: Tensor) -> Tensor:
    """Return the outward normals (F, 3), their length twice the face area."""
    a, b, c = gather_rows(vertices, faces).unbind(1)
    return torch.linalg.cross(b - a, c - a)


def vertex_normals(vertices: Tensor, faces: Tensor) -> Tensor:
    """Return area-weighted unit vertex normals (V, 3), differentiable in the positions."""
    return _average_normals(face_normals(vertices, faces), faces, len(vertices))


def _average_normals(normals: Tensor, index: Tensor, count: int) -> Tensor:
    summed = scatter_rows(_to_corners(normals), index.reshape(-1), count)
    return torch.nn.functional.normalize(summed, dim=1, eps=1e-20)


def _to_corners(values: Tensor) -> Tensor:
    """Return a value of each face (F, C) for each of its corners, (3 F, C)."""
    return values[:, None].expand(-1, 3, -1).reshape(-1, values.shape[1])


def uv_tangents(mesh: Mesh) -> Tensor:
    """Return the unit tangents (U, 3) along +u of the texture vertices, area-weighted, not orthogonal to normals.

    A texture vertex whose faces have no UV area gets the x axis.
    """
    p = mesh.vertices.detach()[mesh.faces.long()]
    t = mesh.uvs[mesh.uv_faces.long()]
    e1, e2 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    (u1, v1), (u2, v2) = (t[:, 1] - t[:, 0]).unbind(1), (t[:, 2] - t[:, 0]).unbind(1)
    sign = torch.sign(u1 * v2 - u2 * v1)[:, None]
    tangent = sign * (e1 * v2[:, None] - e2 * v1[:, None])
    summed = scatter_rows(_to_corners(tangent), mesh.uv_faces.reshape(-1), mesh.uvs.shape[0])
    length = summed.norm(dim=1, keepdim=True)
    axis = torch.tensor([1.0, 0.0, 0.0], device=summed.device)
    return torch.where(length > 1e-12, summed / length.clamp(min=1e-12), axis)


@dataclass(frozen=True)
class EdgeFaces:
    """The unique edges of a mesh with the (up to) two faces beside each."""

    vertices: Tensor  # (E, 2) int64
    faces: Tensor  # (E, 2) int64; a border edge names its only face twice


def edge_faces(faces: Tensor, chosen: Tensor | None = None) -> EdgeFaces:
    """Return the edges of `faces` (F, 3); an edge with more than two faces keeps the first and the last.

    chosen: (V,) bool, by default all; an edge counts whose two vertices do.
    """
    f = faces.long()
    a, b = f.T.reshape(-1), torch.cat([f[:, 1], f[:, 2], f[:, 0]])
    if chosen is None:
        rows = torch.arange(len(a), device=a.device)
    else:
        rows = (chosen.index_select(0, a) & chosen.index_select(0, b)).nonzero()[:, 0]
        a, b = a.index_select(0, rows), b.index_select(0, rows)
    size = int(f.max()) + 1 if len(f) else 1
    key, order = torch.sort(torch.minimum(a, b) * size + torch.maximum(a, b), stable=True)
    face = rows[order] % max(len(f), 1)
    starts = torch.ones_like(key, dtype=torch.bool)
    starts[1:] = key[1:] != key[:-1]
    first = starts.nonzero()[:, 0]
    last = torch.cat([first[1:], first.new_tensor([len(key)])]) - 1
    return EdgeFaces(
        torch.stack([key[first] // size, key[first] % size], 1), torch.stack([face[first], face[last]], 1)
    )


def is_closed(vertices: Tensor, faces: Tensor) -> bool:
    """Return whether `faces` (F, 3) bound a solid and look outwards: each edge is there once either way."""
    f = faces.long()
    first, second = f.reshape(-1), f[:, [1, 2, 0]].reshape(-1)
    count = len(vertices)
    ahead, back = torch.sort(first * count + second).values, torch.sort(second * count + first).values
    a, b, c = vertices[f].unbind(1)
    return torch.equal(ahead, back) and float((a * torch.linalg.cross(b, c)).sum()) > 0


def crease_normals(vertices: Tensor, faces: Tensor, degrees: float) -> Tensor:
    """Return `normal_faces` (F, 3) int32 that keep faces apart where they meet at more than `degrees`.

    Corners share a normal when a fan of faces that turn by less leads from one to the other around their
    vertex.
    """
    import scipy.sparse as sp

    edges = edge_faces(faces)
    unit = torch.nn.functional.normalize(face_normals(vertices, faces), dim=1, eps=1e-20)
    first, second = edges.faces.unbind(1)
    smooth = (unit[first] * unit[second]).sum(1) > math.cos(math.radians(degrees))
    links = [
        torch.stack([_corner(faces, face[smooth], edges.vertices[smooth, end]) for face in (first, second)])
        for end in (0, 1)
    ]
    a, b = torch.cat(links, 1).cpu().numpy()
    graph = sp.coo_matrix((np.ones(len(a), np.int8), (a, b)), shape=(faces.numel(), faces.numel()))
    label = sp.csgraph.connected_components(graph, directed=False)[1]
    return torch.from_numpy(label.astype(np.int32)).reshape(-1, 3).to(faces.device)


def _corner(faces: Tensor, face: Tensor, vertex: Tensor) -> Tensor:
    """Return the flat index (E,) of the corner of `face` (E,) that lies at `vertex` (E,)."""
    return 3 * face + (faces[face].long() == vertex[:, None]).int().argmax(1)


def clean(
    vertices: np.ndarray, faces: np.ndarray, smallest_share: float = 0.01
) -> tuple[np.ndarray, np.ndarray]:
    """Drop degenerate faces, unused vertices, small connected parts, and parts that bound a void in the object.

    Small is less than `smallest_share` of the area. Takes and returns vertices (V, 3) float and faces (F, 3)
    int32, counter-clockwise seen from outside: so a void's bound encloses a negative volume, and nothing can
    see it.
    """
    import scipy.sparse as sp

    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 0] != faces[:, 2])]
    if len(faces) == 0:
        return vertices[:0], faces
    links = sp.coo_matrix(
        (np.ones(2 * len(faces), np.int8), (faces[:, [0, 1]].ravel(), faces[:, [1, 2]].ravel())),
        shape=(len(vertices), len(vertices)),
    )
    part = sp.csgraph.connected_components(links, directed=False)[1][faces[:, 0]]
    p = vertices[faces].astype(np.float64)
    area = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1)
    share = np.bincount(part, area) / max(area.sum(), 1e-30)
    # A closed part's volume is the same from anywhere; near it, rounding is least.
    corner = p - p.mean((0, 1))
    volume = np.bincount(part, (corner[:, 0] * np.cross(corner[:, 1], corner[:, 2])).sum(1))
    faces = faces[((share >= smallest_share) & (volume >= 0))[part]]
    used, renumbered = np.unique(faces, return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3).astype(np.int32)


def decimate(vertices: np.ndarray, faces: np.ndarray, max_faces: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the mesh reduced to about `max_faces` triangles by quadric edge collapse; a smaller one as it is.

    Takes and returns vertices (V, 3) and faces (F, 3); of a reduced mesh they are float32 and int32.
    """
    if len(faces) <= max_faces:
        return vertices, faces
    import fast_simplification

    v, f = fast_simplification.simplify(
        np.ascontiguousarray(vertices, np.float32),
        np.ascontiguousarray(faces, np.int32),
        target_count=max_faces,
    )
    return np.asarray(v, np.float32), np.asarray(f, np.int32)


def smooth(vertices: np.ndarray, faces: np.ndarray, rounds: int) -> np.ndarray:
    """Return the vertices (V, 3) float32 of a closed mesh without ripples of a few edges' length (Taubin 1995).

    Each of the `rounds` takes every vertex half way to the mean of its neighbours, and then all of them a
    little farther back, so that what is longer than the ripples neither fades nor shrinks. Faces (F, 3) stay
    as they are.
    """
    import trimesh

    shape = trimesh.Trimesh(vertices, faces, process=False)
    trimesh.smoothing.filter_taubin(shape, lamb=0.5, nu=0.52, iterations=2 * rounds)
    return np.asarray(shape.vertices, np.float32)
