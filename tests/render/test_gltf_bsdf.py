"""The reflectance model for Mitsuba: its samples against its density, its energy against our integrals of it."""

import math

import numpy as np
import pytest
import torch

from lightprobe.core.errors import ConfigError
from lightprobe.render import brdf
from lightprobe.render.path_tracer import check_path_tracer

try:
    check_path_tracer()
except ConfigError as missing:
    pytest.skip(str(missing), allow_module_level=True)

import drjit as dr
import mitsuba as mi

from lightprobe.render.gltf_bsdf import VARIANT

COUNT = 200_000


@pytest.fixture(autouse=True)
def variant():
    with mi.scoped_set_variant(VARIANT):
        yield


def texture(*values: float) -> dict:
    return {"type": "bitmap", "bitmap": mi.Bitmap(np.full((2, 2, 3), values, np.float32)), "raw": True}


def bsdf(base: float, roughness: float, metallic: float, normal: tuple[float, float, float] | None = None):
    description = {
        "type": "gltf_metallic_roughness", "base_color": texture(base, base, base),
        "orm": texture(1.0, roughness, metallic),
    }  # fmt: skip
    if normal is not None:
        tangent = {"type": "srgb", "color": [1.0, 0.0, 0.0], "unbounded": True}
        description |= {"normal": texture(*normal), "tangent": tangent, "handedness": texture(1.0, 1.0, 1.0)}
    return mi.load_dict(description)


def point(cosine: float):
    """A point whose shading frame is the world's, seen at an angle."""
    si = dr.zeros(mi.SurfaceInteraction3f, COUNT)
    si.sh_frame = mi.Frame3f(mi.Vector3f(0, 0, 1))
    si.wi = mi.Vector3f(math.sqrt(1 - cosine**2), 0, cosine)
    return si


def sampled(material, cosine: float):
    """Directions (COUNT, 3), their weights (COUNT,), and the density that the model tells of them (COUNT,)."""
    draw = mi.PCG32(size=COUNT)
    one, two = draw.next_float32(), mi.Point2f(draw.next_float32(), draw.next_float32())
    si = point(cosine)
    found, weight = material.sample(mi.BSDFContext(), si, one, two)
    return np.array(found.wo).T, np.array(weight)[0], np.array(material.pdf(mi.BSDFContext(), si, found.wo))


@pytest.mark.parametrize("cosine", [0.9, 0.4])
@pytest.mark.parametrize("roughness", [0.25, 0.6])
@pytest.mark.parametrize(("base", "metallic"), [(0.7, 0.0), (1.0, 1.0)])
def test_energy_is_that_of_our_integrals(base, roughness, metallic, cosine):
    _, weight, _ = sampled(bsdf(base, roughness, metallic), cosine)
    view, rough = torch.tensor([cosine]), torch.tensor([roughness])
    a, b = (float(x) for x in brdf.environment_brdf(view, rough))
    f0 = 0.04 * (1 - metallic) + base * metallic
    diffuse = base * (1 - metallic) * (1 - f0) * (1 - float(brdf.diffuse_fresnel(view)))
    assert weight.mean() == pytest.approx(f0 * a + b + diffuse, rel=0.01)


NORMALS = [None, (0.3, -0.2, math.sqrt(1 - 0.13))]


@pytest.mark.parametrize("normal", NORMALS)
@pytest.mark.parametrize("material", [(0.6, 0.3, 0.0), (0.6, 0.5, 1.0)])
def test_samples_follow_the_density(material, normal):
    """χ² over 10 x 20 cells of the hemisphere; the density is summed over 24 x 24 points of a cell."""
    model = bsdf(*material, normal)
    wo, _, known = sampled(model, 0.7)
    kept = (wo[:, 2] > 0) & (known > 0)  # others go through the surface and weigh nothing
    rows, columns, fine = 10, 20, 24
    z = (np.arange(rows * fine) + 0.5) / (rows * fine)
    azimuth = 2 * math.pi * (np.arange(columns * fine) + 0.5) / (columns * fine)
    ring = np.sqrt(1 - z**2)[:, None]
    grid = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z[:, None] + 0 * azimuth]).reshape(3, -1)
    si = dr.zeros(mi.SurfaceInteraction3f, grid.shape[1])
    si.sh_frame, si.wi = mi.Frame3f(mi.Vector3f(0, 0, 1)), mi.Vector3f(math.sqrt(1 - 0.49), 0, 0.7)
    density = np.array(model.pdf(mi.BSDFContext(), si, mi.Vector3f(np.float32(grid))))
    solid_angle = 2 * math.pi / density.size
    expected = COUNT * solid_angle * density.reshape(rows, fine, columns, fine).sum((1, 3)).ravel()
    row = np.minimum((wo[kept, 2] * rows).astype(int), rows - 1)
    column = (np.arctan2(wo[kept, 1], wo[kept, 0]) % (2 * math.pi) / (2 * math.pi) * columns).astype(int) % columns
    counted = np.bincount(row * columns + column, minlength=rows * columns)
    likely = expected > 50  # cells at the very rim hold what the numerical sum cannot resolve
    statistic = ((counted - expected)[likely] ** 2 / expected[likely]).sum()
    freedom = likely.sum()
    assert freedom > 50
    assert statistic < freedom + 5 * math.sqrt(2 * freedom)


def test_a_mapped_normal_turns_the_highlight():
    tilt = (math.sin(0.2), 0.0, math.cos(0.2))
    mirror = {}
    for name, normal in (("flat", None), ("mapped", tilt)):
        wo, _, _ = sampled(bsdf(1.0, 0.1, 1.0, normal), 1.0)
        mirror[name] = np.median(np.arctan2(wo[:, 0], wo[:, 2]))
    assert mirror["flat"] == pytest.approx(0.0, abs=0.01)
    assert mirror["mapped"] == pytest.approx(0.4, abs=0.02)
