"""The fixed textured object: what Phase I leaves behind, and its G-buffer for any camera."""

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from lightprobe.core.checkpoint import load_tensors, save_tensors
from lightprobe.core.run import REMAKE
from lightprobe.core.stored import TensorRule, check_tensors, damaged, remedied
from lightprobe.geometry.mesh import Mesh, uv_tangents
from lightprobe.geometry.textures import Textures, sample
from lightprobe.light.prefilter import BLOCKS
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.surface import Surface, View, face_camera, visible_surface
from lightprobe.render.visibility import SIDE, PointVisibility, VertexVisibility, vertex_visibility
from lightprobe.scene.camera import Camera

_FARTHEST = 1e3  # radii; no vertex of a normalised object is anywhere near
_SLACK = 1e-3  # of values between 0 and 1
_SMALLEST_TEXTURE = 2  # texels along an edge, between which a look-up interpolates

# in the order of the fields of `Mesh` and `Textures`
_RULES = {
    "vertices": TensorRule(("V", 3), low=-_FARTHEST, high=_FARTHEST),
    "faces": TensorRule(("F", 3), torch.int32, below="V"),
    "uvs": TensorRule(("U", 2), low=-_SLACK, high=1 + _SLACK),
    "uv_faces": TensorRule(("F", 3), torch.int32, below="U"),
    "base_color": TensorRule(("S", "S", 3), low=-_SLACK, high=1 + _SLACK),
    "roughness": TensorRule(("S", "S"), low=-_SLACK, high=1 + _SLACK),
    "metallic": TensorRule(("S", "S"), low=-_SLACK, high=1 + _SLACK),
    "normal": TensorRule(("S", "S", 3), low=-1 - _SLACK, high=1 + _SLACK),
}
_VISIBILITY = {  # as files name its two parts
    "openness": TensorRule(("V", 6 * BLOCKS**2), torch.uint8),
    "blockers": TensorRule(("V", 3), low=-_SLACK, high=1 + _SLACK),
}


@dataclass(frozen=True)
class Asset:
    """A mesh with its textures, in the normalised frame, and what each vertex sees of it."""

    mesh: Mesh
    textures: Textures
    visibility: VertexVisibility | None = None  # None: the object casts no shadows

    def to(self, device: torch.device) -> "Asset":
        """Return the asset on another device."""
        visibility = None if self.visibility is None else self.visibility.to(device)
        return Asset(self.mesh.to(device), self.textures.to(device), visibility)

    def tensors(self) -> dict[str, Tensor]:
        """Return all tensors by name."""
        parts = {**vars(self.mesh), **vars(self.textures)}
        if self.visibility is not None:
            stored = self.visibility.unoccluded, self.visibility.occluder_color
            parts |= dict(zip(_VISIBILITY, stored, strict=True))
        return {name: value for name, value in parts.items() if value is not None}

    @staticmethod
    def from_tensors(tensors: dict[str, Tensor], source: Path, remedy: str) -> "Asset":
        """Return the asset of `tensors`; raise `InputError` with `source` and `remedy` for unsound ones."""
        sees = "openness" in tensors
        rules = _RULES | (_VISIBILITY if sees else {})
        rules |= {"normal_faces": TensorRule(("F", 3), torch.int32, 0)} if "normal_faces" in tensors else {}
        check_tensors(tensors, rules, source, remedy)
        v = [tensors[name] for name in _RULES]
        mesh = Mesh(v[0], v[1], v[2], v[3], tensors.get("normal_faces"))
        if int(mesh.normal_index.max()) >= 3 * len(mesh.faces):  # no more normals than corners
            raise damaged(source, "'normal_faces' names more normals than there are corners", remedy)
        if len(v[4]) < _SMALLEST_TEXTURE:
            raise damaged(source, "its textures have a single texel", remedy)
        visibility = VertexVisibility(*(tensors[name] for name in _VISIBILITY)) if sees else None
        return Asset(mesh, Textures(*v[4:]), visibility)

    def save(self, path: Path) -> None:
        """Write the asset as one safetensors file."""
        save_tensors(path, self.tensors())

    @staticmethod
    def load(path: Path, remedy: str = REMAKE) -> "Asset":
        """Read the file written by `save`; raise `InputError` with the `remedy` when it holds no sound asset."""
        with remedied(remedy):
            return Asset.from_tensors(load_tensors(path), path, remedy)


def shading_normals(
    surface: Surface, mesh: Mesh, normals: Tensor, tangents: Tensor, mapped: Tensor
) -> Tensor:
    """Return `mapped_normals` (P, 3), bent until the camera sees them."""
    return face_camera(mapped_normals(surface, mesh, normals, tangents, mapped), surface.view)


def mapped_normals(surface: Surface, mesh: Mesh, normals: Tensor, tangents: Tensor, mapped: Tensor) -> Tensor:
    """Return unit normals (P, 3): tangent-space `mapped` (P, 3) in the frame of `normals` and `tangents`.

    `normals` (N, 3) as `Mesh.normals`, `tangents` (U, 3) per texture vertex. The bitangent is n x t times the
    sign of the UV orientation, with v pointing down as in glTF.
    """
    n = torch.nn.functional.normalize(surface.interpolate(normals, mesh.normal_index), dim=1, eps=1e-12)
    t = surface.interpolate(tangents, mesh.uv_faces)
    t = torch.nn.functional.normalize(t - (t * n).sum(1, keepdim=True) * n, dim=1, eps=1e-12)
    b = torch.linalg.cross(n, t) * uv_handedness(mesh, surface.face)[:, None]
    bent = mapped[:, :1] * t + mapped[:, 1:2] * b + mapped[:, 2:] * n
    return torch.nn.functional.normalize(bent, dim=1, eps=1e-12)


def textured_visibility(mesh: Mesh, flat: Tensor, side: int = SIDE) -> VertexVisibility:
    """Return what the vertices of a textured mesh see of it; `flat` (S * S, 8) as `Textures.flat`.

    A face has the base colour of its middle. side: pixels of a depth map.
    """
    colors = sample(flat, mesh.uvs[mesh.uv_faces.long()].mean(1))[:, :3]
    return vertex_visibility(mesh.vertices, mesh.faces, colors.contiguous(), side)


def uv_handedness(mesh: Mesh, face: Tensor | None = None) -> Tensor:
    """Return +1 or -1 per face (F,), or of the faces `face` (P,): the w of glTF's tangents.

    Their bitangent points along increasing -v.
    """
    corners = mesh.uv_faces if face is None else mesh.uv_faces[face]
    t = mesh.uvs[corners.long()]
    (u1, v1), (u2, v2) = (t[:, 1] - t[:, 0]).unbind(1), (t[:, 2] - t[:, 0]).unbind(1)
    return torch.where(u1 * v2 - u2 * v1 > 0, -1.0, 1.0)


def gbuffer_of(
    surface: Surface, view: View, normal: Tensor, material: Tensor, visibility: PointVisibility | None = None
) -> GBuffer:
    """Return the G-buffer of a visible surface with `normal` (P, 3) and `material` (P, >=5)."""
    points = surface.pixel, surface.face, surface.position, normal, surface.view
    look = material[:, :3], material[:, 3], material[:, 4]
    return GBuffer(view.height, view.width, *points, *look, visibility, view.support)


def textured_gbuffer(
    surface: Surface,
    view: View,
    mesh: Mesh,
    flat: Tensor,
    tangents: Tensor,
    visibility: VertexVisibility | None = None,
) -> GBuffer:
    """Return the G-buffer of a textured mesh; `flat` (S * S, 8) as `Textures.flat`; differentiable in both."""
    material = sample(flat, surface.interpolate(mesh.uvs, mesh.uv_faces))
    shading = shading_normals(surface, mesh, mesh.normals(), tangents, material[:, 5:])
    if visibility is None:
        return gbuffer_of(surface, view, shading, material)
    points = PointVisibility.of(visibility, mesh.faces, surface.face, surface.barycentric)
    return gbuffer_of(surface, view, shading, material, points)


def rasterize_asset(asset: Asset, camera: Camera, device: torch.device) -> GBuffer:
    """Return the G-buffer of the asset seen by a normalised-frame camera."""
    view = View.of(camera, device)
    surface = visible_surface(asset.mesh.vertices, asset.mesh.faces, view)
    return asset_gbuffer(asset, surface, view)


def asset_gbuffer(asset: Asset, surface: Surface, view: View) -> GBuffer:
    """Return the G-buffer of the asset's visible surface."""
    flat, tangents = asset.textures.flat(), uv_tangents(asset.mesh)
    return textured_gbuffer(surface, view, asset.mesh, flat, tangents, asset.visibility)
