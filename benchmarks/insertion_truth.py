"""The path tracer's side: both objects on a ground under a light, with and without the second one."""

import mitsuba as mi
import numpy as np

from benchmarks.composed import background
from demo_scene.render import Studio, View, textured_mesh
from demo_scene.textures import Model
from lightprobe.scene.camera import Camera

_GROUND = 60.0  # half the edge of the square of ground
_TILES = 90  # of its texture along an edge


def ground_shape(height: float, seed: int) -> dict:
    """Return a matt ground at a height, of uneven colour."""
    rng = np.random.default_rng(seed)
    values = 0.42 + 0.06 * rng.standard_normal((64, 64, 1)) + [0.03, 0.0, -0.04]
    place = mi.ScalarTransform4f().translate([0, 0, height]).scale([_GROUND, _GROUND, 1])
    texture = {
        "type": "bitmap",
        "bitmap": mi.Bitmap(np.float32(values.clip(0.1, 0.8))),
        "raw": True,
        "wrap_mode": "repeat",
        "to_uv": mi.ScalarTransform4f().scale([_TILES, _TILES, 1]),
    }
    return {"type": "rectangle", "to_world": place, "bsdf": {"type": "diffuse", "reflectance": texture}}


def photograph(
    known: Model, thing: Model | None, environment: np.ndarray, camera: Camera, height: float, samples: int
) -> np.ndarray:
    """Return the linear photo (H, W, 3) of the objects on the ground, the environment (h, 2h, 3) behind them."""
    others: dict = {"ground": ground_shape(height, 1)}
    if thing is not None:
        others["thing"] = textured_mesh(thing)[0]
    studio = Studio(known, len(environment), others)
    studio.set_environment(environment.astype(np.float32))
    view = View(camera.camera_to_world, 2 * float(np.arctan(0.5 * camera.width / camera.fx)))
    image = studio.photograph(view, camera.width, samples, seed=3)
    behind = background(environment, camera)
    return (image[..., :3] + behind * (1 - np.clip(image[..., 3:], 0, 1))).astype(np.float32)
