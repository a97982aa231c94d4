"""Cameras placed exactly, judged, and mended: from a model that grew photo by photo to one that holds as a whole.

Points are triangulated from all matches that fit the cameras, followed through all photos (`alignment`), and cameras,
lens and points adjusted to them with a robust loss (Cauchy's), with less patience each time. A camera whose photo
shows hardly a point where it should is wrong, however well its own matches fit; it is looked for anew against the
others' points, as are photos that have none, and left out where it is not found. So are photos that agree among
themselves but share hardly a point with the others: nothing holds them where they are.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lightprobe.core.threads import in_threads
from lightprobe.preparation.alignment import RIGHT, Tracks, followed
from lightprobe.preparation.features import Features, pycolmap_library
from lightprobe.preparation.geometry import epipolar_distance, same_side
from lightprobe.preparation.mapping import (
    Matches,
    Pair,
    Solution,
    from_world,
    lens_camera,
    solution_of,
    world_pose,
)

_WEAK = 0.6  # of the usual share, below which a camera is looked for anew: it may be some degrees off
# Pixels: of matches from epipolar lines, of patches from their places.
_ROUNDS = ((8.0, 5.0), (4.0, 4.0), (3.0, 3.0))
# Pixels: scale of the loss, and error of points that stay.
_ADJUSTMENTS = ((1.0, 4.0), (0.6, 2.5), (0.4, 1.5))
_FITTING = 0.4  # share of a pair's matches that must fit the cameras, or the pair is another side's
_FEWEST = 10  # matches of a pair
_VIEWS = 3  # photos of a point that counts
_ANGLE = 1.5  # degrees between the rays of a point
_STEPS = 40  # of an adjustment
_MOST = 5000  # points; those in most photos
_BESIDE = 40.0  # degrees between photos that vote together for a lost photo's camera
_VOTERS = 6  # photos, those with most matches, that vote
_OFF = 6.0  # pixels of a match that agrees with a lost photo's camera
_MORE = 0.5  # of the pairs that were matched: at most as many again are, to find lost photos' cameras
# A lost photo shows .06 of the points and more where a camera says that is some degrees off, at most .046 where a wrong one
# does. Moved four times to the points that are shown, right ones had .10 and .13, wrong ones still .04.
_NEARLY, _MOVED, _MOVES = 0.05, 0.08, 4
_INLIERS = 12  # of a lost photo's camera, and points that two groups of photos must share to hold each other


@dataclass(frozen=True)
class Placed:
    """Cameras that were placed exactly."""

    solution: Solution
    share: dict[int, float]  # as in `Tracks`
    agreement: dict[int, float]  # likewise
    apart: tuple[tuple[int, ...], ...]  # photos of each group that the others did not hold


def placed(
    photos: Sequence[Features],
    matches: Matches,
    solution: Solution,
    pictures: Sequence[np.ndarray],
    match_more: Callable[[list[Pair]], Matches] | None = None,
) -> Placed:
    """Return a solution's cameras placed exactly, without those that are wrong, with those that were missing.

    matches: (M, 2) by pair, all that were found. pictures: (H, W) uint8, which the features were found in. match_more:
    matches further pairs. Which pairs are worth matching is guessed at first, so photos that stay without a camera are
    matched with all others before they are given up, unless there are many.
    """
    for near, far in _ROUNDS[:2]:
        solution = _adjusted(photos, matches, solution, pictures, near, far)
    share = followed(solution, pictures, _ROUNDS[1][1]).share
    least = max(RIGHT, _WEAK * float(np.median(list(share.values()))))
    solution = _without(solution, [photo for photo, value in share.items() if value < least])
    solution, apart = _held(solution)
    while len(solution.photo) < len(photos):
        more = _with_lost(photos, matches, solution, pictures)
        if len(more.photo) == len(solution.photo):
            pairs = _unmatched(matches, solution, len(photos))
            if match_more is None or not 0 < len(pairs) <= _MORE * len(matches):
                break
            matches = {**matches, **match_more(pairs)}
        solution = more
    solution, later = _held(_adjusted(photos, matches, solution, pictures, *_ROUNDS[2]))
    judged = followed(solution, pictures, _ROUNDS[1][1])
    return Placed(solution, judged.share, judged.agreement, apart + later)


def fitting(
    photos: Sequence[Features], matches: Matches, solution: Solution, tolerance: float
) -> dict[tuple[int, int], np.ndarray]:
    """Return the matches (M, 2) within `tolerance` pixels of the cameras' epipolar lines, by pair.

    Pairs of which few matches fit are left out whole.
    """
    cameras, bends = solution.cameras(), solution.distortion()
    asked = [pair for pair in matches if pair[0] in cameras and pair[1] in cameras and len(matches[pair])]

    def kept(pair: tuple[int, int]) -> np.ndarray | None:
        (i, j), rows = pair, matches[pair]
        if not same_side(cameras[i], cameras[j]):
            return None
        fits = epipolar_distance(photos, pair, rows, cameras, bends) < tolerance
        return rows[fits] if fits.sum() >= _FEWEST and fits.mean() >= _FITTING else None

    found = zip(asked, in_threads(kept, asked), strict=True)
    return {pair: rows for pair, rows in found if rows is not None}


def triangulated(photos: Sequence[Features], matches: Matches, solution: Solution) -> Solution:
    """Return a solution with the same cameras and the points of matches (M, 2) by pair."""
    pycolmap = pycolmap_library()
    model = _model(pycolmap, [each.points for each in photos], solution)
    graph = pycolmap.CorrespondenceGraph()
    for number in model.reg_image_ids():
        graph.add_image(number, len(photos[number - 1].points))
    for (i, j), rows in sorted(matches.items()):
        geometry = pycolmap.TwoViewGeometry()
        geometry.config, geometry.inlier_matches = pycolmap.TwoViewGeometryConfiguration.CALIBRATED, rows
        graph.add_two_view_geometry(i + 1, j + 1, geometry)
    graph.finalize()
    options = pycolmap.IncrementalTriangulatorOptions()
    options.ignore_two_view_tracks, options.random_seed = False, 0
    triangulator = pycolmap.IncrementalTriangulator(graph, model)
    for number in sorted(model.reg_image_ids()):
        triangulator.triangulate_image(options, number)
    triangulator.complete_all_tracks(options)
    triangulator.merge_all_tracks(options)
    return solution_of(model)


def _adjusted(
    photos: Sequence[Features],
    matches: Matches,
    solution: Solution,
    pictures: Sequence[np.ndarray],
    near: float,
    far: float,
) -> Solution:
    """Return the solution adjusted to the points that were followed.

    near: pixels that matches lie off epipolar lines. far: pixels that patches lie beside their places.
    """
    pycolmap = pycolmap_library()
    rough = triangulated(photos, fitting(photos, matches, solution, near), solution)
    tracks = followed(rough, pictures, far)
    count = np.bincount(tracks.point, minlength=len(rough.points))
    kept = np.sort(np.argsort(-count, kind="stable")[:_MOST])
    kept = kept[count[kept] >= _VIEWS]
    chosen = np.isin(tracks.point, kept)
    photo, point, place = tracks.photo[chosen], tracks.point[chosen], tracks.place[chosen]
    order = np.argsort(photo, kind="stable")
    photo, point, place = photo[order], point[order], place[order]
    row = np.arange(len(photo)) - np.searchsorted(photo, photo)
    model = _model(pycolmap, [place[photo == index] for index in range(len(photos))], rough)
    order = np.argsort(point, kind="stable")
    for index, seen in zip(kept, np.split(order, np.searchsorted(point[order], kept[1:])), strict=True):
        track = pycolmap.Track()
        for each in seen:
            track.add_element(int(photo[each]) + 1, int(row[each]))
        model.add_point3D(rough.points[index], track)
    for scale, error in _ADJUSTMENTS:
        options = pycolmap.BundleAdjustmentOptions()
        options.print_summary = False
        options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
        options.ceres.loss_function_scale = scale
        options.ceres.solver_options.max_num_iterations = _STEPS
        options.ceres.solver_options.num_threads = 1  # equal seeds give equal cameras, as in `mapping`
        _adjust(pycolmap, model, options)
        pycolmap.ObservationManager(model).filter_all_points3D(error, _ANGLE)
    return solution_of(model)


def _adjust(pycolmap: Any, model: Any, options: Any) -> None:
    """Adjust all cameras and points of COLMAP's model; its own function for that can't be silenced."""
    pycolmap.ObservationManager(model).filter_observations_with_negative_depth()
    config = pycolmap.BundleAdjustmentConfig()
    for image in model.reg_image_ids():
        config.add_image(image)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()
    model.update_point_3d_errors()


def _model(pycolmap: Any, places: Sequence[np.ndarray], solution: Solution) -> Any:
    """Return COLMAP's model of a solution's cameras, without points; the photo of index i is image i + 1.

    places: (N, 2) of each photo, where it may see a point.
    """
    model = pycolmap.Reconstruction()
    numbers: dict[tuple[float, ...], int] = {}
    for photo, pose, lens, size in zip(
        solution.photo, solution.pose, solution.lens, solution.size, strict=True
    ):
        key = (*lens, *size)
        if key not in numbers:
            numbers[key] = len(numbers) + 1
            camera = _camera(pycolmap, lens, size)
            camera.camera_id = numbers[key]
            model.add_camera_with_trivial_rig(camera)
        index, points = int(photo), places[int(photo)].astype(np.float64)
        image = pycolmap.Image(name=f"{index}", keypoints=points, camera_id=numbers[key], image_id=index + 1)
        model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(from_world(pose)))
    return model


def _camera(pycolmap: Any, lens: np.ndarray, size: np.ndarray) -> Any:
    camera = lens_camera(pycolmap, lens[0], (int(size[0]), int(size[1])))
    camera.params = lens
    return camera


def _without(solution: Solution, wrong: Sequence[int]) -> Solution:
    """Return a solution without some photos' cameras."""
    kept, seen = ~np.isin(solution.photo, wrong), ~np.isin(solution.seen_by, wrong)
    return replace(
        solution,
        **{name: getattr(solution, name)[kept] for name in ("photo", "pose", "lens", "size")},
        **{name: getattr(solution, name)[seen] for name in ("seen_by", "feature", "seen")},
    )


def _held(solution: Solution) -> tuple[Solution, tuple[tuple[int, ...], ...]]:
    """Return a solution without the photos that the others do not hold, and these, as `Placed.apart`."""
    rest = groups_by_points(solution)[1:]
    apart = tuple(group for group in rest if len(group) > 1)
    return _without(solution, [photo for group in rest for photo in group]), apart


def groups_by_points(solution: Solution) -> list[tuple[int, ...]]:
    """Return the groups of photos that hold each other, the largest first.

    The two groups that see most points in common become one, as long as these are enough for a camera's pose.
    """
    row = np.searchsorted(solution.photo, solution.seen_by)
    sees = np.zeros((len(solution.photo), len(solution.points)), np.float32)
    sees[row, solution.seen] = 1
    groups: list[tuple[int, ...]] = [(int(photo),) for photo in solution.photo]
    common = sees @ sees.T
    np.fill_diagonal(common, 0)
    while len(groups) > 1 and common.max() >= _INLIERS:
        first, second = divmod(int(common.argmax()), len(groups))  # first < second: of equals the first
        sees[first] = np.maximum(sees[first], sees[second])
        groups[first] += groups.pop(second)
        sees = np.delete(sees, second, 0)
        common = np.delete(np.delete(common, second, 0), second, 1)
        common[first] = common[:, first] = sees @ sees[first]
        common[first, first] = 0
    return sorted((tuple(sorted(group)) for group in groups), key=lambda group: (-len(group), group))


def _unmatched(matches: Matches, solution: Solution, count: int) -> list[Pair]:
    """Return the pairs of photos without and with a camera that were not matched; count: of all photos."""
    there = {int(photo) for photo in solution.photo}
    pairs = {(min(i, j), max(i, j)) for i in set(range(count)) - there for j in there}
    return sorted(pairs - set(matches))


def _with_lost(
    photos: Sequence[Features], matches: Matches, solution: Solution, pictures: Sequence[np.ndarray]
) -> Solution:
    """Return the solution with cameras of photos that had none, where they are found and right."""
    model = triangulated(photos, fitting(photos, matches, solution, _ROUNDS[2][0]), solution)
    point_of = {
        (int(photo), int(row)): int(point)
        for photo, row, point in zip(model.seen_by, model.feature, model.seen, strict=True)
    }
    for lost in sorted(set(range(len(photos))) - set(model.photo.tolist())):
        tried = [(_NEARLY, solution)]
        for pose, lens in _candidates(lost, photos, matches, model, point_of):
            candidate = _with_camera(solution, photos[lost], lost, pose, lens)
            tried.append((_shown(candidate, pictures, lost).share[lost], candidate))
        best = max(tried, key=lambda each: each[0])[1]
        if best is not solution:
            solution = _moved_to_points(best, pictures, lost) or solution
    return solution


def _shown(solution: Solution, pictures: Sequence[np.ndarray], photo: int) -> Tracks:
    """Return where one photo shows the points."""
    return followed(solution, pictures, _ROUNDS[0][1], only=photo)


def _moved_to_points(solution: Solution, pictures: Sequence[np.ndarray], photo: int) -> Solution | None:
    """Return a solution with a photo's camera moved to where it sees the points as the photo shows them.

    None where the photo shows too few even then.
    """
    pycolmap, row = pycolmap_library(), int(np.searchsorted(solution.photo, photo))
    camera = _camera(pycolmap, solution.lens[row], solution.size[row])
    options = pycolmap.AbsolutePoseEstimationOptions()
    options.ransac.max_error, options.ransac.random_seed = _ROUNDS[2][1], 0
    tracks = _shown(solution, pictures, photo)
    for _ in range(_MOVES):
        mine = tracks.photo == photo
        found = pycolmap.estimate_and_refine_absolute_pose(
            tracks.place[mine], solution.points[tracks.point[mine]], camera, options
        )
        if found is None:
            return None
        pose = solution.pose.copy()
        pose[row] = world_pose(found["cam_from_world"].matrix())
        solution = replace(solution, pose=pose)
        tracks = _shown(solution, pictures, photo)
    return solution if tracks.share[photo] > _MOVED else None


def _with_camera(
    solution: Solution, photo: Features, index: int, pose: np.ndarray, lens: np.ndarray
) -> Solution:
    """Return a solution with one more camera, pose (4, 4) and lens (4,)."""
    row = int(np.searchsorted(solution.photo, index))
    return replace(
        solution,
        photo=np.insert(solution.photo, row, index),
        pose=np.insert(solution.pose, row, pose, axis=0),
        lens=np.insert(solution.lens, row, lens, axis=0),
        size=np.insert(solution.size, row, [photo.width, photo.height], axis=0),
    )


def _candidates(
    lost: int,
    photos: Sequence[Features],
    matches: Matches,
    model: Solution,
    point_of: dict[tuple[int, int], int],
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return pose (4, 4) and lens (4,) of each camera that a lost photo's matches with one side agree about."""
    pycolmap = pycolmap_library()
    axis = {int(photo): pose[:3, 2] for photo, pose in zip(model.photo, model.pose, strict=True)}
    told: dict[int, list[tuple[int, int]]] = {}  # by photo: features of the lost one, and points
    for (i, j), rows in matches.items():
        if lost in (i, j) and (j if i == lost else i) in axis:
            mine, other = (0, j) if i == lost else (1, i)
            found = [(int(row[mine]), point_of.get((other, int(row[1 - mine])), -1)) for row in rows]
            told[other] = [pair for pair in found if pair[1] >= 0]
    size = np.array([photos[lost].width, photos[lost].height])
    same = (model.size == size).all(1)
    lens = np.median(model.lens[same if same.any() else slice(None)], axis=0)
    camera = _camera(pycolmap, lens, size)
    cameras: list[tuple[np.ndarray, np.ndarray]] = []
    options = pycolmap.AbsolutePoseEstimationOptions()
    options.ransac.max_error, options.ransac.random_seed = _OFF, 0
    for voter in sorted(told, key=lambda photo: -len(told[photo]))[:_VOTERS]:
        beside = [photo for photo in told if axis[photo] @ axis[voter] > np.cos(np.radians(_BESIDE))]
        pairs = sorted({pair for photo in beside for pair in told[photo]})
        if len(pairs) < _INLIERS:
            continue
        at = photos[lost].points[[feature for feature, _ in pairs]].astype(np.float64)
        points = model.points[[point for _, point in pairs]]
        pose = pycolmap.estimate_and_refine_absolute_pose(at, points, camera, options)
        if pose is None or pose["num_inliers"] < _INLIERS:
            continue
        cameras.append((world_pose(pose["cam_from_world"].matrix()), lens))
    return cameras
