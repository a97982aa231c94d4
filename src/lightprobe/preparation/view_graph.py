"""Which matches of which pairs of photos belong to one object: rotations that most pairs agree on.

Painted and symmetric objects look alike from several sides, so that pairs of photos fit together at a wrong angle,
with a hundred matches and more (Cai et al. 2023 call them doppelgangers). Alone such a pair cannot be told from a right
one. Together they can: cameras that nearly look along one line at the same side of the object have to match, and where
photos that a hypothesis puts side by side do not, this speaks against it. Groups of photos are joined, the surest
first, by the relative rotation with the most matches for it less the matches that it lacks. Sure is what lacks little
for the matches that it has: between two sides that look alike, such as those of a toy with wheels, large groups have
many matches, and lack half as many again. A pair that was not among the likely ones, and so was never matched, may have
as many as the least of its photos' partners: of many photos that stand close together most pairs are of this kind.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from lightprobe.core.threads import in_threads
from lightprobe.preparation.features import PARTNERS, Features, pycolmap_library
from lightprobe.preparation.geometry import match_tolerance
from lightprobe.preparation.mapping import FEWEST_MATCHES, Matches, Pair, focal_length, lens_camera

_TRIALS = 2000  # of a pair's geometry
_AGREE = 12.0  # degrees between relative rotations that are the same: those of flat sides are no better
_FADE = 30.0  # degrees between viewing directions over which matches become fewer, as exp(-(angle / this)^2)
_EXPECTED = 0.35  # of the matches that a photo has with its best partners, below which a pair lacks some
_PARTNERS = 3  # best partners that tell how many matches a photo can have
_RIVALS = 6  # hypotheses for a pair of groups that are looked at
_LEAST = 20  # matches more for than against, from which groups are joined


@dataclass(frozen=True)
class Edge:
    """Two photos with matches that fit together."""

    pair: Pair
    rotation: np.ndarray  # (3, 3) from the first camera's axes to the second's, COLMAP's
    matches: np.ndarray  # (M, 2) uint32


@dataclass(frozen=True)
class ViewGraph:
    """Rotations of photos that agree, and the matches that fit them."""

    group: np.ndarray  # (K,) int, equal for photos whose rotations are in one frame
    rotation: np.ndarray  # (K, 3, 3) world to camera, within the group's frame
    matches: dict[Pair, np.ndarray]


def consistent(
    photos: Sequence[Features], matches: Matches, focal: Sequence[float | None], seed: int = 0
) -> ViewGraph:
    """Return the rotations that the pairs' matches (M, 2) agree on, and the matches of the pairs that agree.

    focal: focal length over the longer side of each photo, None where unknown.
    """
    edges = _edges(photos, matches, focal, seed)
    group, rotation = _joined(matches_of_pairs(len(photos), edges, matches), edges)

    def agrees(edge: Edge) -> bool:
        i, j = edge.pair
        return group[i] == group[j] and _angle(rotation[j].T @ edge.rotation @ rotation[i]) < _AGREE

    return ViewGraph(group, rotation, {edge.pair: edge.matches for edge in edges if agrees(edge)})


def _edges(
    photos: Sequence[Features], matches: Matches, focal: Sequence[float | None], seed: int
) -> list[Edge]:
    """Return the pairs with a relative rotation and the matches that fit it."""
    pycolmap = pycolmap_library()
    sizes = [(photo.width, photo.height) for photo in photos]
    told = zip(focal, sizes, strict=True)
    cameras = [lens_camera(pycolmap, focal_length(ratio, size), size) for ratio, size in told]
    points = [photo.points.astype(np.float64) for photo in photos]

    def edge(pair: Pair) -> Edge | None:
        i, j = pair
        options = pycolmap.TwoViewGeometryOptions()  # of its own: pairs are looked at side by side
        options.compute_relative_pose, options.ransac.random_seed = True, seed
        options.ransac.max_num_trials, options.ransac.max_error = _TRIALS, match_tolerance(*sizes[i])
        found = pycolmap.estimate_calibrated_two_view_geometry(
            cameras[i], points[i], cameras[j], points[j], matches[pair].astype(np.uint32), options
        )
        if found.cam2_from_cam1 is None or len(found.inlier_matches) < FEWEST_MATCHES:
            return None
        return Edge(pair, found.cam2_from_cam1.rotation.matrix(), np.asarray(found.inlier_matches, np.uint32))

    found = in_threads(edge, [pair for pair, rows in matches.items() if len(rows) >= FEWEST_MATCHES])
    return [each for each in found if each is not None]


@dataclass(frozen=True)
class _Hypothesis:
    """A rotation between the frames of two groups."""

    support: float  # matches for it
    balance: float  # these less the matches that it lacks
    rotation: np.ndarray  # (3, 3), first group's frame to the second's


def matches_of_pairs(count: int, edges: Sequence[Edge], asked: Collection[Pair]) -> np.ndarray:
    """Return how many matches that fit each pair of `count` photos has, (K, K), or may have where it was not asked."""
    strength, known = np.zeros((count, count)), np.eye(count, dtype=bool)
    for edge in edges:
        strength[edge.pair] = strength[edge.pair[::-1]] = len(edge.matches)
    for pair in asked:
        known[pair] = known[pair[::-1]] = True
    least = np.sort(strength, axis=1)[:, -min(PARTNERS, count)]
    return np.where(known, strength, np.minimum(least[:, None], least[None]))


def _joined(strength: np.ndarray, edges: Sequence[Edge]) -> tuple[np.ndarray, np.ndarray]:
    """Return the group (K,) and the rotation (K, 3, 3) of each photo. strength: as from `matches_of_pairs`."""
    count = len(strength)
    group, rotation = np.arange(count), np.tile(np.eye(3), (count, 1, 1))
    best = np.sort(strength, axis=1)[:, -min(_PARTNERS, count)]
    possible = np.minimum(best[:, None], best[None])
    known: dict[Pair, list[_Hypothesis]] = {}
    while True:
        between: dict[Pair, list[Edge]] = {}
        for edge in edges:
            a, b = sorted((group[edge.pair[0]], group[edge.pair[1]]))
            if a != b:
                between.setdefault((a, b), []).append(edge)
        for pair, joining in between.items():
            if pair not in known:
                known[pair] = _hypotheses(pair, joining, group, rotation, strength, possible)
        sure = [pair for pair in between if known[pair][0].balance >= _LEAST]
        likely = [pair for pair in between if _is_likely(known[pair])]
        if not sure and not likely:
            return group, rotation
        certainty = _sureness if sure else _margin
        kept, gone = max(sure or likely, key=lambda pair: certainty(known[pair]))
        moved = group == gone
        rotation[moved] = rotation[moved] @ known[kept, gone][0].rotation
        group[moved] = kept
        known = {pair: found for pair, found in known.items() if not {kept, gone} & set(pair)}


def _margin(found: Sequence[_Hypothesis]) -> float:
    """Return by how much the best hypothesis is better than the next, or than none where it is for itself."""
    rival = found[1].balance if len(found) > 1 else 0.0
    return found[0].balance - (max(0.0, rival) if found[0].balance > 0 else min(0.0, rival))


def _sureness(found: Sequence[_Hypothesis]) -> float:
    """Return the margin times the share of the best hypothesis' matches that those it lacks do not outweigh."""
    return _margin(found) * found[0].balance / found[0].support


def _is_likely(found: Sequence[_Hypothesis]) -> bool:
    """Tell whether groups whose photos lack matches are joined all the same: where nothing else comes near.

    Light and distance may have taken matches away, and photos that are left out are lost.
    """
    best = found[0]
    return best.support >= 2 * FEWEST_MATCHES and best.balance > -best.support and _margin(found) >= _LEAST


def _hypotheses(
    pair: Pair,
    edges: Sequence[Edge],
    group: np.ndarray,
    rotation: np.ndarray,
    strength: np.ndarray,
    possible: np.ndarray,
) -> list[_Hypothesis]:
    """Return what the edges between two groups say of their frames, best first; at least one."""
    turns, weights = [], np.array([len(edge.matches) for edge in edges], float)
    for edge in edges:
        i, j = edge.pair
        turn = rotation[j].T @ edge.rotation @ rotation[i]
        turns.append(turn if group[i] == pair[0] else turn.T)
    turn = np.array(turns)
    alike = _angle_of(np.einsum("aij,bij->ab", turn, turn)) < _AGREE
    first, second = (np.flatnonzero(group == each) for each in pair)
    found: list[_Hypothesis] = []
    done = np.zeros(len(edges), bool)
    for index in np.argsort(-(alike @ weights), kind="stable"):
        if done[index] or len(found) == _RIVALS:
            continue
        done |= alike[index]
        mean = _mean_rotation(turn[alike[index]], weights[alike[index]])
        apart = rotation[first][:, 2] @ (rotation[second][:, 2] @ mean).T  # of the optical axes
        angle = np.degrees(np.arccos(np.clip(apart, -1, 1)))
        rows = np.ix_(first, second)
        expected = _EXPECTED * possible[rows] * np.exp(-((angle / _FADE) ** 2))
        lacking = np.maximum(0, expected - strength[rows]).sum()
        support = float(weights[alike[index]].sum())
        found.append(_Hypothesis(support, support - float(lacking), mean))
    return sorted(found, key=lambda each: -each.balance)


def _mean_rotation(rotations: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the weighted chordal mean (3, 3) of rotations (N, 3, 3)."""
    left, _, right = np.linalg.svd((rotations * weights[:, None, None]).sum(0))
    return left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right


def _angle(rotation: np.ndarray) -> float:
    """Return the angle of a rotation (3, 3) in degrees."""
    return float(_angle_of(np.trace(rotation)))


def _angle_of(trace: np.ndarray) -> np.ndarray:
    """Return the angles in degrees of rotations with these traces (...)."""
    return np.degrees(np.arccos(np.clip((trace - 1) / 2, -1, 1)))
