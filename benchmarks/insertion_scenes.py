"""Generated objects as the product knows them, and the camera that looks at two of them on the ground."""

from dataclasses import dataclass, replace

import numpy as np
import torch

from demo_scene.geometry import weld
from demo_scene.textures import Model
from lightprobe.geometry.mesh import Mesh
from lightprobe.geometry.textures import Textures
from lightprobe.imaging import resize_area
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.render.asset import Asset, textured_visibility
from lightprobe.scene.camera import Camera, Similarity

_TEXTURE = 1024  # texels of the known object's textures
_ANGLE = 0.72  # horizontal field of view
_DISTANCE, _ELEVATION = 4.6, 0.42


@dataclass(frozen=True)
class Case:
    """One scene."""

    name: str
    light: str  # a photographed environment of the demo's
    turn: int  # columns it is rolled by
    azimuth: float  # of the camera
    scale: float  # the second pot's height relative to the first one's


CASES = (
    Case("hills", "immenstadter_horn", 20, 0.6, 0.35),
    Case("studio", "brown_photostudio_06", 75, 2.4, 0.8),
    Case("hall", "dancing_hall", 40, 4.4, 0.5),
)


def true_decomposition(model: Model) -> Decomposition:
    """Return the object as if reconstructed without an error; its frame is the normalised one."""
    vertices, faces = model.vertices, model.faces
    points, welded = weld(vertices, faces)
    if len(welded) != len(faces):  # texture corners belong to faces, none of which may be lost
        points, index = np.unique(np.round(vertices, 6), axis=0, return_inverse=True)
        welded = index.reshape(-1)[faces]
    # A part's own vertices, split along its creases, keep its normals apart.
    both = np.round(np.concatenate([vertices, model.normals], 1), 4)
    creases = np.unique(both, axis=0, return_inverse=True)[1].reshape(-1)[faces]
    corners, texture, normal = (torch.from_numpy(f.astype(np.int32)) for f in (welded, faces, creases))
    mesh = Mesh(
        torch.from_numpy(points).float(), corners, torch.from_numpy(model.uv).float(), texture, normal
    )
    material = model.material
    base, rough, metal = (
        torch.from_numpy(resize_area(plane.astype(np.float32), _TEXTURE, _TEXTURE))
        for plane in (material.base, material.roughness, material.metallic)
    )
    flat = torch.zeros(_TEXTURE, _TEXTURE, 3)
    flat[..., 2] = 1
    textures = Textures(base, rough, metal, flat)
    asset = Asset(mesh, textures, textured_visibility(mesh, textures.flat()))
    return Decomposition(asset, {"none": Environment(torch.ones(6, 8, 8, 3))}, Similarity(np.zeros(3), 1.0))


def camera_of(case: Case, side: int, ground: float) -> Camera:
    """Return the camera of a scene's photo, which looks at the known object from above."""
    flat, up = np.cos(_ELEVATION), np.sin(_ELEVATION)
    direction = np.array([np.cos(case.azimuth) * flat, np.sin(case.azimuth) * flat, up])
    right = np.array([-direction[1], direction[0], 0.0]) / np.hypot(*direction[:2])
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2] = right, np.cross(direction, right), direction
    pose[:3, 3] = _DISTANCE * direction + 0.35 * right + [0, 0, 0.35 * ground]
    focal = 0.5 * side / np.tan(0.5 * _ANGLE)
    return Camera(pose, focal, focal, side / 2, side / 2, side, side)


def moved(model: Model, matrix: np.ndarray, offset: np.ndarray) -> Model:
    """Return the object with its points turned and scaled by `matrix` (3, 3) and then moved by `offset` (3,)."""
    normals = model.normals @ matrix.T / np.cbrt(np.linalg.det(matrix))
    return replace(model, vertices=model.vertices @ matrix.T + offset, normals=normals)
