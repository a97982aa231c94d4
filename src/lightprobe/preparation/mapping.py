"""Structure from motion by COLMAP from features and matches that are already found, and what it finds.

Pixels are those of the working pictures; cameras have OpenGL's axes (x right, y up, looking along -z). Lens:
x' = x (1 + k r^2) in units of the focal length, COLMAP's SIMPLE_RADIAL.
"""

import os
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from lightprobe.preparation.features import Features, pycolmap_library, working_folder
from lightprobe.scene.camera import Camera

Pair = tuple[int, int]
Matches = Mapping[Pair, np.ndarray]
FEWEST_MATCHES = 15  # of a pair that may count
_POINT, _MATCH = 40, 64  # bytes of a feature and of a match in all that is written, or a little less
_FALLBACK_FOCAL = 1.2  # in the longer side, where nothing tells: COLMAP's
_LARGEST_BEND = 0.6  # k beyond which no lens with a name is; what goes there has come apart
_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # between COLMAP's axes and OpenGL's
_STOP = 1e-6  # relative change of the error that ends an adjustment
_INIT_INLIERS, _INIT_DEGREES = 60, 8.0  # of the first pair: objects have fewer features than houses
_POSE_INLIERS, _POSE_SHARE = 12, 0.1  # of a photo that is added: 20 and .2 added 24 of 40 turntable photos
_TRIALS = 1500  # of a pair's geometry: 10000, COLMAP's, take three times as long and found no match more


@dataclass(frozen=True)
class Solution:
    """Cameras of K photos, P points in space, and T pairs of a feature and the point it sees."""

    photo: np.ndarray  # (K,) int64, index of the photo of each camera, ascending
    pose: np.ndarray  # (K, 4, 4) float64 camera to world
    lens: np.ndarray  # (K, 4) float64: focal length, principal point x and y, k
    size: np.ndarray  # (K, 2) int64: width and height of the working picture
    points: np.ndarray  # (P, 3) float64
    errors: np.ndarray  # (P,) float64, mean reprojection error in pixels
    seen_by: np.ndarray  # (T,) int64, index of a photo
    feature: np.ndarray  # (T,) int64, index of its feature
    seen: np.ndarray  # (T,) int64, index of a point

    def cameras(self) -> dict[int, Camera]:
        """Return the pinhole part of each camera by the index of its photo."""
        rows = zip(self.photo, self.pose, self.lens, self.size, strict=True)
        return {
            int(photo): Camera(pose, f, f, cx, cy, int(width), int(height))
            for photo, pose, (f, cx, cy, _), (width, height) in rows
        }

    def distortion(self) -> dict[int, float]:
        """Return the lens' k by the index of the photo."""
        return {int(photo): float(row[3]) for photo, row in zip(self.photo, self.lens, strict=True)}

    def mapped(self, rotation: np.ndarray, scale: float = 1.0) -> "Solution":
        """Return the solution with the world turned by `rotation` (3, 3), then scaled."""
        pose = self.pose.copy()
        pose[:, :3, :3] = rotation @ pose[:, :3, :3]
        pose[:, :3, 3] = scale * pose[:, :3, 3] @ rotation.T
        return replace(self, pose=pose, points=scale * self.points @ rotation.T)


def bent(points: np.ndarray, camera: Camera, k: float) -> np.ndarray:
    """Return where a lens shows what a pinhole shows at `points` (N, 2), pixels."""
    x, y = (points[:, 0] - camera.cx) / camera.fx, (points[:, 1] - camera.cy) / camera.fy
    stretch = 1 + k * (x * x + y * y)
    return np.stack([camera.cx + camera.fx * x * stretch, camera.cy + camera.fy * y * stretch], 1)


def straightened(points: np.ndarray, camera: Camera, k: float) -> np.ndarray:
    """Return where a pinhole shows what the lens shows at `points` (N, 2), pixels: the inverse of `bent`."""
    start = np.stack([(points[:, 0] - camera.cx) / camera.fx, (points[:, 1] - camera.cy) / camera.fy], 1)
    straight = start.copy()
    for _ in range(20):  # a contraction for every lens that is not nearly a fisheye
        straight = start / np.maximum(1 + k * (straight**2).sum(1, keepdims=True), 0.1)
    return straight * [camera.fx, camera.fy] + [camera.cx, camera.cy]


class Lenses(StrEnum):
    """Which photos are taken to have one focal length and lens."""

    AS_TOLD = "as the files tell"
    """Those of equal size and focal length, which is what EXIF says."""
    BY_SIZE = "one for each size of photo"
    EACH_ITS_OWN = "one for each photo"


def reconstruct(
    photos: Sequence[Features], matches: Matches, focal: Sequence[float | None], lenses: Lenses, seed: int = 0
) -> list[Solution]:
    """Return the models that COLMAP makes of matches (M, 2), the one with most photos first; empty for none.

    focal: focal length over the longer side of each photo, None where unknown. One thread, so that equal
    seeds give equal models. Raises `ConfigError` without pycolmap.
    """
    pycolmap = pycolmap_library()
    needed = sum(_POINT * len(each.points) for each in photos)
    needed += sum(_MATCH * len(rows) for rows in matches.values())
    with working_folder(needed) as folder:
        database = folder / "database.db"
        pycolmap.set_random_seed(seed)
        # pairs are verified without a guessed focal length: a wrong one loses matches
        guessed = lenses is Lenses.BY_SIZE and any(focal)
        _write(pycolmap, database, photos, matches, focal, Lenses.EACH_ITS_OWN if guessed else lenses)
        verifier, geometry = pycolmap.GeometricVerifierOptions(), pycolmap.TwoViewGeometryOptions()
        verifier.num_threads = os.cpu_count() or 1  # each pair is seeded for itself
        geometry.ransac.random_seed, geometry.ransac.max_num_trials = seed, _TRIALS
        pycolmap.geometric_verification(database, verifier, two_view_geometry_options=geometry)
        if guessed:
            database = _shared(pycolmap, database, photos, matches, focal)
        elif lenses is not Lenses.AS_TOLD or not any(focal):
            calibration = pycolmap.ViewGraphCalibrationOptions()
            calibration.random_seed = seed
            pycolmap.calibrate_view_graph(database, calibration)
        models = pycolmap.incremental_mapping(database, folder, folder, _options(pycolmap, lenses, seed))
        found = [solution_of(model) for model in models.values()]
    return sorted(found, key=lambda model: -len(model.photo))


def _shared(
    pycolmap: Any, verified: Path, photos: Sequence[Features], matches: Matches, focal: Sequence[float | None]
) -> Path:
    """Return a database with the pairs' geometry of `verified`, and one lens for all photos of a size.

    It starts from the middle of the focal lengths that files tell, which need not be right for any one photo.
    """
    start = float(np.median([ratio for ratio in focal if ratio is not None]))
    path = verified.with_name("shared.db")
    same = [start] * len(photos)  # one told length: one lens by size
    _write(pycolmap, path, photos, matches, same, Lenses.AS_TOLD)
    before, after = pycolmap.Database.open(verified), pycolmap.Database.open(path)
    for (i, j), rows in matches.items():
        if len(rows) >= FEWEST_MATCHES:
            after.write_two_view_geometry(i + 1, j + 1, before.read_two_view_geometry(i + 1, j + 1))
    before.close()
    after.close()
    return path


def _options(pycolmap: Any, lenses: Lenses, seed: int) -> Any:
    """Return COLMAP's settings; a lens that photos are only thought to share is straight."""
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads, options.random_seed, options.extract_colors = 1, seed, False
    options.min_model_size, options.max_num_models = 4, 6
    options.ba_global_function_tolerance = options.ba_local_function_tolerance = _STOP
    options.ba_refine_extra_params = options.mapper.abs_pose_refine_extra_params = lenses is Lenses.AS_TOLD
    options.max_extra_param = _LARGEST_BEND
    options.mapper.max_extra_param = options.triangulation.max_extra_param = _LARGEST_BEND
    options.mapper.init_min_num_inliers, options.mapper.init_min_tri_angle = _INIT_INLIERS, _INIT_DEGREES
    options.mapper.abs_pose_min_num_inliers = _POSE_INLIERS
    options.mapper.abs_pose_min_inlier_ratio = _POSE_SHARE
    return options


def _write(
    pycolmap: Any,
    path: Path,
    photos: Sequence[Features],
    matches: Matches,
    focal: Sequence[float | None],
    lenses: Lenses,
) -> None:
    """Write the database that COLMAP works on; the photo of index i is image i + 1."""
    groups: dict[Any, int] = {}
    database = pycolmap.Database.open(path)
    for index, features in enumerate(photos):
        size, told = (features.width, features.height), focal[index]
        by_file = size, None if told is None else round(told, 3)
        key = {Lenses.AS_TOLD: by_file, Lenses.BY_SIZE: size, Lenses.EACH_ITS_OWN: index}[lenses]
        if key not in groups:
            groups[key] = _write_camera(pycolmap, database, size, told if lenses is Lenses.AS_TOLD else None)
        image = pycolmap.Image(name=f"{index}", camera_id=groups[key], image_id=index + 1)
        database.write_image(image, use_image_id=True)
        frame = pycolmap.Frame()
        frame.rig_id, frame.frame_id = groups[key], index + 1
        frame.add_data_id(image.data_id)
        database.write_frame(frame, use_frame_id=True)
        database.write_keypoints(index + 1, features.points)
    for (i, j), rows in matches.items():
        if len(rows) >= FEWEST_MATCHES:
            database.write_matches(i + 1, j + 1, rows)
    database.close()


def focal_length(told: float | None, size: tuple[int, int]) -> float:
    """Return the focal length in pixels of a photo whose file tells it over the longer side, or does not."""
    return (told or _FALLBACK_FOCAL) * max(size)


def lens_camera(pycolmap: Any, focal: float, size: tuple[int, int]) -> Any:
    """Return COLMAP's camera of a straight lens; focal length and (width, height) in pixels."""
    return pycolmap.Camera.create_from_model_id(0, pycolmap.CameraModelId.SIMPLE_RADIAL, focal, *size)


def world_pose(matrix: np.ndarray) -> np.ndarray:
    """Return camera to world (4, 4), OpenGL's axes, of COLMAP's world to camera (3, 4)."""
    to_camera = np.eye(4)
    to_camera[:3] = matrix
    return np.linalg.inv(to_camera) @ _FLIP


def from_world(pose: np.ndarray) -> np.ndarray:
    """Return COLMAP's world to camera (3, 4) of camera to world (4, 4), OpenGL's axes: the inverse of `world_pose`."""
    return np.linalg.inv(pose @ _FLIP)[:3]


def _write_camera(pycolmap: Any, database: Any, size: tuple[int, int], told: float | None) -> int:
    """Write a camera, and the rig that COLMAP wants around it; return their number."""
    focal = focal_length(told, size)
    camera = lens_camera(pycolmap, focal, size)
    camera.has_prior_focal_length = told is not None
    camera.camera_id = database.write_camera(camera)
    rig = pycolmap.Rig()
    rig.rig_id = camera.camera_id
    rig.add_ref_sensor(camera.sensor_id)
    database.write_rig(rig, use_rig_id=True)
    return camera.camera_id


def solution_of(model: Any) -> Solution:
    """Return COLMAP's model with OpenGL's axes."""
    registered = (model.image(number) for number in model.reg_image_ids())
    images = sorted(registered, key=lambda image: int(image.name))
    poses, lens, sizes = [], [], []
    for image in images:
        poses.append(world_pose(image.cam_from_world().matrix()))
        lens.append(image.camera.params)
        sizes.append((image.camera.width, image.camera.height))
    index = {number: int(model.image(number).name) for number in model.reg_image_ids()}
    points = [model.points3D[number] for number in sorted(model.points3D)]
    seen = [
        (index[element.image_id], element.point2D_idx, row)
        for row, point in enumerate(points)
        for element in point.track.elements
    ]
    table = np.array(seen, np.int64).reshape(-1, 3)
    return Solution(
        np.array([int(image.name) for image in images], np.int64),
        np.array(poses),
        np.array(lens),
        np.array(sizes, np.int64),
        np.array([point.xyz for point in points]).reshape(-1, 3),
        np.array([point.error for point in points]),
        *table.T,
    )


def match_counts(matches: Matches) -> dict[int, int]:
    """Return by the index of a photo how many matches (M, 2) it has with its best partner."""
    best: dict[int, int] = defaultdict(int)
    for pair, rows in matches.items():
        for photo in pair:
            best[photo] = max(best[photo], len(rows))
    return dict(best)
