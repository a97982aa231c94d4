"""Our shading of a convex object against Mitsuba's path tracer, which shares no code with it, under three lights.

Everything goes through its file-side conventions: an ellipsoid's mesh, a camera, an equirectangular light. What can be
compared exactly is compared:

- Diffuse: our glTF model lets only what the Fresnel term leaves through, base (1 - F0) (1 - C) E / pi. The difference
  of a white and a black dielectric, divided by that factor, is E / pi, which Mitsuba's Lambertian `diffuse` reflects.
- Specular: white metal has F = 1, as has Mitsuba's `roughconductor` of material "none", GGX with alpha = r^2. Mitsuba's
  masking is separable, ours height-correlated, so ours is brighter where both directions graze. Divided by the image
  under a white light, which each renderer makes for itself, both show the light's average under the lobe.

Errors are RMS over the pixels inside the outline, relative to the RMS of Mitsuba's image, linear and per channel.
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from lightprobe.geometry.mesh import vertex_normals
from lightprobe.light import equirect
from lightprobe.light.prefilter import cached
from lightprobe.render import brdf
from lightprobe.render.asset import gbuffer_of
from lightprobe.render.gbuffer import GBuffer
from lightprobe.render.split_sum import shade
from lightprobe.render.surface import View, visible_surface
from tests.shapes import camera_at, sphere

mi = pytest.importorskip("mitsuba")

SIDE, SPLIT = 32, 4  # pixels of the picture, our samples along a pixel's edge
SAMPLES = 1024  # Mitsuba's per pixel, stratified: noise of at most 0.8 %
HEIGHT, R = 64, 32  # rows of the light, and our cubemap's resolution
CAMERA = camera_at((2.4, 1.9, 1.3), size=SIDE, focal=1.35 * SIDE)
AXES = (1.0, 0.85, 0.75)
DIFFUSE_BOUND, SPECULAR_BOUND = 0.01, 0.05
# Mitsuba's environments are y-up with +z in the middle: (x, y, z)_ours = (z, x, y)_theirs.
_ENVIRONMENT_AXES = [[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]


def _lamp(d: torch.Tensor, toward, sharpness: float, color) -> torch.Tensor:
    """A round lamp that falls off as exp(sharpness (cos - 1))."""
    axis = torch.nn.functional.normalize(torch.tensor(toward), dim=0)
    return torch.exp(sharpness * (d @ axis - 1.0))[..., None] * torch.tensor(color)


def _window(d: torch.Tensor, azimuth: float, color) -> torch.Tensor:
    """A window about 35 degrees wide between 3 and 33 degrees of elevation, with soft edges."""
    away = torch.remainder(torch.atan2(d[..., 1], d[..., 0]) - azimuth + math.pi, 2.0 * math.pi) - math.pi
    across = torch.sigmoid(20.0 * (0.3 - away.abs()))
    return (across * torch.sigmoid(20.0 * (0.25 - (d[..., 2] - 0.3).abs())))[..., None] * torch.tensor(color)


def sky(d: torch.Tensor) -> torch.Tensor:
    up = torch.sigmoid(8.0 * d[..., 2:])
    return (0.1 + up) * torch.tensor([0.5, 0.7, 1.0]) + _lamp(d, (0.6, 0.4, 0.5), 80.0, (20.0, 18.0, 14.0))


def room(d: torch.Tensor) -> torch.Tensor:
    walls = torch.tensor([0.15, 0.13, 0.12]).expand(d.shape)
    windows = ((0.3, (8.0, 8.5, 9.0)), (1.4, (6.0, 6.5, 7.0)), (3.6, (3.0, 2.8, 2.6)))
    return walls + sum(_window(d, azimuth, color) for azimuth, color in windows)


def studio(d: torch.Tensor) -> torch.Tensor:
    lamps = (
        ((1.0, -0.5, 0.6), 25.0, (12.0, 3.0, 2.0)),
        ((0.7, 0.8, 0.1), 40.0, (2.0, 12.0, 4.0)),
        ((-0.3, 0.2, 1.0), 15.0, (3.0, 4.0, 12.0)),
        ((0.2, -1.0, -0.3), 60.0, (10.0, 10.0, 3.0)),
        ((-1.0, 0.1, 0.2), 30.0, (9.0, 9.0, 9.0)),
    )
    return 0.05 + sum(_lamp(d, *lamp) for lamp in lamps)


LIGHTS = {"sky": sky, "room": room, "studio": studio}


@pytest.fixture(scope="module")
def mitsuba():
    """Mitsuba in its scalar variant, which needs nothing beside it; other tests may want another."""
    before = mi.variant()
    mi.set_variant("scalar_rgb")
    yield mi
    if before:
        mi.set_variant(before)


@dataclass(frozen=True)
class Stage:
    """The ellipsoid on both sides."""

    mesh_file: Path
    vertices: torch.Tensor
    faces: torch.Tensor
    normals: torch.Tensor

    def gbuffer(self, base: float, roughness: float, metallic: float) -> GBuffer:
        view = View.of(CAMERA.resized(SPLIT * SIDE, SPLIT * SIDE), torch.device("cpu"))
        surface = visible_surface(self.vertices, self.faces, view)
        normal = torch.nn.functional.normalize(surface.interpolate(self.normals, self.faces), dim=1)
        material = torch.tensor([base, base, base, roughness, metallic]).expand(len(normal), 5)
        return gbuffer_of(surface, view, normal, material)

    def ours(self, gbuffer: GBuffer, radiance: torch.Tensor) -> np.ndarray:
        """Return pixel means (SIDE, SIDE, 3) of radiance (P, 3); nan on and outside the outline."""
        picture = torch.full((gbuffer.height * gbuffer.width, 3), torch.nan)
        picture[gbuffer.pixel] = radiance
        return picture.reshape(SIDE, SPLIT, SIDE, SPLIT, 3).mean((1, 3)).numpy()

    def theirs(self, light: np.ndarray, bsdf: dict, seed: int = 0) -> np.ndarray:
        """Return Mitsuba's picture (SIDE, SIDE, 3) under light (H, 2H, 3); a diffuse BSDF samples the light alone."""
        # Mitsuba has the first and last row on the poles: on twice the rows its bilinear look-up is exactly ours.
        padded = np.concatenate([light[:1], light, light[-1:]])
        rows = np.empty((2 * len(light) + 1, *light.shape[1:]), np.float32)
        rows[1::2], rows[0::2] = light, (padded[:-1] + padded[1:]) / 2
        turn, samples = mi.ScalarTransform4f(_ENVIRONMENT_AXES), int(bsdf["type"] != "diffuse")
        counts = {"emitter_samples": 1, "bsdf_samples": samples, "hide_emitters": True}
        parts = {
            "object": {"type": "ply", "filename": str(self.mesh_file), "bsdf": bsdf},
            "light": {"type": "envmap", "bitmap": mi.Bitmap(rows), "to_world": turn},
            "sensor": _sensor(),
            "integrator": {"type": "direct", **counts},
        }
        scene = mi.load_dict({"type": "scene", **parts})
        return np.array(mi.render(scene, seed=seed, spp=SAMPLES))[..., :3]


def _sensor() -> dict:
    pose = CAMERA.camera_to_world @ np.diag([-1.0, 1.0, -1.0, 1.0])  # it looks along +z with x to the left
    formats = {"pixel_format": "rgba", "component_format": "float32"}
    return {
        "type": "perspective",
        "fov": math.degrees(2.0 * math.atan(0.5 * SIDE / CAMERA.fx)),
        "fov_axis": "x",
        "to_world": mi.ScalarTransform4f(pose.tolist()),
        "sampler": {"type": "multijitter", "sample_count": SAMPLES},
        "film": {"type": "hdrfilm", "width": SIDE, "height": SIDE, "rfilter": {"type": "box"}, **formats},
    }


@pytest.fixture(scope="module")
def stage(mitsuba, tmp_path_factory) -> Stage:
    ball, faces = sphere(5)
    vertices, faces = torch.from_numpy(ball * np.float32(AXES)), torch.from_numpy(faces)
    normals = vertex_normals(vertices, faces)
    path = tmp_path_factory.mktemp("mitsuba") / "ellipsoid.ply"
    mesh = trimesh.Trimesh(vertices, faces, vertex_normals=normals.numpy(), process=False)
    mesh.export(path, vertex_normal=True)
    return Stage(path, vertices, faces, normals)


def light_of(name: str) -> torch.Tensor:
    return LIGHTS[name](equirect.directions(HEIGHT))


def relative_error(ours: np.ndarray, theirs: np.ndarray) -> float:
    inside = ~np.isnan(ours).any(-1)
    assert inside.sum() > 300
    difference = (ours - theirs)[inside].astype(np.float64)
    return float(np.sqrt((difference**2).mean() / (theirs[inside].astype(np.float64) ** 2).mean()))


@pytest.mark.slow
@pytest.mark.parametrize("name", LIGHTS)
def test_diffuse_is_mitsubas(stage, name):
    light, operator = light_of(name), cached(R)
    levels = operator.apply(equirect.to_cubemap(light, R))
    white, black = (stage.gbuffer(base, 0.5, 0.0) for base in (1.0, 0.0))
    cosine = (white.normal * white.view).sum(-1)
    passed = (1.0 - brdf.DIELECTRIC_F0) * (1.0 - brdf.environment_brdf(cosine, white.roughness)[2])
    ours = (shade(white, operator, levels) - shade(black, operator, levels)) / passed[:, None]
    theirs = stage.theirs(light.numpy(), {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}})
    assert relative_error(stage.ours(white, ours), theirs) < DIFFUSE_BOUND


@pytest.fixture(scope="module")
def mitsuba_white(stage):
    """Mitsuba's metal under a white light, by roughness."""
    return {}


@pytest.mark.slow
@pytest.mark.parametrize("roughness", [0.2, 0.35, 0.5, 0.8])
@pytest.mark.parametrize("name", LIGHTS)
def test_split_sum_specular_is_near_mitsubas(stage, mitsuba_white, name, roughness):
    light, operator = light_of(name), cached(R)
    levels = operator.apply(equirect.to_cubemap(light, R))
    metal = stage.gbuffer(1.0, roughness, 1.0)
    ours = stage.ours(metal, shade(metal, operator, levels))
    ours /= stage.ours(metal, shade(metal, operator, torch.ones_like(levels)))
    bsdf = {"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": roughness**2}
    if roughness not in mitsuba_white:
        mitsuba_white[roughness] = stage.theirs(np.ones((4, 8, 3), np.float32), bsdf)
    theirs = stage.theirs(light.numpy(), bsdf) / np.maximum(mitsuba_white[roughness], 1e-6)
    assert relative_error(ours, theirs) < SPECULAR_BOUND
