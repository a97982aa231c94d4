"""The path tracer's side: models in Mitsuba, rays of any camera through them, the light that arrives at a point.

Mitsuba is an independent implementation; of the product it takes the glTF reflectance model and the convention of
environments alone.
"""

from collections.abc import Mapping

import drjit as dr
import mitsuba as mi
import numpy as np

from demo_scene.lights import directions
from lightprobe.render.gltf_bsdf import VARIANT
from lightprobe.render.path_tracer import ENVIRONMENT_AXES, environment_rows

mi.set_variant(VARIANT)

_DEPTH = 6  # up to five scattering events
_SURE = 3  # of these no path is ended by chance, which takes two fifths off the time
_RAYS = 2**19  # at once


def use_one_thread() -> None:
    """Make the path tracer leave all cores but one to others."""
    dr.set_thread_count(1)


def quad_lamp(pose: np.ndarray, radiance: np.ndarray) -> dict:
    """Describe a rectangle, [-1, 1]^2 placed by `pose` (4, 4), that shines along its +z: an (H, W, 3) picture."""
    picture = {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.float32(radiance[::-1])),
        "raw": True,
        "filter_type": "nearest",
    }
    glow = {"type": "area", "radiance": picture}
    dark = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
    return {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f(pose.tolist()),
        "emitter": glow,
        "bsdf": dark,
    }


def ball_lamp(center: np.ndarray, radius: float, radiance: np.ndarray) -> dict:
    """Describe a glowing ball of radiance (3,)."""
    glow = {"type": "area", "radiance": {"type": "rgb", "value": radiance.tolist()}}
    return {"type": "sphere", "center": center.tolist(), "radius": radius, "emitter": glow}


def sky_lamp(radiance: np.ndarray) -> dict:
    """Describe an environment (H, 2H, 3) in the convention of `demo_scene.lights`."""
    rows = mi.Bitmap(np.ascontiguousarray(environment_rows(radiance.astype(np.float32))))
    return {"type": "envmap", "bitmap": rows, "to_world": mi.ScalarTransform4f(ENVIRONMENT_AXES)}


class Tracer:
    """Shapes and lamps by name; the one named `object` is what masks are of."""

    def __init__(self, things: Mapping[str, dict | mi.Object]):
        self._object = things.get("object")
        self._scene = mi.load_dict({"type": "scene", **things})
        self._integrator = mi.load_dict({"type": "path", "max_depth": _DEPTH, "rr_depth": _SURE})

    def radiance(self, origin: np.ndarray, towards: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Return the radiance (N, 3) that arrives at a point (3,) from unit directions (N, 3)."""
        sampler, found = mi.load_dict({"type": "independent"}), []
        for part in np.array_split(towards, -(-len(towards) // _RAYS)):
            sampler.seed(int(rng.integers(2**32)), len(part))
            ray = mi.RayDifferential3f(self._rays(origin, part))
            found.append(np.array(self._integrator.sample(self._scene, sampler, ray)[0]).T)
        return np.concatenate(found)

    def shows_object(self, origin: np.ndarray, towards: np.ndarray) -> np.ndarray:
        """Return which directions (N, 3) from a point (3,) meet the object before anything else."""
        hit = self._scene.ray_intersect_preliminary(self._rays(origin, towards))
        return np.array(hit.is_valid() & (hit.shape == mi.ShapePtr(self._object)))

    def sees_sky(self, origin: np.ndarray, towards: np.ndarray) -> np.ndarray:
        """Return for rays (N, 3), (N, 3) whether they leave without touching anything."""
        ray = mi.Ray3f(mi.Point3f(np.float32(origin.T)), mi.Vector3f(np.float32(towards.T)))
        return ~np.array(self._scene.ray_test(ray))

    @staticmethod
    def _rays(origin: np.ndarray, towards: np.ndarray) -> mi.Ray3f:
        return mi.Ray3f(
            mi.Point3f(*origin.tolist()), mi.Vector3f(np.ascontiguousarray(towards.T, np.float32))
        )


def panorama(tracer: Tracer, height: int, samples: int, rng: np.random.Generator) -> np.ndarray:
    """Return the light (H, 2H, 3) at the origin, in the convention of `demo_scene.lights`; mean over each texel."""
    total = np.zeros((height, 2 * height, 3))
    fine = 4  # directions of a texel's edge, so that a small lamp is neither missed nor hit by luck
    dense = directions(height * fine)
    for _ in range(max(1, samples // fine**2)):
        jitter = rng.normal(0, 0.3 * np.pi / (height * fine), dense.shape)
        rays = (dense + jitter).reshape(-1, 3)
        found = tracer.radiance(np.zeros(3), rays / np.linalg.norm(rays, axis=1, keepdims=True), rng)
        total += found.reshape(height, fine, 2 * height, fine, 3).mean(axis=(1, 3))
    return total / max(1, samples // fine**2)
