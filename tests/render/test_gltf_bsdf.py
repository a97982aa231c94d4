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
        "type": "gltf_metallic_roughness",
        "base_color": texture(base, base, base),
        "orm": texture(1.0, roughness, metallic),
    }
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
    a, b, c = (float(x) for x in brdf.environment_brdf(view, rough))
    f0 = 0.04 * (1 - metallic) + base * metallic
    diffuse = base * (1 - metallic) * (1 - f0) * (1 - c)
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
    turn = np.arctan2(wo[kept, 1], wo[kept, 0]) % (2 * math.pi) / (2 * math.pi)
    column = (turn * columns).astype(int) % columns
    counted = np.bincount(row * columns + column, minlength=rows * columns)
    likely = expected > 50  # cells at the very rim hold what the numerical sum cannot resolve
    statistic = ((counted - expected)[likely] ** 2 / expected[likely]).sum()
    freedom = likely.sum()
    assert freedom > 50
    assert statistic < freedom + 5 * math.sqrt(2 * freedom)


TANGENT = np.array([0.5, -0.7, 0.6])  # in the world, neither of unit length nor in the surface's plane
# of the shading frame, in the world
AXES = np.array([[0.6, 0.0, -0.8], [0.48, 0.8, 0.36], [0.64, -0.6, 0.48]])
BASE = np.array([0.9, 0.45, 0.15])
SURFACES = [  # roughness, metallic, mapped normal with the side of its bitangent; all three bounds of the chance
    (0.35, 0.0, None),
    (0.5, 0.6, None),
    (0.3, 1.0, None),
    (0.45, 0.3, (0.3, -0.2, 1)),
    (0.45, 0.3, (0.3, -0.2, -1)),
    (0.6, 0.1, (-0.8, 0.5, 1)),
]


def described(roughness: float, metallic: float, bend: tuple[float, float, int] | None) -> mi.BSDF:
    """Return the model; `bend`: x and y of the mapped normal, and the bitangent's side of the tangent."""
    description = {
        "type": "gltf_metallic_roughness",
        "base_color": texture(*BASE),
        "orm": texture(0.2, roughness, metallic),
    }
    if bend is not None:
        x, y, side = bend
        description["normal"] = texture(x, y, math.sqrt(1 - x * x - y * y))
        description |= {"handedness": texture(side, side, side), "tangent": texture(*TANGENT)}
    return mi.load_dict(description)


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def mapped_normal(bend: tuple[float, float, int] | None, view: np.ndarray) -> np.ndarray:
    """Return in the shading frame (N, 3) the normal that `view` (N, 3) on its upper side sees."""
    if bend is None:
        return np.tile([0.0, 0.0, 1.0], (len(view), 1))
    x, y, side = bend
    along = AXES @ TANGENT
    along = unit(np.array([along[0], along[1], 0.0]))
    down = side * np.cross([0.0, 0.0, 1.0], along)
    normal = x * along + y * down + math.sqrt(1 - x * x - y * y) * np.array([0.0, 0.0, 1.0])
    return unit(normal + np.maximum(0.02 - view @ normal, 0)[:, None] * view)


def expected(surface, wi: np.ndarray, wo: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return value times cosine (N, 3), density (N,), and chance (N,) of the specular lobe, by glTF's definition."""
    roughness, metallic, bend = surface
    upper = np.sign(wi[:, 2:]) * [[0, 0, 1]] + [[1, 1, 0]]
    view, light = wi * upper, wo * upper
    n = mapped_normal(bend, view)
    h, alpha = unit(view + light), roughness**2
    nv, nl, nh, vh = ((a * b).sum(1) for a, b in ((n, view), (n, light), (n, h), (view, h)))
    diffuse, f0 = BASE * (1 - metallic), 0.04 * (1 - metallic) + BASE * metallic
    fresnel = f0 + (1 - f0) * ((1 - vh) ** 5)[:, None]
    d = alpha**2 / (math.pi * (nh**2 * (alpha**2 - 1) + 1) ** 2)
    root_v, root_l = (np.sqrt(alpha**2 + (1 - alpha**2) * c**2) for c in (nv, nl))
    lobe = d * 0.5 / np.maximum(nl * root_v + nv * root_l, 1e-9)
    value = ((1 - fresnel) * diffuse / math.pi + fresnel * lobe[:, None]) * nl[:, None]
    head_on = (f0 + (1 - f0) * ((1 - np.abs(nv)) ** 5)[:, None]).mean(1)
    chance = np.clip(head_on / (head_on + diffuse.mean() + 1e-4), 0.15, 0.95)
    visible = 2 * nv / (nv + root_v) * d / (4 * nv)  # density of directions reflected by visible normals
    density = chance * visible + (1 - chance) * nl / math.pi
    lit = (view[:, 2] > 0) & (light[:, 2] > 0) & (nv > 0) & (nl > 0)
    return np.where(lit[:, None], value, 0), np.where(lit, density, 0), chance


def turned_points(wi: np.ndarray) -> mi.SurfaceInteraction3f:
    """Return points whose shading frame is `AXES`, seen from `wi` (N, 3) in that frame."""
    si = dr.zeros(mi.SurfaceInteraction3f, len(wi))
    si.sh_frame = mi.Frame3f(*(mi.Vector3f(*axis) for axis in AXES.tolist()))
    si.wi = mi.Vector3f(np.float32(wi.T))
    return si


@pytest.mark.parametrize("surface", SURFACES)
def test_value_and_density_are_gltf_s_in_every_pair_of_directions(surface):
    """Seen and lit from either side, with a tangent that is neither unit nor at right angles to the normal."""
    random = np.random.default_rng(3)
    wi, wo = unit(random.normal(size=(2, 3000, 3)))
    model, si, context = described(*surface), turned_points(wi), mi.BSDFContext()
    light = mi.Vector3f(np.float32(wo.T))
    value, density, _ = expected(surface, wi, wo)
    assert 0.1 < (density > 0).mean() < 0.6
    found = np.array(model.eval(context, si, light)).T
    np.testing.assert_allclose(found, value, rtol=2e-3, atol=1e-5)
    np.testing.assert_allclose(np.array(model.pdf(context, si, light)), density, rtol=2e-3, atol=1e-5)
    both = model.eval_pdf(context, si, light)
    np.testing.assert_array_equal(np.array(both[0]).T, found)
    np.testing.assert_array_equal(np.array(both[1]), np.array(model.pdf(context, si, light)))


@pytest.mark.parametrize("surface", SURFACES)
def test_a_sample_tells_its_lobe_its_density_and_what_it_weighs(surface):
    random = np.random.default_rng(4)
    wi = unit(random.normal(size=(3000, 3)))
    one, two = random.random(3000), random.random((2, 3000))
    draws = mi.Float(np.float32(one)), mi.Point2f(np.float32(two))
    found, weight = described(*surface).sample(mi.BSDFContext(), turned_points(wi), *draws)
    wo = np.float64(np.array(found.wo).T)
    np.testing.assert_allclose(np.linalg.norm(wo, axis=1), 1, atol=1e-4)
    value, density, chance = expected(surface, wi, wo)
    specular = one < chance
    clear = np.abs(one - chance) > 1e-4
    np.testing.assert_array_equal(np.array(found.sampled_component)[clear], specular[clear].astype(int))
    glossy, diffuse = (int(kind) for kind in (mi.BSDFFlags.GlossyReflection, mi.BSDFFlags.DiffuseReflection))
    kinds = np.where(specular, glossy, diffuse)
    np.testing.assert_array_equal(np.array(found.sampled_type)[clear], kinds[clear])
    np.testing.assert_array_equal(np.array(found.eta), 1)
    plain = (density == 0) | (density > 1e-3)
    np.testing.assert_allclose(np.array(found.pdf)[plain], density[plain], rtol=1e-2, atol=1e-4)
    shown = density > 0.01
    assert shown.mean() > 0.5
    weights, ratio = np.array(weight).T, value / np.maximum(density, 1e-9)[:, None]
    np.testing.assert_allclose(weights[shown], ratio[shown], rtol=1e-2, atol=1e-4)
    np.testing.assert_array_equal(weights[density == 0], 0)
