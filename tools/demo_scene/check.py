"""Proof that a scene's files mean what its README says, from the files alone; and its noise against a longer
render.

Direct light is summed over the delivered environment with the delivered material, normals and cameras, at
pixels whose whole hemisphere is free according to the delivered mesh, and compared with the delivered linear
render.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .files import read_exr, read_obj, read_png, srgb_decode, srgb_encode
from .lights import directions, solid_angles

_TRIES = 20  # pixels looked at for each one wanted: some photos show none whose hemisphere is free
_FINE = 192  # rows of the quadrature: narrow highlights need more than the map's 64


@dataclass(frozen=True)
class Samples:
    """Free pixels of one photo; P of them."""

    rendered: np.ndarray  # (P, 3) linear radiance
    base: np.ndarray  # (P, 3) linear
    roughness: np.ndarray  # (P,)
    metallic: np.ndarray  # (P,)
    normal: np.ndarray  # (P, 3) unit
    view: np.ndarray  # (P, 3) unit, towards the camera


def look_up(environment: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Bilinear radiance (..., 3) of an environment (H, 2H, 3) in unit directions (..., 3); rows end at the
    poles.
    """
    height, width = environment.shape[:2]
    row = np.clip(height * np.arccos(np.clip(direction[..., 2], -1, 1)) / np.pi - 0.5, 0, height - 1)
    column = width * (0.5 - np.arctan2(direction[..., 1], direction[..., 0]) / (2 * np.pi)) - 0.5
    i, j = np.minimum(np.floor(row).astype(int), height - 2), np.floor(column).astype(int)
    s, t = (row - i)[..., None], (column - j)[..., None]
    left, right = j % width, (j + 1) % width
    top = environment[i, left] * (1 - t) + environment[i, right] * t
    return top * (1 - s) + (environment[i + 1, left] * (1 - t) + environment[i + 1, right] * t) * s


def reflect(samples: Samples, light: np.ndarray) -> np.ndarray:
    """BRDF times cosine, (P, N, 3), of glTF metallic-roughness towards light directions (N, 3)."""
    alpha2 = samples.roughness[:, None] ** 4
    n_l = np.clip(samples.normal @ light.T, 0, 1)
    n_v = np.clip((samples.normal * samples.view).sum(axis=1), 1e-4, 1)[:, None]
    half = samples.view[:, None] + light[None]
    half /= np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-9)
    n_h = np.einsum("pk,pnk->pn", samples.normal, half)
    v_h = np.clip(np.einsum("pk,pnk->pn", samples.view, half), 0, 1)
    d = alpha2 / (np.pi * (n_h**2 * (alpha2 - 1) + 1) ** 2)
    v = 0.5 / (n_l * np.sqrt(alpha2 + (1 - alpha2) * n_v**2) + n_v * np.sqrt(alpha2 + (1 - alpha2) * n_l**2))
    metallic = samples.metallic[:, None]
    f0 = 0.04 * (1 - metallic) + samples.base * metallic
    fresnel = f0[:, None] + (1 - f0[:, None]) * ((1 - v_h) ** 5)[..., None]
    diffuse = (samples.base * (1 - metallic) / np.pi)[:, None]
    return ((1 - fresnel) * diffuse + fresnel * (d * v)[..., None]) * n_l[..., None]


def direct_light(
    samples: Samples, environment: np.ndarray, turn: float = 0.0, *, mirrored: bool = False
) -> np.ndarray:
    """Radiance (P, 3) the samples reflect; `turn` (radians) and `mirrored` misread the azimuth on purpose."""
    light = directions(_FINE).reshape(-1, 3)
    cos, sin = np.cos(turn), np.sin(turn)
    seen = (
        light * [1.0, -1.0 if mirrored else 1.0, 1.0] @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    )
    power = look_up(environment, seen) * np.broadcast_to(solid_angles(_FINE), (_FINE, 2 * _FINE)).reshape(
        -1, 1
    )
    pieces = [slice(k, k + 1) for k in range(len(samples.rendered))]
    one = [Samples(*(getattr(samples, name)[piece] for name in Samples.__annotations__)) for piece in pieces]
    return np.concatenate([np.einsum("pnk,nk->pk", reflect(sample, light), power) for sample in one])


def blocked(origin: np.ndarray, direction: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Return for rays from one point (3,) along (N, 3) whether they hit any triangle (F, 3, 3); all pairs are
    tried.

    Moeller and Trumbore's test, with the ray's determinants written as products of two matrices.
    """
    a = triangles[:, 0] - origin
    edge1, edge2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    determinant = -(direction @ np.cross(edge1, edge2).T)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (direction @ np.cross(a, edge2).T) / determinant
        v = -(direction @ np.cross(a, edge1).T) / determinant
        distance = -(np.cross(edge1, edge2) * a).sum(axis=1) / determinant
    return ((u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 1e-4)).any(axis=1)


def free_pixels(
    root: Path, scene: dict, frame: dict, count: int, rng: np.random.Generator, rays: int = 500
) -> Samples:
    """Return up to `count` pixels of a photo with an even surface whose hemisphere is unobstructed, maybe
    none.
    """
    linear, normal = read_exr(root / frame["hdr_path"], "RGBA"), read_exr(root / frame["normal_path"], "XYZ")
    base, orm = srgb_decode(read_png(root / frame["basecolor_path"])), read_png(root / frame["orm_path"])
    vertices, faces = read_obj(root / "mesh.obj")
    pose, side = np.array(frame["transform_matrix"]), scene["w"]
    focal = 0.5 * side / np.tan(0.5 * scene["camera_angle_x"])
    even = _even(np.concatenate([base, orm[..., 1:], linear[..., 3:]], axis=-1), 0.04) & _even(normal, 0.15)
    rows, columns = np.nonzero(even & (linear[..., 3] > 0.999))
    triangles, chosen, towards = vertices[faces], [], []
    spread = _fibonacci(rays)
    for pick in rng.permutation(len(rows))[: _TRIES * count]:
        i, j = rows[pick], columns[pick]
        ray = pose[:3, :3] @ [(j + 0.5 - side / 2) / focal, -(i + 0.5 - side / 2) / focal, -1.0]
        n = normal[i, j] / np.linalg.norm(normal[i, j])
        hit = first_hit(pose[:3, 3], ray, triangles)
        above = spread[spread @ n > 0.02]
        start = (
            pose[:3, 3] + ray * hit + 0.004 * n
        )  # a little off the facet, which the smooth normal does not know
        if not any(
            blocked(start, part, triangles).any() for part in (above[::16], above)
        ):  # a few first, to save time
            chosen.append((i, j))
            towards.append(-ray / np.linalg.norm(ray))
        if len(chosen) == count:
            break
    i, j = np.array(chosen, int).reshape(-1, 2).T
    unit = normal[i, j] / np.linalg.norm(normal[i, j], axis=1, keepdims=True)
    return Samples(
        linear[i, j, :3], base[i, j], orm[i, j, 1], orm[i, j, 2], unit, np.reshape(towards, (-1, 3))
    )


def _even(values: np.ndarray, tolerance: float) -> np.ndarray:
    """Mask of pixels whose 3x3 neighbourhood differs by less than `tolerance` in every channel."""
    near = np.stack([np.roll(values, (a, b), (0, 1)) for a in (-1, 0, 1) for b in (-1, 0, 1)])
    return (near.max(axis=0) - near.min(axis=0)).max(axis=-1) < tolerance


def _fibonacci(count: int) -> np.ndarray:
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = np.arange(count) * np.pi * (3 - np.sqrt(5))
    return np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], axis=1)


def first_hit(origin: np.ndarray, ray: np.ndarray, triangles: np.ndarray) -> float:
    """Distance in units of `ray` to the nearest triangle on it."""
    a, edge1, edge2 = (
        triangles[:, 0] - origin,
        triangles[:, 1] - triangles[:, 0],
        triangles[:, 2] - triangles[:, 0],
    )
    determinant = -(np.cross(edge1, edge2) @ ray)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = (np.cross(a, edge2) @ ray) / determinant, -(np.cross(a, edge1) @ ray) / determinant
        distance = -(np.cross(edge1, edge2) * a).sum(axis=1) / determinant
    inside = (u >= -1e-4) & (v >= -1e-4) & (u + v <= 1.0001) & (distance > 0)
    return float(distance[inside].min())


def correlation(predicted: np.ndarray, rendered: np.ndarray) -> float:
    """Pearson correlation of the logarithms, over all pixels and channels."""
    return float(np.corrcoef(np.log(predicted + 1e-4).ravel(), np.log(rendered + 1e-4).ravel())[0, 1])


def noise(root: Path, scene: dict, frame: dict) -> float:
    """PSNR in dB, sRGB inside the mask, of a delivered photo against the mean of eight further ones."""
    from .dataset import Settings, Writer  # starts Mitsuba, which the rest does without
    from .models import Subject
    from .render import View

    made = json.loads((root / "generation.json").read_text())
    studio = Writer(root, Settings(object=Subject(made["object"]), seed=made["seed"])).studio
    studio.set_environment(read_exr(root / frame["env_path"], "RGB").astype(np.float32))
    view = View(np.array(frame["transform_matrix"]), scene["camera_angle_x"])
    # One by one, because a single render of as many samples needs several gigabytes.
    long = np.mean(
        [studio.photograph(view, scene["w"], made["samples"], seed=90_000 + k) for k in range(8)], axis=0
    )
    mask = long[..., 3] > 0.999
    error = srgb_encode(long[..., :3][mask]) - srgb_encode(read_exr(root / frame["hdr_path"], "RGB")[mask])
    return float(-10 * np.log10(np.mean(error**2)))


def report(root: Path, pixels: int = 24) -> str:
    """Return the checks of a scene as text, one test photo after another."""
    scene = json.loads((root / "transforms_test.json").read_text())
    rng = np.random.default_rng(0)
    cases = {"as written": {}, "turned by 3 degrees": {"turn": np.radians(3)}, "mirrored": {"mirrored": True}}
    found: dict[str, list[np.ndarray]] = {name: [] for name in cases}
    rendered, lines = [], []
    for frame in scene["frames"]:
        samples = free_pixels(root, scene, frame, pixels, rng)
        if not len(samples.rendered):
            lines.append(f"{frame['file_path']} {frame['hdri']}: no pixel sees a free hemisphere")
            continue
        environment = read_exr(root / frame["env_path"], "RGB")
        for name, case in cases.items():
            found[name].append(direct_light(samples, environment, **case))
        ratio = np.median(found["as written"][-1] / samples.rendered)
        rendered.append(samples.rendered)
        lines.append(
            f"{frame['file_path']} {frame['hdri']}: {len(samples.rendered)} pixels, median ratio {ratio:.3f}"
        )
    truth = np.concatenate(rendered) if rendered else np.empty((0, 3))
    for name, values in found.items() if rendered else ():
        together = np.concatenate(values)
        ratio = together / truth
        lines.append(
            f"{name}: correlation {correlation(together, truth):.4f}, ratio mean {ratio.mean():.3f}, median"
            f" {np.median(ratio):.3f}, median error {np.median(np.abs(ratio - 1)):.2%}"
        )
    lines += [
        f"noise of {frame['file_path']}: {noise(root, scene, frame):.1f} dB" for frame in scene["frames"][:2]
    ]
    return "\n".join(lines)
