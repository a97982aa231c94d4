"""The oracle asset: the true object of a synthetic scene in place of the reconstructed one.

The mesh is the scene's `mesh.obj`; base colour, roughness, metallic and shading normal are gathered from the
truth maps of the test photos that see each texel. What no test photo sees takes the material of the nearest
point that one does, and the mesh's own normal. With it, an evaluation shows the predictor's own error; what
is missing to the run's asset is the asset's.

Notation: K texels on the surface; maps of a photo are (H, W, 8): base colour 3, roughness, metallic, world
normal 3.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy
import torch
from torch import Tensor
from torch.nn import functional

from lightprobe.core.errors import InputError
from lightprobe.evaluation.truth import material_maps, read_true_mesh
from lightprobe.geometry.atlas import triangle_atlas, triangle_atlas_size
from lightprobe.geometry.mesh import Mesh, crease_normals, decimate, uv_tangents
from lightprobe.geometry.texels import fill_texels, texel_points
from lightprobe.kernels import rasterize
from lightprobe.material.textures import Textures
from lightprobe.models import Decomposition
from lightprobe.render.asset import Asset, textured_visibility, uv_handedness
from lightprobe.render.surface import View
from lightprobe.scene.photo import Photo, Scene

_MAX_FACES = 80_000  # before subdivision; decimated further, thin sheets with open edges get holes
_LONGEST_EDGE = 0.08  # radii; visibility lives on the vertices, so large faces need more of them
_LARGEST_TEXTURE = 3072  # texels along an edge, for memory
_TEXELS_PER_FACE = 10  # along an edge of the square that two triangles share
_CREASE_DEGREES = 40.0  # edges that turn by more are sharp
_DEPTH_TOLERANCE = 0.01  # radii
_DOUBTFUL = 1e-3  # summed weight below which a normal is not believed
_NEIGHBOURS = 200_000  # seen points that unseen ones choose from


def can_be_oracle(scene: Scene) -> bool:
    """Return whether the scene brings its object: a mesh, and material maps for test photos."""
    return (scene.root / "mesh.obj").is_file() and any(_complete(photo) for photo in scene.test)


def oracle_decomposition(
    decomposition: Decomposition, scene: Scene, saved: Path | None = None
) -> Decomposition:
    """Return the decomposition with the true object in place of its own; lights and frame stay.

    The true object is kept in the file `saved` and read from there the next time. Raises `InputError` when
    the scene does not bring its object, or brings a mesh or maps that cannot be used.
    """
    if not can_be_oracle(scene):
        raise InputError(
            f"{scene.root} has no mesh.obj with material maps of test photos, so there is no true object."
        )
    if saved is not None and saved.is_file():
        return _with_asset(decomposition, Asset.load(saved, "remove it, and it is made again"))
    asset = true_asset(scene)
    if saved is not None:
        asset.save(saved)
    return _with_asset(decomposition, asset)


def _with_asset(decomposition: Decomposition, asset: Asset) -> Decomposition:
    """Return the decomposition with a true asset, which needs no calibration and leaves no doubt."""
    return replace(decomposition, asset=asset, trained=None, calibration=None, verdict=None)


@torch.no_grad()
def true_asset(scene: Scene) -> Asset:
    """Return the scene's true object in the normalised frame."""
    mesh = _true_mesh(scene)
    size = min(_LARGEST_TEXTURE, triangle_atlas_size(len(mesh.faces), _TEXELS_PER_FACE))
    uvs, uv_faces = triangle_atlas(len(mesh.faces), size)
    corners = torch.from_numpy(uv_faces.astype(np.int32))
    mesh = replace(mesh, uvs=torch.from_numpy(uvs).float(), uv_faces=corners)
    face, barycentric, texel = texel_points(mesh, size)
    position = (mesh.vertices[mesh.faces[face].long()] * barycentric[..., None]).sum(1)
    smooth = (mesh.normals()[mesh.normal_index[face].long()] * barycentric[..., None]).sum(1)
    smooth = functional.normalize(smooth, dim=1)
    material = _gathered(mesh.vertices, mesh.faces, position, smooth, scene)
    material[:, 5:] = _to_tangent_space(mesh, face, barycentric, smooth, material[:, 5:])
    flat = torch.zeros(size * size, 8)
    flat[texel] = material
    flat = fill_texels(flat, texel, size)
    return Asset(mesh, Textures.from_flat(flat), textured_visibility(mesh, flat))


def _true_mesh(scene: Scene) -> Mesh:
    """Return the mesh in the normalised frame, its texture coordinates still to be made."""
    import trimesh

    true = read_true_mesh(scene.root / "mesh.obj")
    true.merge_vertices()
    vertices, faces = decimate(np.asarray(true.vertices), np.asarray(true.faces), _MAX_FACES)
    vertices = scene.similarity.apply(np.asarray(vertices, np.float64))
    vertices, faces = trimesh.remesh.subdivide_to_size(vertices, faces, _LONGEST_EDGE)[:2]
    corners, triangles = torch.from_numpy(vertices).float(), torch.from_numpy(faces.astype(np.int32))
    creases = crease_normals(corners, triangles, _CREASE_DEGREES)
    return Mesh(corners, triangles, torch.zeros(1, 2), torch.zeros_like(triangles), creases)


def _gathered(vertices: Tensor, faces: Tensor, position: Tensor, normal: Tensor, scene: Scene) -> Tensor:
    """Return the material (K, 8) at surface points, normals in world axes, averaged over photos.

    normal (K, 3) is the mesh's own, which stays where no photo tells.
    """
    total, weights = torch.zeros(len(position), 8), torch.zeros(len(position), 1)
    for photo in filter(_complete, scene.test):
        view = View.of(photo.camera.normalised(scene.similarity), position.device)
        inverse = rasterize(view.project(vertices), faces, view.height, view.width).inverse_depth
        values, weight = _seen_by(photo, view, inverse, position, normal)
        total += weight * values
        weights += weight
    seen = weights[:, 0] > 0
    if not seen.any():
        raise InputError(
            f"No test photo of {scene.root} shows the object in mesh.obj; are they in one frame?"
        )
    total[seen] /= weights[seen]
    known = seen.nonzero()[:, 0]
    known = known[:: max(1, len(known) // _NEIGHBOURS)]
    nearest = scipy.spatial.cKDTree(position[known].numpy()).query(position[~seen].numpy())[1]
    total[~seen] = total[known[torch.from_numpy(np.asarray(nearest))]]
    doubtful = weights[:, 0] < _DOUBTFUL
    total[doubtful, 5:] = normal[doubtful]
    return total


def _seen_by(
    photo: Photo, view: View, inverse: Tensor, position: Tensor, normal: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the photo's maps (K, 8) at surface points and their weight (K, 1), 0 where a point is hidden.

    At the edges of surfaces a map's pixels mix two of them: in depth, or in a normal that is not the mesh's.
    """
    screen = view.project(position)
    place = (2 * screen[:, :2] / screen.new_tensor([view.width, view.height]) - 1)[None, None]
    maps, known = _maps(photo)
    planes = torch.cat([maps * known, known, _depth_range(inverse)[..., None]], -1).permute(2, 0, 1)[None]
    taken = functional.grid_sample(planes, place, mode="bilinear", align_corners=False)[0, :, 0].T
    values, share = taken[:, :8] / taken[:, 8:9].clamp(min=1e-6), taken[:, 8]
    depth = functional.grid_sample(inverse[None, None], place, mode="nearest", align_corners=False)[0, 0, 0]
    near = (screen[:, 2] * depth - 1).abs() < _DEPTH_TOLERANCE
    facing = functional.cosine_similarity(normal, view.position - position, dim=1).clamp(min=0)
    agreement = functional.cosine_similarity(normal, values[:, 5:], dim=1).clamp(min=0) ** 8
    unmixed = agreement * (taken[:, 9] < _DEPTH_TOLERANCE) + 1e-4
    return values, (facing.square() * unmixed * near * (share > 0.5))[:, None]


def _maps(photo: Photo) -> tuple[Tensor, Tensor]:
    """Return a photo's truth maps (H, W, 8), and where they are known (H, W, 1)."""
    base, orm, normal = material_maps(photo.truth, (photo.camera.height, photo.camera.width))
    if base is None or orm is None or normal is None:
        raise ValueError(photo.name)
    length = np.linalg.norm(normal, axis=-1, keepdims=True)
    maps = np.concatenate([base, orm[..., 1:], normal / np.maximum(length, 1e-6)], -1)
    return torch.from_numpy(maps), torch.from_numpy((length > 0.5).astype(np.float32))


def _depth_range(inverse: Tensor) -> Tensor:
    """Return (H, W): by how much of itself the depth changes within a pixel's neighbourhood of 3 x 3."""
    planes = inverse[None, None]
    high = functional.max_pool2d(planes, 3, stride=1, padding=1)
    low = -functional.max_pool2d(-planes, 3, stride=1, padding=1)
    return ((high - low) / high.clamp(min=1e-9))[0, 0]


def _to_tangent_space(mesh: Mesh, face: Tensor, barycentric: Tensor, n: Tensor, normal: Tensor) -> Tensor:
    """Return world normals (K, 3) in the frame, about the mesh's n (K, 3), of `shading_normals`."""
    t = (uv_tangents(mesh)[mesh.uv_faces[face].long()] * barycentric[..., None]).sum(1)
    t = functional.normalize(t - (t * n).sum(1, keepdim=True) * n, dim=1)
    b = torch.linalg.cross(n, t) * uv_handedness(mesh)[face][:, None]
    return functional.normalize(torch.stack([(normal * axis).sum(1) for axis in (t, b, n)], 1), dim=1)


def _complete(photo: Photo) -> bool:
    truth = photo.truth
    return truth.base_color is not None and truth.orm is not None and truth.normal is not None
