"""Pictures by the path tracer Mitsuba 3: what `render.picture` approximates, at a hundred times its cost.

Shadows are sharp wherever they fall, and light that the object reflects onto itself is followed for up to
five bounces. Needs the extra `path` and an LLVM library newer than 15, for which Mitsuba compiles itself.

Notation: G groups of passes; N rays of a pass, S^2 texels of a texture, R of a light's edge, P pixels.
"""

import functools
import subprocess
import sys
from typing import Any

import numpy as np
import torch
from torch import Tensor

from lightprobe.core.errors import ConfigError
from lightprobe.core.extras import extra_library
from lightprobe.geometry.mesh import Mesh, uv_tangents
from lightprobe.light import equirect
from lightprobe.render.asset import Asset, uv_handedness
from lightprobe.scene.camera import Camera

MAX_DEPTH = 6  # up to five scattering events
# Mitsuba's environments are y-up with +z in the middle: (x, y, z)_ours = (z, x, y)_theirs.
ENVIRONMENT_AXES = [[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
_GROUPS = 4  # of passes, whose median tells a pixel's brightness from one lucky ray's
_RAYS = 2**20  # of a pass
_PROBE = (  # prints; a library too old ends the process
    "import mitsuba as mi; mi.set_variant('llvm_ad_rgb'); import drjit as dr; print(dr.maximum(mi.Float([1, 2]), 1.5))"
)


def check_path_tracer() -> None:
    """Raise `ConfigError` with a remedy unless Mitsuba and an LLVM library it can use are installed."""
    extra_library("mitsuba", "Rendering with --renderer path", "path")
    if not _finds_llvm():
        raise ConfigError(
            "Rendering with --renderer path needs an LLVM library newer than 15, which Mitsuba does not find; install "
            "one (Debian and Ubuntu: apt install libllvm19; macOS: brew install llvm) or leave --renderer out."
        )


@functools.cache
def _finds_llvm() -> bool:
    """Return whether a small computation succeeds, in a process of its own."""
    return subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, timeout=120).returncode == 0


def tamed(renders: np.ndarray) -> np.ndarray:
    """Return the mean (..., 4) float64 of G renders of radiance and coverage, bright outliers tamed.

    A value above three times the pixel's median over the renders plus 0.02 is scaled down to that.
    """
    brightness = renders[..., :3].max(axis=-1)
    limit = 3.0 * np.median(brightness, axis=0) + 0.02
    factor = np.minimum(1.0, limit / np.maximum(brightness, 1e-9))[..., None]
    limited = np.concatenate([renders[..., :3] * factor, renders[..., 3:]], axis=-1)
    return limited.mean(axis=0, dtype=np.float64)


def environment_rows(radiance: np.ndarray) -> np.ndarray:
    """Resample (H, W, 3) to (2H + 1, W, 3), so that Mitsuba looks up bilinearly as `equirect` does.

    Mitsuba puts its first and last row on the poles. With rows at multiples of half a texel every row of our texel
    centres is a row of Mitsuba's, and the rows between are midpoints; beyond a pole a row goes on half a turn away.
    """
    half = radiance.shape[1] // 2
    padded = np.concatenate([np.roll(radiance[:1], half, 1), radiance, np.roll(radiance[-1:], half, 1)])
    rows = np.empty((2 * len(radiance) + 1, *radiance.shape[1:]), np.float32)
    rows[1::2] = radiance
    rows[0::2] = (padded[:-1] + padded[1:]) / 2
    return rows


class PathTracer:
    """Pictures of one asset; see the module."""

    def __init__(self, asset: Asset, samples: int = 256, seed: int = 0):
        """Set the asset up; samples: rays of a pixel, at least as many as there are groups.

        Raises `ConfigError` where the libraries are missing.
        """
        check_path_tracer()
        import mitsuba as mi

        from lightprobe.render.gltf_bsdf import VARIANT

        self._passes = max(1, round(samples / _GROUPS))
        self._seed, self._variant, self._mi = seed, VARIANT, mi
        with mi.scoped_set_variant(VARIANT):
            self._mesh = _mitsuba_mesh(mi, asset)
            paths = {"type": "path", "max_depth": MAX_DEPTH, "rr_depth": 64, "hide_emitters": True}
            self._integrator = mi.load_dict(paths)
        self._vertices = asset.mesh.vertices.detach().cpu().numpy()
        self._lit: tuple[Tensor, Any] | None = None  # the last light and its scene

    def render(self, camera: Camera, light: Tensor) -> tuple[Tensor, Tensor]:
        """Return the asset seen by a normalised-frame camera under a light (6, R, R, 3).

        The image (H, W, 3) is linear and premultiplied, the coverage (H, W) in [0, 1]; both float32, on the
        light's device.
        """
        with self._mi.scoped_set_variant(self._variant):
            scene = self._scene(light)
            rng = np.random.default_rng(self._seed)
            picture = np.zeros((camera.height * camera.width, 4))
            pixel = _framed(self._vertices, camera)
            for chosen in np.array_split(pixel, -(-len(pixel) // _RAYS)) if len(pixel) else ():
                picture[chosen] = self._traced(scene, camera, chosen, rng)
        image = torch.from_numpy(picture.astype(np.float32)).to(light.device)
        image = image.reshape(camera.height, camera.width, 4)
        return image[..., :3], image[..., 3]

    def _traced(self, scene: Any, camera: Camera, pixel: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return radiance and coverage (P, 4) of pixels (P,), row-major."""
        mi, together = self._mi, max(1, min(self._passes, _RAYS // len(pixel)))
        groups = np.zeros((_GROUPS, len(pixel), 4))
        sampler = mi.load_dict({"type": "independent"})
        for group in groups:
            for start in range(0, self._passes, together):
                count = min(together, self._passes - start)
                rays = np.tile(pixel, count)
                sampler.seed(int(rng.integers(2**31)), len(rays))
                direction = _directions(camera, rays, rng)
                towards = mi.Vector3f(np.ascontiguousarray(direction.T, np.float32))
                ray = mi.RayDifferential3f(mi.Point3f(*camera.position.tolist()), towards)
                radiance, hit, _ = self._integrator.sample(scene, sampler, ray)
                values = np.concatenate([np.array(radiance).T, np.array(hit, np.float32)[:, None]], axis=1)
                group += values.reshape(count, len(pixel), 4).sum(axis=0) / self._passes
        return tamed(groups)

    def _scene(self, light: Tensor) -> Any:
        """Return the object under a light, made anew only for another one."""
        if self._lit is not None and self._lit[0] is light:
            return self._lit[1]
        mi = self._mi
        radiance = equirect.from_cubemap(light.detach().float().cpu(), 2 * light.shape[1]).numpy()
        bitmap, axes = mi.Bitmap(environment_rows(radiance)), mi.ScalarTransform4f(ENVIRONMENT_AXES)
        environment = {"type": "envmap", "bitmap": bitmap, "to_world": axes}
        scene = mi.load_dict({"type": "scene", "object": self._mesh, "light": environment})
        self._lit = light, scene
        return scene


def _directions(camera: Camera, pixel: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return unit world directions (N, 3) through random points of pixels (N,), row-major."""
    place = np.stack([pixel % camera.width, pixel // camera.width], axis=1) + rng.random((len(pixel), 2))
    x, y = ((place - [camera.cx, camera.cy]) / [camera.fx, -camera.fy]).T
    world = np.stack([x, y, -np.ones_like(x)], axis=1) @ camera.camera_to_world[:3, :3].T
    return world / np.linalg.norm(world, axis=1, keepdims=True)


def _framed(vertices: np.ndarray, camera: Camera) -> np.ndarray:
    """Return the row-major pixels (P,) of the rectangle around the vertices; all if some are behind."""
    seen = camera.project(vertices)
    low, high = np.zeros(2), np.array([camera.width, camera.height], float)
    if (seen[:, 2] > 0).all():
        low = np.clip(np.floor(seen[:, :2].min(axis=0)), low, high)
        high = np.clip(np.ceil(seen[:, :2].max(axis=0)), low, high)
    columns, rows = (np.arange(a, b) for a, b in zip(low.astype(int), high.astype(int), strict=True))
    return (rows[:, None] * camera.width + columns).ravel()


def _mitsuba_mesh(mi: Any, asset: Asset) -> Any:
    """Return the asset as a Mitsuba mesh with its material; every corner of a face is a vertex of its own."""
    mesh, textures = asset.mesh, asset.textures
    count = len(mesh.faces)
    arrays = {"vertex_" + name: values for name, values in _corners(mesh).items()}
    shape = mi.Mesh("object", 3 * count, count, has_vertex_normals=True, has_vertex_texcoords=True)
    for name, size in (("vertex_tangent", 3), ("vertex_handedness", 1)):
        shape.add_attribute(name, size, arrays.pop(name))
    values = mi.traverse(shape)
    for name, array in arrays.items():
        values[name] = array
    values["faces"] = np.arange(3 * count, dtype=np.uint32)
    values.update()
    roughness, metallic = (t.detach().cpu().numpy() for t in (textures.roughness, textures.metallic))
    bsdf: dict[str, Any] = {
        "type": "gltf_metallic_roughness",
        "base_color": bitmap(mi, textures.base_color.detach().cpu().numpy()),
        "orm": bitmap(mi, np.stack([np.ones_like(roughness), roughness, metallic], axis=-1)),
        "normal": bitmap(mi, textures.normal.detach().cpu().numpy()),
    }
    bsdf |= {name: {"type": "mesh_attribute", "name": f"vertex_{name}"} for name in ("tangent", "handedness")}
    shape.set_bsdf(mi.load_dict(bsdf))
    return shape


def bitmap(mi: Any, array: np.ndarray) -> dict[str, Any]:
    """Return Mitsuba's description of a texture (S, S, 3), taken as it is; v counts down its rows."""
    return {"type": "bitmap", "bitmap": mi.Bitmap(np.float32(array)), "raw": True, "wrap_mode": "clamp"}


def _corners(mesh: Mesh) -> dict[str, np.ndarray]:
    """Return, flat and as float32, what a mesh has at each corner of each face."""
    cpu = mesh.to(torch.device("cpu"))
    corners = {
        "positions": cpu.vertices[cpu.faces.long()],
        "normals": cpu.normals()[cpu.normal_index.long()],
        "texcoords": cpu.uvs[cpu.uv_faces.long()],
        "tangent": uv_tangents(cpu)[cpu.uv_faces.long()],
        "handedness": uv_handedness(cpu)[:, None].expand(-1, 3),
    }
    return {name: values.detach().float().contiguous().numpy().ravel() for name, values in corners.items()}
