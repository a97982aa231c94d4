"""The object of the measurements: a ball with blotchy material that knows its own shadows, so no data are
needed.
"""

import math

import numpy as np
import torch
import trimesh
from torch import Tensor

from lightprobe.geometry.atlas import triangle_atlas
from lightprobe.geometry.mesh import Mesh
from lightprobe.light import cubemap, prefilter
from lightprobe.material.textures import Textures
from lightprobe.render.asset import Asset, textured_visibility
from lightprobe.render.picture import Picture
from lightprobe.scene.camera import Camera
from lightprobe.scene.photo import Pixels

CPU = torch.device("cpu")
LIT = 16  # texels along each edge of the lights that photos to train on are taken in
DISTANCE, FOCAL = 3.2, 1.4  # of the cameras: from the ball's centre in radii, and per side of the picture
COVERED = math.pi * FOCAL**2 / (DISTANCE**2 - 1)  # share of the picture that the ball fills


def ball(subdivisions: int, texture_size: int = 1024) -> Asset:
    """Return a unit ball of 20 * 4^n triangles."""
    shape = trimesh.creation.icosphere(subdivisions)
    vertices = torch.from_numpy(np.asarray(shape.vertices)).float()
    faces = torch.from_numpy(np.asarray(shape.faces).astype(np.int32))
    uvs, uv_faces = triangle_atlas(len(faces), texture_size)
    size = (texture_size, texture_size)
    blotches = torch.rand(1, 5, 8, 8, generator=torch.Generator().manual_seed(5))
    maps = torch.nn.functional.interpolate(blotches, size, mode="bilinear")[0].permute(1, 2, 0).contiguous()
    up = torch.tensor([0.0, 0.0, 1.0]).expand(*size, 3).contiguous()
    textures = Textures(0.1 + 0.8 * maps[..., :3], 0.2 + 0.5 * maps[..., 3], (maps[..., 4] > 0.6).float(), up)
    mesh = Mesh(vertices, faces, torch.from_numpy(uvs).float(), torch.from_numpy(uv_faces.astype(np.int32)))
    return Asset(mesh, textures, textured_visibility(mesh, textures.flat()))


def camera(side: int, number: int = 0, count: int = 1) -> Camera:
    """Return one of `count` cameras spread all around, in whose square picture the ball fills most of the
    frame.
    """
    height, around = 1 - (2 * number + 1) / count, number * math.pi * (3 - math.sqrt(5))
    ring = math.sqrt(1 - height**2)
    back = np.array([ring * math.cos(around), ring * math.sin(around), height])
    right = np.array([-math.sin(around), math.cos(around), 0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
    pose[:3, 3] = DISTANCE * back
    return Camera(pose, FOCAL * side, FOCAL * side, side / 2, side / 2, side, side)


def light(resolution: int, number: int = 0) -> Tensor:
    """Return a soft lamp in a dim room, (6, R, R, 3); each number has its lamp elsewhere."""
    toward = torch.tensor([0.6 * math.cos(2.4 * number), 0.6 * math.sin(2.4 * number), 0.8])
    facing = cubemap.directions(resolution) @ toward
    return 0.3 + 3 * torch.exp(8 * (facing - 1))[..., None] * torch.tensor([1.0, 0.8, 0.6])


@torch.no_grad()
def photograph(asset: Asset, view: Camera, env: Tensor) -> Pixels:
    """Return the photo of the asset in the light env (6, R, R, 3)."""
    image, cover = Picture.of(asset, view, prefilter.cached(env.shape[1], CPU), CPU).render(env)
    color = image / cover[..., None].clamp(min=1e-6)
    return Pixels.of(color.clamp(max=1).numpy(), cover.numpy())
