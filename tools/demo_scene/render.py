"""The path tracer's side: the object as a Mitsuba scene with the glTF reflectance model, and pictures of it.

Mitsuba is used as an independent implementation: nothing here imports the product's renderer. The variant is
`llvm_ad_rgb`, which needs an LLVM shared library (19 works, 15 does not).

Notation: all directions inside the BSDF are in the shading frame, z along the normal; wi towards the camera, wo towards
the light, h the half vector; alpha = roughness^2.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from .models import Model
from .textures import atlas_uv

mi.set_variant("llvm_ad_rgb")

MAX_DEPTH = 6  # up to five scattering events
_SUB_RENDERS = 4
# Mitsuba's environments are y-up with +z in the middle: (x, y, z)_ours = (z, x, y)_theirs.
_ENVIRONMENT_AXES = [[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]


class GltfBsdf(mi.BSDF):
    """glTF 2.0 metallic-roughness, two-sided, single-scattering: (1-F) c_diff/pi + F D V with F = Schlick(F0)."""

    def __init__(self, props: mi.Properties):
        mi.BSDF.__init__(self, props)
        self.base_color, self.orm = props["base_color"], props["orm"]
        sides = mi.BSDFFlags.FrontSide | mi.BSDFFlags.BackSide
        kinds = (mi.BSDFFlags.DiffuseReflection, mi.BSDFFlags.GlossyReflection)
        self.m_components = [kind | sides | mi.BSDFFlags.SpatiallyVarying for kind in kinds]
        self.m_flags = self.m_components[0] | self.m_components[1]

    def _surface(self, si, active):
        """Return diffuse colour, F0, alpha and the chance of sampling the specular lobe."""
        base, orm = self.base_color.eval(si, active), self.orm.eval(si, active)
        roughness, metallic = orm.y, orm.z
        diffuse = base * (1 - metallic)
        f0 = 0.04 * (1 - metallic) + base * metallic
        fresnel = f0 + (1 - f0) * (1 - dr.abs(si.wi.z)) ** 5
        chance = dr.mean(fresnel) / (dr.mean(fresnel) + dr.mean(diffuse) + 1e-4)
        return diffuse, f0, roughness * roughness, dr.clip(chance, 0.15, 0.95)

    def _terms(self, wi, wo, alpha):
        """Return h, D and V (height-correlated Smith) for directions on the upper side."""
        h = dr.normalize(wi + wo)
        a2 = alpha * alpha
        d = a2 / (dr.pi * dr.square(dr.square(h.z) * (a2 - 1) + 1))
        mask_o = wo.z * dr.sqrt(a2 + (1 - a2) * dr.square(wi.z))
        mask_i = wi.z * dr.sqrt(a2 + (1 - a2) * dr.square(wo.z))
        return h, d, 0.5 / dr.maximum(mask_o + mask_i, 1e-9)

    def _value_and_pdf(self, si, wo, active):
        diffuse, f0, alpha, chance = self._surface(si, active)
        flip = dr.sign(si.wi.z)
        wi, wo = mi.Vector3f(si.wi.x, si.wi.y, si.wi.z * flip), mi.Vector3f(wo.x, wo.y, wo.z * flip)
        active = active & (wi.z > 1e-6) & (wo.z > 1e-6)
        h, d, v = self._terms(wi, wo, alpha)
        fresnel = f0 + (1 - f0) * (1 - dr.clip(dr.dot(wi, h), 0, 1)) ** 5
        value = ((1 - fresnel) * diffuse * dr.inv_pi + fresnel * d * v) * wo.z
        a2 = alpha * alpha
        visible = 2 * wi.z / (wi.z + dr.sqrt(a2 + (1 - a2) * dr.square(wi.z)))  # Smith G1 of the viewing side
        pdf = chance * visible * d / (4 * wi.z) + (1 - chance) * wo.z * dr.inv_pi
        return dr.select(active, value, 0), dr.select(active, pdf, 0)

    def sample(self, ctx, si, sample1, sample2, active=True):
        """Sample the visible normals or the cosine, chosen by the Fresnel share; weight = value / pdf of both."""
        _, _, alpha, chance = self._surface(si, active)
        flip = dr.sign(si.wi.z)
        wi = mi.Vector3f(si.wi.x, si.wi.y, si.wi.z * flip)
        specular = sample1 < chance
        facets = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, dr.maximum(alpha, 1e-3), True)
        normal, _ = facets.sample(wi, sample2)
        wo = dr.select(specular, mi.reflect(wi, normal), mi.warp.square_to_cosine_hemisphere(sample2))
        wo = mi.Vector3f(wo.x, wo.y, wo.z * flip)
        value, pdf = self._value_and_pdf(si, wo, active)
        sampled = dr.zeros(mi.BSDFSample3f)
        sampled.wo, sampled.pdf, sampled.eta = wo, pdf, 1.0
        sampled.sampled_component = dr.select(specular, mi.UInt32(1), mi.UInt32(0))
        sampled.sampled_type = dr.select(
            specular, mi.UInt32(+mi.BSDFFlags.GlossyReflection), mi.UInt32(+mi.BSDFFlags.DiffuseReflection)
        )
        return sampled, dr.select(active & (pdf > 0), value / pdf, 0)

    def eval(self, ctx, si, wo, active=True):
        """Value times cosine."""
        return self._value_and_pdf(si, wo, active)[0]

    def pdf(self, ctx, si, wo, active=True):
        """Density of `sample` per solid angle."""
        return self._value_and_pdf(si, wo, active)[1]

    def eval_pdf(self, ctx, si, wo, active=True):
        """Both at once."""
        return self._value_and_pdf(si, wo, active)

    def to_string(self):
        """Name for Mitsuba's printouts."""
        return "GltfBsdf[]"


mi.register_bsdf("gltf_metallic_roughness", lambda props: GltfBsdf(props))


@dataclass(frozen=True)
class View:
    """A square pinhole camera: 4x4 camera-to-world in OpenGL axes, horizontal field of view in radians."""

    pose: np.ndarray
    angle: float

    def rays(self, side: int, offset: tuple[float, float]) -> np.ndarray:
        """Return unit world directions (side * side, 3) through `offset` in [0, 1)^2 of every pixel, row by row."""
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


def _texture(array: np.ndarray) -> dict:
    return {"type": "bitmap", "bitmap": mi.Bitmap(np.float32(array)), "raw": True, "wrap_mode": "clamp"}


def _shape(model: Model) -> mi.Mesh:
    """All parts as one mesh with the atlas coordinates; Mitsuba counts v down the rows of a bitmap made in memory."""
    parts = model.parts
    uv = np.concatenate([atlas_uv(model.tiles[part.name], part.uv) for part in parts])
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts])
    faces = np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=False)])
    mesh = mi.Mesh("object", int(offsets[-1]), len(faces), has_vertex_normals=True, has_vertex_texcoords=True)
    values = mi.traverse(mesh)
    values["vertex_positions"] = np.float32(np.concatenate([part.vertices for part in parts])).ravel()
    values["vertex_normals"] = np.float32(np.concatenate([part.normals for part in parts])).ravel()
    values["vertex_texcoords"] = np.float32(uv).ravel()
    values["faces"] = np.uint32(faces).ravel()
    values.update()
    return mesh


def painted_mesh(model: Model) -> tuple[mi.Mesh, mi.Texture, mi.Texture]:
    """Return the object with its material, and the textures of base colour and roughness with metallic."""
    material = model.material
    orm = np.stack([np.zeros_like(material.roughness), material.roughness, material.metallic], axis=-1)
    base, rough = mi.load_dict(_texture(material.base)), mi.load_dict(_texture(orm))
    mesh = _shape(model)
    mesh.set_bsdf(mi.load_dict({"type": "gltf_metallic_roughness", "base_color": base, "orm": rough}))
    return mesh, base, rough


def environment_rows(radiance: np.ndarray) -> np.ndarray:
    """Resample (H, W, 3) to 2H + 1 rows, (2H + 1, W, 3), so that Mitsuba's bilinear look-up is exactly ours.

    Mitsuba puts its first and last row on the poles. With rows at multiples of half a texel every texel centre of ours
    is a row of its, those between are midpoints, and the poles repeat the nearest row.
    """
    padded = np.concatenate([radiance[:1], radiance, radiance[-1:]])
    rows = np.empty((2 * len(radiance) + 1, *radiance.shape[1:]), np.float32)
    rows[1::2] = radiance
    rows[0::2] = (padded[:-1] + padded[1:]) / 2
    return rows


class Studio:
    """The object in Mitsuba, under one environment at a time."""

    def __init__(self, model: Model, environment_height: int, others: Mapping[str, dict | mi.Object] | None = None):
        """Set the object up; others: shapes by name that stand around it."""
        mesh, self._base, self._orm = painted_mesh(model)
        empty = np.ones((2 * environment_height + 1, 2 * environment_height, 3), np.float32)
        environment = {
            "type": "envmap",
            "bitmap": mi.Bitmap(empty),
            "to_world": mi.ScalarTransform4f(_ENVIRONMENT_AXES),
        }
        self.scene = mi.load_dict({"type": "scene", "object": mesh, "light": environment, **(others or {})})
        self._values = mi.traverse(self.scene)
        self._integrator = mi.load_dict(
            {"type": "path", "max_depth": MAX_DEPTH, "rr_depth": 64, "hide_emitters": True}
        )  # fmt: skip

    def set_environment(self, radiance: np.ndarray) -> None:
        """Light the object by radiance (H, 2H, 3) in the convention of `lights`."""
        rows = environment_rows(radiance)
        self._values["light.data"] = mi.TensorXf(np.concatenate([rows[:, -1:], rows, rows[:, :1]], axis=1))
        self._values.update()

    def photograph(self, view: View, side: int, samples: int, seed: int) -> np.ndarray:
        """Return premultiplied linear RGBA (side, side, 4): the mean of four renders with rare bright samples tamed.

        A value above three times the pixel's median over the four plus 0.02 is brought down to that.
        """
        sensor = self._sensor(view, side)
        renders = np.stack(
            [
                np.array(
                    mi.render(
                        self.scene, sensor=sensor, integrator=self._integrator,
                        spp=max(samples // _SUB_RENDERS, 1), seed=seed * _SUB_RENDERS + k,
                    )
                )
                for k in range(_SUB_RENDERS)
            ]
        )  # fmt: skip
        brightness = renders[..., :3].max(axis=-1)
        limit = 3.0 * np.median(brightness, axis=0) + 0.02
        renders[..., :3] *= np.minimum(1.0, limit / np.maximum(brightness, 1e-9))[..., None]
        return renders.mean(axis=0, dtype=np.float64)

    def maps(self, view: View, side: int) -> Maps:
        """Return the mean surface under 4x4 rays of every pixel."""
        total = np.zeros((side * side, 9))
        for k in range(16):
            hit, values = self._probe(view.rays(side, ((k % 4 + 0.5) / 4, (k // 4 + 0.5) / 4)), view.pose[:3, 3])
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
        return mi.load_dict(
            {
                "type": "perspective",
                "fov": float(np.degrees(view.angle)),
                "fov_axis": "x",
                "near_clip": 0.1,
                "far_clip": 100.0,
                "to_world": mi.ScalarTransform4f(pose.tolist()),
                "sampler": {"type": "independent"},
                "film": {
                    "type": "hdrfilm", "width": side, "height": side, "pixel_format": "rgba",
                    "component_format": "float32", "rfilter": {"type": "box"},
                },
            }
        )  # fmt: skip
