"""A painted object without symmetries, and photos of it in front of the light that it stands in."""

import dataclasses
from pathlib import Path

import numpy as np
import torch
from scipy.spatial import cKDTree

from lightprobe.evaluation import relight
from lightprobe.geometry.mesh import Mesh
from lightprobe.geometry.textures import Textures
from lightprobe.imaging import write_png
from lightprobe.light import equirect
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.render.asset import Asset
from lightprobe.render.surface import View
from lightprobe.scene.camera import Camera, Similarity
from lightprobe.scene.photo import Photo, Scene
from tests.known_scene import soft_sky
from tests.shapes import camera_at, sphere_mesh

CPU = torch.device("cpu")
SIMILARITY = Similarity(np.array([0.3, -0.2, 0.1]), 1.5)
SIZE, FOCAL = 128, 170.0
_TEXTURE = 256


def painted_asset() -> Asset:
    """Return an egg with a nose, in patches of random colours."""
    random = np.random.default_rng(3)
    mesh = sphere_mesh(4, _TEXTURE)
    ball = mesh.vertices
    nose = torch.exp(8 * (ball @ torch.tensor([0.6, 0.0, 0.8]) - 1))[:, None]
    shape = ball * torch.tensor([0.9, 0.65, 0.5]) * (1 + 0.35 * nose)
    mesh = Mesh(shape, mesh.faces, mesh.uvs, mesh.uv_faces)
    seeds, colors = random.normal(size=(60, 3)), random.uniform(0.05, 0.8, (60, 3))
    seeds /= np.linalg.norm(seeds, axis=1, keepdims=True)
    patch = cKDTree(seeds).query(ball.numpy()[mesh.faces.numpy()].mean(1))[1]
    down, across = np.mgrid[:_TEXTURE, :_TEXTURE]
    texel = (np.stack([across, down], -1).reshape(-1, 2) + 0.5) / _TEXTURE
    face = cKDTree(mesh.uvs.numpy()[mesh.uv_faces.numpy()].mean(1)).query(texel)[1]
    base = torch.from_numpy(colors[patch[face]].reshape(_TEXTURE, _TEXTURE, 3).astype(np.float32))
    flat = torch.full((_TEXTURE, _TEXTURE), 0.5)
    up = torch.tensor([0.0, 0.0, 1.0]).expand(_TEXTURE, _TEXTURE, 3)
    return Asset(mesh, Textures(base, flat, torch.zeros_like(flat), up))


def decomposition(asset: Asset) -> Decomposition:
    return Decomposition(asset, {}, SIMILARITY)


def view_from(position, *, size: int = SIZE, shift: float = 0.0) -> Camera:
    """Return a normalised-frame camera at `position`, moved sideways by `shift` against looking at the
    origin.
    """
    camera = camera_at(position, size=size, focal=FOCAL * size / SIZE)
    camera.camera_to_world[:3, 3] += shift * camera.camera_to_world[:3, 0]
    return camera


def in_input_frame(camera: Camera) -> Camera:
    pose = camera.camera_to_world.copy()
    pose[:3, 3] = SIMILARITY.invert(camera.position)
    return dataclasses.replace(camera, camera_to_world=pose)


def photo_of(asset: Asset, camera: Camera, seed: int, *, busy: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Return the linear photo (H, W, 3) by a normalised-frame camera under light number `seed`, and its mask
    (H, W).
    """
    sky = torch.from_numpy(soft_sky(seed))
    light = Environment(equirect.to_cubemap(sky, 32))
    image, cover = relight(decomposition(asset), light, in_input_frame(camera))
    rays = torch.nn.functional.normalize(
        View.of(camera, CPU).rays(torch.arange(camera.height * camera.width)), dim=1
    )
    behind = equirect.sample(sky, rays).reshape(camera.height, camera.width, 3)
    if busy:  # a smooth background has no edges that could be taken for the object's
        behind = behind * (0.6 + 0.4 * torch.sin(9 * rays.reshape(behind.shape)).sign())
    unit = 0.22 / float(image[cover > 0.5].mean())
    photo = (image + behind * (1 - cover[..., None])) * unit
    return photo.clamp(0, 1).numpy(), cover.numpy()


POSITIONS = [(2.6 * np.cos(a), 2.6 * np.sin(a), z) for a in (0.0, 0.35, 0.7, 1.05) for z in (0.7, 1.6)]


def painted_scene(folder: Path, asset: Asset) -> Scene:
    """Write eight photos of one side of the object, each under another light, and return their scene."""
    photos = []
    for index, position in enumerate(POSITIONS):
        camera = view_from(position)
        color, cover = photo_of(asset, camera, index)
        path = folder / f"train_{index}.png"
        write_png(path, color, cover)
        photos.append(Photo(f"train_{index}", in_input_frame(camera), path))
    return Scene(folder, "transforms", tuple(photos), (), (), SIMILARITY)
