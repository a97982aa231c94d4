"""The asset against ground truth, where a synthetic scene brings it: material, surface, relighting.

Truth is only ever read here, never by training or prediction.
"""

import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import torch
from torch import Tensor

from lightprobe.core.config.rendering import FAST_PICTURES, RenderConfig
from lightprobe.core.errors import InputError, LightprobeWarning
from lightprobe.evaluation.metrics import channel_scale, image_scores, mean_angle, on_white, psnr
from lightprobe.evaluation.relighting import Relighter, cameras_around
from lightprobe.evaluation.views import TestView
from lightprobe.imaging import read_hdr, read_ldr, srgb_encode
from lightprobe.kernels import rasterize
from lightprobe.light.environment import Environment
from lightprobe.models import Decomposition
from lightprobe.render.surface import View
from lightprobe.scene.photo import Photo, Scene, Truth

_VIEWS, _SIDE = 96, 256  # cameras, and pixels of their pictures, that decide which faces can be seen at all
Scores = dict[str, float]
_DARKEST = 3e-4  # linear base colour of the darkest grey that 8 bits of sRGB tell from black


def sample_surface(vertices: np.ndarray, faces: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Return `count` points (count, 3) float64 spread evenly by area over triangles."""
    rng = np.random.default_rng(seed)
    corners = np.asarray(vertices, np.float64)[faces]
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.linalg.norm(np.cross(e1, e2), axis=1)
    chosen = rng.choice(len(faces), size=count, p=area / area.sum())
    u, v = rng.random((2, count, 1))
    flip = u + v > 1
    u, v = np.where(flip, 1 - u, u), np.where(flip, 1 - v, v)
    return corners[chosen, 0] + u * e1[chosen] + v * e2[chosen]


def chamfer_distance(points: np.ndarray, reference: np.ndarray) -> float:
    """Return the mean of the two mean nearest-neighbour distances between point sets (N, 3) and (M, 3)."""
    there = scipy.spatial.cKDTree(reference).query(points)[0].mean()
    back = scipy.spatial.cKDTree(points).query(reference)[0].mean()
    return float((there + back) / 2)


def mesh_chamfer(
    mesh: tuple[np.ndarray, np.ndarray], truth: tuple[np.ndarray, np.ndarray], *, count: int = 40_000
) -> float:
    """Return the Chamfer distance of two meshes (vertices, faces) in one frame, in radii of the true object.

    Only faces that can be seen from somewhere outside count: nothing in a photo tells of the others. Points
    are drawn on each mesh on its own, so that equal meshes are as far apart as their points: about .005 with
    40 000.
    """
    vertices = truth[0]
    center = (vertices.min(0) + vertices.max(0)) / 2
    radius = float(np.linalg.norm(vertices - center, axis=1).max())
    clouds = []
    for seed, (v, f) in enumerate((mesh, truth)):
        local = (np.asarray(v, np.float64) - center) / radius
        clouds.append(sample_surface(local, f[outer_faces(local, f)], count, seed))
    return chamfer_distance(*clouds)


def outer_faces(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the sorted indices (K,) int64 of the faces of a mesh that any of 96 viewpoints all around sees.

    vertices (V, 3), faces (F, 3): the mesh, around the origin.
    """
    v, f = torch.as_tensor(vertices, dtype=torch.float32), torch.as_tensor(np.asarray(faces, np.int32))
    seen = np.zeros(len(f), bool)
    for camera in cameras_around(_VIEWS, _SIDE, float(np.linalg.norm(vertices, axis=1).max())):
        view = View.of(camera, v.device)
        face = rasterize(view.project(v), f, view.height, view.width).face
        seen[face[face >= 0].numpy()] = True
    return seen.nonzero()[0]


def asset_scores(
    decomposition: Decomposition, scene: Scene, materials: "MaterialScores", device: torch.device
) -> Scores:
    """Return what the scene's truth says of the asset; what cannot be scored is left out with a warning."""
    scores, mesh_file = materials.result(), scene.root / "mesh.obj"
    for score in (
        lambda: relight_scores(decomposition, scene, device),
        lambda: surface_scores(decomposition, mesh_file) if mesh_file.is_file() else {},
    ):
        try:
            scores |= score()
        except InputError as error:  # must not cost the other scores
            tell_unscored(error)
    return scores


def tell_unscored(error: InputError) -> None:
    """Warn that some of the truth cannot be used, so that not all of the object is scored."""
    warnings.warn(f"Not all of the object is scored. {error}", LightprobeWarning, stacklevel=3)


def read_true_mesh(path: Path) -> Any:
    """Return the mesh of a scene's true object as its file has it, as trimesh's `Trimesh`.

    Raises `InputError` where there is none in it.
    """
    import trimesh

    try:
        mesh = trimesh.load_mesh(path, process=False)
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    except Exception as error:  # the reader raises whatever its parsers do
        raise InputError(f"{path} cannot be read as a mesh: {error}.") from error
    if len(faces) == 0 or not 0 <= faces.min() <= faces.max() < len(vertices):
        raise InputError(f"{path} has no faces, or faces of vertices that it does not have.")
    if not np.isfinite(vertices).all():
        raise InputError(f"{path} has vertices that are no numbers.")
    return mesh


def surface_scores(decomposition: Decomposition, mesh_file: Path) -> Scores:
    """Return the mean symmetric Chamfer distance to the true mesh, in units of the object's radius.

    Raises `InputError` as `read_true_mesh`.
    """
    true, mesh = read_true_mesh(mesh_file), decomposition.asset.mesh
    vertices = decomposition.similarity.invert(mesh.vertices.detach().cpu().numpy())
    mine = vertices, mesh.faces.cpu().numpy()
    return {"chamfer": mesh_chamfer(mine, (np.asarray(true.vertices), true.faces))}


class MaterialScores:
    """Gathers the material of the object's pixels view by view and compares it with the truth maps."""

    def __init__(self) -> None:
        self._colors: list[tuple[Tensor, Tensor]] = []  # (predicted, true) linear base colours (N, 3)
        self._errors: dict[str, list[np.ndarray]] = {"roughness_mae": [], "metallic_mae": []}
        self._normals: list[tuple[np.ndarray, np.ndarray]] = []

    def add(self, view: TestView) -> None:
        """Add the pixels of a view that the photo and the asset both cover; views without truth add nothing.

        Raises `InputError`, and adds nothing, where a map is refused by `material_maps`.
        """
        size = view.gbuffer.height, view.gbuffer.width
        chosen = view.mask.reshape(-1)[view.gbuffer.pixel]
        pixel = view.gbuffer.pixel[chosen].cpu().numpy()
        maps = material_maps(view.photo.truth, size)
        color, orm, normal = (None if values is None else values.reshape(-1, 3)[pixel] for values in maps)
        if color is not None:
            self._colors.append((view.gbuffer.base_color[chosen].cpu(), torch.from_numpy(color)))
        if orm is not None:
            for name, mine, channel in (("roughness_mae", "roughness", 1), ("metallic_mae", "metallic", 2)):
                values = getattr(view.gbuffer, mine)[chosen].cpu().numpy()
                self._errors[name].append(np.abs(values - orm[:, channel]))
        if normal is not None:
            known = np.linalg.norm(normal, axis=1) > 0.5
            if known.any():
                self._normals.append((view.gbuffer.normal[chosen].cpu().numpy()[known], normal[known]))

    def result(self) -> Scores:
        """Return base colour PSNR (raw, and scaled by channel), ratio, errors and normal angle."""
        scores: Scores = {}
        if self._colors:
            mine, true = (torch.cat(parts) for parts in zip(*self._colors, strict=True))
            scores["base_color_psnr"] = _srgb_psnr(mine, true)
            scores["base_color_psnr_scaled"] = _srgb_psnr(mine * channel_scale(mine, true), true)
            scores |= _mean_ratios(mine, true)
        for name, errors in self._errors.items():
            if errors:
                scores[name] = float(np.concatenate(errors).mean())
        if self._normals:
            mine_normals, true_normals = (np.concatenate(parts) for parts in zip(*self._normals, strict=True))
            scores["normal_degrees"] = mean_angle(mine_normals, true_normals)
        return scores


def material_maps(
    truth: Truth, size: tuple[int, int]
) -> tuple[np.ndarray | None, np.ndarray | None, np.ndarray | None]:
    """Return linear base colour, ORM and world normals, (H, W, 3) float32 or None, for a `size` (H, W).

    Raises `InputError` where one cannot be read, has another size or fewer than three channels.
    """
    files = (
        (truth.base_color, lambda path: read_ldr(path)[0]),
        (truth.orm, lambda path: read_ldr(path, srgb=False)[0]),
        (truth.normal, read_hdr),
    )
    maps = (None if path is None else _in_colors(read(path), size, path) for path, read in files)
    base_color, orm, normal = maps
    return base_color, orm, normal


def _in_colors(image: np.ndarray, size: tuple[int, int], path: Path) -> np.ndarray:
    if image.shape[2] < 3:
        raise InputError(f"{path} has {image.shape[2]} channel(s); the truth of a material needs three.")
    return np.ascontiguousarray(_sized(image, size, path)[..., :3], np.float32)


def _sized(image: np.ndarray, size: tuple[int, int], path: Path) -> np.ndarray:
    """Return an image (H, W, C) of `size` (H, W); raise `InputError` naming its file for another size."""
    if image.shape[:2] != size:
        raise InputError(
            f"{path} has {image.shape[1]} x {image.shape[0]} pixels, but its photo {size[1]} x {size[0]}; truth is "
            "compared pixel by pixel."
        )
    return image


def _mean_ratios(mine: Tensor, true: Tensor) -> Scores:
    """Return the ratios of mean linear base colours (N, 3) to true ones: over all channels, and the worst."""
    means = [values.double().mean(0).clamp(min=_DARKEST) for values in (mine, true)]
    logs = (means[0] / means[1]).log()
    worst = logs[logs.abs().argmax()]
    return {"base_color_ratio": float(logs.mean().exp()), "base_color_ratio_worst": float(worst.exp())}


def relight_scores(
    decomposition: Decomposition, scene: Scene, device: torch.device, config: RenderConfig = FAST_PICTURES
) -> Scores:
    """Return masked PSNR and SSIM of the object under the scene's novel lights against their linear renders.

    Raw, and with one linear factor per channel over all photos, which takes the freedom between light and
    albedo out. Raises `ConfigError` where `config` asks for a path tracer that is not installed, `InputError`
    for a render that is not one of its photo's size with coverage.
    """
    pairs = list(_relit_pairs(Relighter(decomposition, device, config), scene.relight, device))
    if not pairs:
        return {}
    inside = [(image[mask], true[mask]) for image, true, mask in pairs]
    scale = channel_scale(*(torch.cat(parts) for parts in zip(*inside, strict=True)))
    scores: Scores = {}
    for suffix, factor in (("", torch.ones_like(scale)), ("_scaled", scale)):
        each = [_relit_scores(image * factor, true, mask) for image, true, mask in pairs]
        for i, name in enumerate(("psnr", "ssim")):
            scores[f"relight_{name}{suffix}"] = float(np.mean([s[i] for s in each]))
    return scores


def _relit_pairs(
    relighter: Relighter, photos: Iterable[Photo], device: torch.device
) -> Iterable[tuple[Tensor, Tensor, Tensor]]:
    """Yield (render, truth, mask): linear premultiplied (H, W, 3) twice and the true object's pixels (H, W).

    Warns of renders that show nothing of the object, and leaves them out.
    """
    for photo in photos:
        if photo.truth.environment is None or photo.truth.linear is None:
            continue
        size = photo.camera.height, photo.camera.width
        render = _sized(read_hdr(photo.truth.linear), size, photo.truth.linear)
        if render.shape[2] != 4:
            raise InputError(f"{photo.truth.linear} needs a fourth channel, the object's coverage.")
        true = torch.from_numpy(np.ascontiguousarray(render, np.float32)).to(device)
        if not bool((true[..., 3] > 0.5).any()):
            tell_unscored(InputError(f"{photo.truth.linear} shows nothing of the object."))
            continue
        image, _ = relighter.picture(Environment.load(photo.truth.environment, device), photo.camera)
        yield image, true[..., :3], true[..., 3] > 0.5


def _relit_scores(image: Tensor, true: Tensor, mask: Tensor) -> tuple[float, float]:
    """Compare on black, which both have: only pixels of the object count."""
    opaque = torch.ones_like(image[..., 0])
    scores = image_scores(on_white(image, opaque), on_white(true, opaque), mask)
    return scores.psnr_masked, scores.ssim_masked


def _srgb_psnr(values: Tensor, reference: Tensor) -> float:
    return psnr(srgb_encode(values.clamp(0, 1)), srgb_encode(reference.clamp(0, 1)))
