"""The fixed textured object: what Phase I leaves behind, and its G-buffer for any camera."""

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from lightprobe.core.checkpoint import load_tensors, save_tensors
from lightprobe.core.errors import InputError
from lightprobe.geometry.mesh import Mesh, uv_tangents
from lightprobe.material.textures import Textures, sample
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.openness import Openness, Surroundings
from lightprobe.render.surface import Surface, View, face_camera, visible_surface
from lightprobe.render.surroundings import surroundings
from lightprobe.scene.camera import Camera

_FIELDS = ("vertices", "faces", "uvs", "uv_faces", "base_color", "roughness", "metallic", "normal")
_SHADOWS = ("openness", "blockers")


@dataclass(frozen=True)
class Asset:
    """A mesh with its textures, in the normalised frame, and what of its surroundings each vertex sees."""

    mesh: Mesh
    textures: Textures
    around: Surroundings | None = None  # None: the object casts no shadows

    def to(self, device: torch.device) -> "Asset":
        """Return the asset on another device."""
        around = None if self.around is None else self.around.to(device)
        return Asset(self.mesh.to(device), self.textures.to(device), around)

    def tensors(self) -> dict[str, Tensor]:
        """Return all tensors by name."""
        parts = {**vars(self.mesh), **vars(self.textures), **(vars(self.around) if self.around else {})}
        return {name: value for name, value in parts.items() if value is not None}

    @staticmethod
    def from_tensors(tensors: dict[str, Tensor]) -> "Asset":
        """Return the asset of `tensors`."""
        v = [tensors[name] for name in _FIELDS]
        mesh = Mesh(v[0], v[1], v[2], v[3], tensors.get("normal_faces"))
        shadows = "openness" in tensors
        return Asset(mesh, Textures(*v[4:]), Surroundings(*(tensors[n] for n in _SHADOWS)) if shadows else None)

    def save(self, path: Path) -> None:
        """Write the asset as one safetensors file."""
        save_tensors(path, self.tensors())

    @staticmethod
    def load(path: Path) -> "Asset":
        """Read the file written by `save`."""
        tensors = load_tensors(path)
        needed = _FIELDS + (_SHADOWS if "openness" in tensors else ())
        missing = [name for name in needed if name not in tensors]
        if missing:
            raise InputError(f"{path} is not an asset file: it has no '{missing[0]}'; run `lightprobe fit` again.")
        return Asset.from_tensors(tensors)


def shading_normals(surface: Surface, mesh: Mesh, normals: Tensor, tangents: Tensor, mapped: Tensor) -> Tensor:
    """Return unit shading normals (P, 3): tangent-space `mapped` (P, 3) in the frame of `normals` and `tangents`.

    `normals` (N, 3) as `Mesh.normals`, `tangents` (U, 3) per texture vertex. The bitangent is n x t times the sign of
    the UV orientation, with v pointing down as in glTF.
    """
    n = torch.nn.functional.normalize(surface.interpolate(normals, mesh.normal_index), dim=1, eps=1e-12)
    t = surface.interpolate(tangents, mesh.uv_faces)
    t = torch.nn.functional.normalize(t - (t * n).sum(1, keepdim=True) * n, dim=1, eps=1e-12)
    b = torch.linalg.cross(n, t) * uv_handedness(mesh)[surface.face][:, None]
    bent = mapped[:, :1] * t + mapped[:, 1:2] * b + mapped[:, 2:] * n
    return face_camera(torch.nn.functional.normalize(bent, dim=1, eps=1e-12), surface.view)


def textured_surroundings(mesh: Mesh, flat: Tensor) -> Surroundings:
    """Return what the vertices of a textured mesh see of it; `flat` (S * S, 8) as `Textures.flat`.

    A face has the base colour of its middle.
    """
    colors = sample(flat, mesh.uvs[mesh.uv_faces.long()].mean(1))[:, :3]
    return surroundings(mesh.vertices, mesh.faces, colors.contiguous())


def uv_handedness(mesh: Mesh) -> Tensor:
    """Return +1 or -1 per face (F,): the w of glTF's tangents, whose bitangent points along increasing -v."""
    t = mesh.uvs[mesh.uv_faces.long()]
    (u1, v1), (u2, v2) = (t[:, 1] - t[:, 0]).unbind(1), (t[:, 2] - t[:, 0]).unbind(1)
    return torch.where(u1 * v2 - u2 * v1 > 0, -1.0, 1.0)


def gbuffer_of(
    surface: Surface, view: View, normal: Tensor, material: Tensor, openness: Openness | None = None
) -> GBuffer:
    """Return the G-buffer of a visible surface with `normal` (P, 3) and `material` (P, >=5)."""
    return GBuffer(
        height=view.height, width=view.width, pixel=surface.pixel, face=surface.face, position=surface.position,
        normal=normal, view=surface.view, base_color=material[:, :3], roughness=material[:, 3],
        metallic=material[:, 4], openness=openness,
    )  # fmt: skip


def textured_gbuffer(
    surface: Surface, view: View, mesh: Mesh, flat: Tensor, tangents: Tensor, around: Surroundings | None = None
) -> GBuffer:
    """Return the G-buffer of a textured mesh; `flat` (S * S, 8) as `Textures.flat`; differentiable in both."""
    material = sample(flat, surface.interpolate(mesh.uvs, mesh.uv_faces))
    shading = shading_normals(surface, mesh, mesh.normals(), tangents, material[:, 5:])
    openness = None if around is None else Openness.of(around, mesh.faces, surface.face, surface.barycentric)
    return gbuffer_of(surface, view, shading, material, openness)


def rasterize_asset(asset: Asset, camera: Camera, device: torch.device) -> GBuffer:
    """Return the G-buffer of the asset seen by a normalised-frame camera."""
    view = View.of(camera, device)
    surface = visible_surface(asset.mesh.vertices, asset.mesh.faces, view)
    return asset_gbuffer(asset, surface, view)


def asset_gbuffer(asset: Asset, surface: Surface, view: View) -> GBuffer:
    """Return the G-buffer of the asset's visible surface."""
    return textured_gbuffer(surface, view, asset.mesh, asset.textures.flat(), uv_tangents(asset.mesh), asset.around)
