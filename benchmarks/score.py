"""Score predicted environment maps of any program against true ones; shares no code for light with lightprobe.

    python -m benchmarks score SCENES PREDICTIONS

SCENES holds scenes, or is one: folders whose `transforms_test.json` names the true environment of each photo
(`env_path`), or simulated shoots (`shoot.json` and `light/`). PREDICTIONS/SCENE/PHOTO.exr is a predicted map, for instance
PREDICTIONS/spot/r_003.exr; of a single scene it may lie in PREDICTIONS itself. Maps are equirectangular with 2H x H pixels
of linear radiance in the scene's frame: the top row is straight up (+z), the middle column looks along +x, and columns
to the right turn towards -y. Photos without a map are named, and means are over the others.

For each scene, and for a grey map: root mean squares over the sphere of the error of ln radiance (both raised by a
hundredth of the true mean), raw and after the one factor that fits best; and errors of three spheres under the map,
diffuse, matte (GGX, roughness .369) and mirror, seen from the photo's camera. For the spheres both maps are raised
to 1 / 2.4 and scaled so that their median is .5; the spheres' error is a root mean square over their discs, summed over
channels, after the factor that fits best.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.ndimage import map_coordinates

from benchmarks import command_line
from demo_scene.files import read_exr
from demo_scene.lights import directions, reduce_area, solid_angles
from lightprobe.core.errors import InputError
from lightprobe.core.files import read_json

_ROWS, _COARSE = 128, 32  # of maps, and of those that light the two rough spheres
_LOG_ROWS = 64  # of the maps whose logarithms are compared
_ROUGHNESS, _GAMMA, _MIDDLE, _FLOOR = 0.369, 2.4, 0.5, 0.01
_SIDE = 32  # pixels across a rough sphere's disc
COLUMNS = ("log-RMSE", "scaled", "diffuse", "matte", "mirror")


@dataclass(frozen=True)
class TruePhoto:
    """A test photo and its true light."""

    name: str
    pose: np.ndarray  # (4, 4) camera to world, OpenGL axes
    environment: Path
    gain: np.ndarray  # (3,) that the environment is multiplied by


def true_photos(scene: Path) -> list[TruePhoto]:
    """Return the test photos of a scene that have a true light; raise `InputError` for a scene without any."""
    try:
        found = list(_of_shoot(scene) if (scene / "shoot.json").is_file() else _of_transforms(scene))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{scene} is no scene whose test photos have cameras and true lights: {error}."
        ) from error
    if not found:
        raise InputError(f"{scene} names no true light of a test photo (env_path in transforms_test.json).")
    return found


def _of_transforms(scene: Path) -> Iterator[TruePhoto]:
    for frame in _frames(scene / "transforms_test.json"):
        if "env_path" in frame:
            pose = np.array(frame["transform_matrix"], float)
            yield TruePhoto(Path(frame["file_path"]).stem, pose, scene / frame["env_path"], np.ones(3))


def _of_shoot(scene: Path) -> Iterator[TruePhoto]:
    for frame in _frames(scene / "shoot.json"):
        if frame["split"] == "test":
            pose, gain = (np.array(frame[key], float) for key in ("transform_matrix", "gain"))
            yield TruePhoto(frame["name"], pose, scene / "light" / f"{frame['place']}.exr", gain)


def _frames(file: Path) -> list[dict[str, Any]]:
    value: Any = read_json(file)
    return list(value["frames"])


def resized(radiance: np.ndarray, rows: int) -> np.ndarray:
    """Return a map (H, 2H, 3) with at most `rows` rows, averaged by solid angle; sizes in between are sampled."""
    if len(radiance) <= rows:
        return radiance
    if len(radiance) % rows:
        radiance = sampled(radiance, rows * -(-len(radiance) // rows))
    return reduce_area(radiance, len(radiance) // rows)


def sampled(radiance: np.ndarray, rows: int) -> np.ndarray:
    """Return a map (H, 2H, 3) looked up bilinearly at the texels of one with `rows` rows."""
    h, w = radiance.shape[:2]
    v, u = np.meshgrid(
        (np.arange(rows) + 0.5) / rows, (np.arange(2 * rows) + 0.5) / (2 * rows), indexing="ij"
    )
    wrapped = np.concatenate([radiance[:, -1:], radiance, radiance[:, :1]], axis=1)
    at = np.clip(v * h - 0.5, 0, h - 1), u * w + 0.5
    return np.stack([map_coordinates(wrapped[..., k], at, order=1) for k in range(3)], axis=-1)


def brought_to(radiance: np.ndarray, rows: int) -> np.ndarray:
    """Return a map (H, 2H, 3) with so many rows."""
    return resized(radiance, rows) if len(radiance) >= rows else sampled(radiance, rows)


def log_errors(mine: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Return the errors of ln radiance of maps (H, 2H, 3), raw and after one factor."""
    mine, true = (brought_to(m, _LOG_ROWS) for m in (mine, true))
    share = np.broadcast_to(solid_angles(_LOG_ROWS), true.shape[:2])[..., None] / 3
    share = share / (3 * share.sum())
    floor = _FLOOR * float((share * true).sum())
    difference = np.log(np.maximum(mine, 0) + floor) - np.log(np.maximum(true, 0) + floor)
    raw = float((share * difference**2).sum())
    return raw**0.5, max(raw - float((share * difference).sum()) ** 2, 0.0) ** 0.5


def sphere_errors(mine: np.ndarray, true: np.ndarray, pose: np.ndarray) -> tuple[float, float, float]:
    """Return the errors of the diffuse, the matte and the mirror sphere under maps (H, 2H, 3)."""
    true = resized(true, _ROWS)
    fine = [_balanced(m) for m in (brought_to(mine, len(true)), true)]
    coarse = [brought_to(m, _COARSE).reshape(-1, 3) for m in fine]
    diffuse, matte = (_error(lobe @ coarse[0], lobe @ coarse[1], np.ones(len(lobe))) for lobe in _lobes(pose))
    solid = np.repeat(solid_angles(len(true))[:, 0], 2 * len(true))
    return diffuse, matte, _error(fine[0].reshape(-1, 3), fine[1].reshape(-1, 3), solid)


def _balanced(radiance: np.ndarray) -> np.ndarray:
    bent = np.maximum(radiance, 0) ** (1 / _GAMMA)
    positive = bent[bent > 0]
    return bent if len(positive) == 0 else bent * (_MIDDLE / np.median(positive))


def _lobes(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what pixels of a diffuse and of a matte sphere gather from the texels of a coarse map, (P, T) each."""
    view = pose[:3, 3] / np.linalg.norm(pose[:3, 3])
    right = np.cross(pose[:3, 1], view)
    right /= np.linalg.norm(right)
    x, y = np.meshgrid(*[(np.arange(_SIDE) + 0.5) * (2 / _SIDE) - 1] * 2)
    inside = x**2 + y**2 < 1
    x, y = x[inside], -y[inside]
    normals = np.stack([x, y, np.sqrt(1 - x**2 - y**2)], axis=1) @ np.stack(
        [right, np.cross(view, right), view]
    )
    towards = directions(_COARSE).reshape(-1, 3)
    solid = np.repeat(solid_angles(_COARSE)[:, 0], 2 * _COARSE)
    cosine = np.maximum(normals @ towards.T, 0)
    half = towards + view
    half /= np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-9)
    alpha2 = _ROUGHNESS**4
    lobe = cosine * solid / ((normals @ half.T) ** 2 * (alpha2 - 1) + 1) ** 2
    return cosine * solid / np.pi, lobe / lobe.sum(axis=1, keepdims=True)


def _error(mine: np.ndarray, true: np.ndarray, weight: np.ndarray) -> float:
    weight = weight[:, None] / weight.sum()
    factor = (weight * mine * true).sum() / max((weight * mine * mine).sum(), 1e-12)
    return float((weight * (factor * mine - true) ** 2).sum() ** 0.5)


def scores(mine: np.ndarray, photo: TruePhoto) -> np.ndarray:
    """Return the five errors of `COLUMNS` of a map (H, 2H, 3)."""
    true = read_exr(photo.environment, "RGB") * photo.gain
    return np.array([*log_errors(mine, true), *sphere_errors(mine, true, photo.pose)])


def _scenes(folder: Path) -> list[Path]:
    """Return the scenes in a folder, or the folder itself where it is one."""
    if (folder / "transforms_test.json").is_file() or (folder / "shoot.json").is_file():
        return [folder]
    found = [path.parent for path in sorted(folder.glob("*/transforms_test.json"))]
    if not found:
        raise InputError(f"{folder} holds no scene: no transforms_test.json there or one folder down.")
    return found


def _map(folder: Path, scene: str, name: str) -> np.ndarray | None:
    """Return a photo's predicted map (H, 2H, 3), None where there is none."""
    for file in (folder / scene / f"{name}.exr", folder / f"{name}.exr"):
        if file.is_file():
            try:
                radiance = read_exr(file, "RGB")
            except (KeyError, RuntimeError, OSError) as error:
                raise InputError(f"{file} is no EXR with channels R, G and B: {error}.") from error
            if radiance.shape[1] != 2 * len(radiance):
                raise InputError(
                    f"{file} is not twice as wide as it is high, so it is no map of a whole sphere."
                )
            return radiance
    return None


def main(words: Sequence[str]) -> int:
    """Print the errors of each scene's predictions as Markdown; return 1 where photos had no map."""
    parser = command_line(__doc__)
    parser.add_argument("scenes", type=Path, metavar="SCENES")
    parser.add_argument("predictions", type=Path, metavar="PREDICTIONS")
    given = parser.parse_args(words)
    print("| scene | photos | " + " | ".join(COLUMNS) + " |\n| --- |" + " ---: |" * (1 + len(COLUMNS)))
    missing = []
    for scene in _scenes(given.scenes):
        photos = true_photos(scene)
        maps = [_map(given.predictions, scene.name, photo.name) for photo in photos]
        missing += [f"{scene.name}/{p.name}" for p, m in zip(photos, maps, strict=True) if m is None]
        pairs = [(m, p) for m, p in zip(maps, photos, strict=True) if m is not None]
        grey = [(np.ones((_COARSE, 2 * _COARSE, 3)), photo) for photo in photos]
        for label, of in ((scene.name, pairs), (f"{scene.name}, grey map", grey)):
            if of:
                means = np.mean([scores(*pair) for pair in of], axis=0)
                print(
                    f"| {label} | {len(of)} | " + " | ".join(f"{mean:.3f}" for mean in means) + " |",
                    flush=True,
                )
    if missing:
        print(f"No map for {', '.join(missing)}.", file=sys.stderr)
    return int(bool(missing))
