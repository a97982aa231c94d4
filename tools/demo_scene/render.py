"""The path tracer's side: the object as a Mitsuba scene with the glTF reflectance model, and pictures of it.

Mitsuba is used as an independent implementation: of the product nothing but the reflectance model and the
conventions of its own path tracer are imported, none of the renderer that it is learnt with. It needs an LLVM
shared library (19 works, 15 does not).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from lightprobe.render.gltf_bsdf import VARIANT
from lightprobe.render.path_tracer import ENVIRONMENT_AXES, MAX_DEPTH, bitmap, environment_rows, tamed

from .textures import Model

mi.set_variant(VARIANT)

_SUB_RENDERS = 4


@dataclass(frozen=True)
class View:
    """A square pinhole camera: 4x4 camera-to-world in OpenGL axes, horizontal field of view in radians."""

    pose: np.ndarray
    angle: float

    def rays(self, side: int, offset: tuple[float, float]) -> np.ndarray:
        """Return unit world directions (side * side, 3) through `offset` in [0, 1)^2 of every pixel."""
        focal = 0.5 * side / np.tan(0.5 * self.angle)
        x, y = np.meshgrid(np.arange(side) + offset[0] - side / 2, np.arange(side) + offset[1] - side / 2)
        local = np.stack([x / focal, -y / focal, -np.ones_like(x)], axis=-1).reshape(-1, 3)
        world = local @ self.pose[:3, :3].T
        return world / np.linalg.norm(world, axis=1, keepdims=True)


@dataclass(frozen=True)
class Maps:
    """What is true at the pixels of a view; 0 where nothing is hit."""

    base: np.ndarray  # (S, S, 3) linear
    roughness: np.ndarray  # (S, S)
    metallic: np.ndarray  # (S, S)
    normal: np.ndarray  # (S, S, 3) world, unit, towards the camera


def textured_mesh(model: Model) -> tuple[mi.Mesh, mi.Texture, mi.Texture]:
    """Return a model as a shape, and the textures of base colour and of roughness with metallic.

    Mitsuba counts v down the rows of a bitmap in memory.
    """
    size = {"vertex_count": len(model.vertices), "face_count": len(model.faces)}
    mesh = mi.Mesh("object", **size, has_vertex_normals=True, has_vertex_texcoords=True)
    values, material = mi.traverse(mesh), model.material
    values["vertex_positions"] = np.float32(model.vertices).ravel()
    values["vertex_normals"] = np.float32(model.normals).ravel()
    values["vertex_texcoords"] = np.float32(model.uv).ravel()
    values["faces"] = np.uint32(model.faces).ravel()
    values.update()
    orm = np.stack([np.zeros_like(material.roughness), material.roughness, material.metallic], axis=-1)
    base, rough = mi.load_dict(bitmap(mi, material.base)), mi.load_dict(bitmap(mi, orm))
    mesh.set_bsdf(mi.load_dict({"type": "gltf_metallic_roughness", "base_color": base, "orm": rough}))
    return mesh, base, rough


class Studio:
    """The object in Mitsuba, under one environment at a time."""

    def __init__(
        self, model: Model, environment_height: int, others: Mapping[str, dict | mi.Object] | None = None
    ):
        """Set the object up; others: shapes by name that stand around it."""
        mesh, self._base, self._orm = textured_mesh(model)
        empty = np.ones((2 * environment_height + 1, 2 * environment_height, 3), np.float32)
        environment = {
            "type": "envmap",
            "bitmap": mi.Bitmap(empty),
            "to_world": mi.ScalarTransform4f(ENVIRONMENT_AXES),
        }
        self.scene = mi.load_dict({"type": "scene", "object": mesh, "light": environment, **(others or {})})
        self._values = mi.traverse(self.scene)
        self._integrator = mi.load_dict(
            {"type": "path", "max_depth": MAX_DEPTH, "rr_depth": 64, "hide_emitters": True}
        )

    def set_environment(self, radiance: np.ndarray) -> None:
        """Light the object by radiance (H, 2H, 3) in the convention of `lights`."""
        rows = environment_rows(radiance)
        self._values["light.data"] = mi.TensorXf(np.concatenate([rows[:, -1:], rows, rows[:, :1]], axis=1))
        self._values.update()

    def photograph(self, view: View, side: int, samples: int, seed: int) -> np.ndarray:
        """Return premultiplied linear RGBA (side, side, 4): the mean of four renders, `tamed`."""
        sensor = self._sensor(view, side)
        how = {"sensor": sensor, "integrator": self._integrator, "spp": max(samples // _SUB_RENDERS, 1)}
        seeds = range(seed * _SUB_RENDERS, (seed + 1) * _SUB_RENDERS)
        renders = np.stack([np.array(mi.render(self.scene, seed=each, **how)) for each in seeds])
        return tamed(renders)

    def maps(self, view: View, side: int) -> Maps:
        """Return the mean surface under 4x4 rays of every pixel."""
        total = np.zeros((side * side, 9))
        for k in range(16):
            hit, values = self._probe(
                view.rays(side, ((k % 4 + 0.5) / 4, (k // 4 + 0.5) / 4)), view.pose[:3, 3]
            )
            total += np.where(hit[:, None], values, 0.0)
        mean = (total / np.maximum(total[:, -1:], 1.0)).reshape(side, side, 9)
        length = np.maximum(np.linalg.norm(mean[..., 5:8], axis=-1, keepdims=True), 1e-9)
        return Maps(mean[..., :3], mean[..., 3], mean[..., 4], mean[..., 5:8] / length)

    def _probe(self, direction: np.ndarray, origin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Cast rays; return hit (N,) and base colour, roughness, metallic, facing normal, 1 as (N, 9)."""
        ray = mi.Ray3f(mi.Point3f(*origin.tolist()), mi.Vector3f(np.float32(direction.T)))
        si = self.scene.ray_intersect(ray)
        base, orm = self._base.eval(si), self._orm.eval(si)
        normal = mi.Vector3f(si.sh_frame.n)
        normal *= dr.select(dr.dot(normal, ray.d) > 0, -1.0, 1.0)
        one = np.ones((1, len(direction)))
        rows = np.concatenate([np.array(base), np.array([orm.y, orm.z]), np.array(normal), one])
        return np.array(si.is_valid()), rows.T

    def sees_sky(self, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Return for rays (N, 3), (N, 3) whether they leave the object without touching it."""
        ray = mi.Ray3f(mi.Point3f(np.float32(origin.T)), mi.Vector3f(np.float32(direction.T)))
        return ~np.array(self.scene.ray_test(ray))

    def _sensor(self, view: View, side: int) -> mi.Sensor:
        # Mitsuba's cameras look along +z with x to the left.
        pose = view.pose @ np.diag([-1.0, 1.0, -1.0, 1.0])
        size = {"width": side, "height": side, "pixel_format": "rgba", "component_format": "float32"}
        lens = {"fov": float(np.degrees(view.angle)), "fov_axis": "x", "near_clip": 0.1, "far_clip": 100.0}
        film = {"type": "hdrfilm", **size, "rfilter": {"type": "box"}}
        place = {"to_world": mi.ScalarTransform4f(pose.tolist()), "sampler": {"type": "independent"}}
        return mi.load_dict({"type": "perspective", **lens, **place, "film": film})
