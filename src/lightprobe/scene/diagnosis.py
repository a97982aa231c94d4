"""Which single cause makes masks and cameras disagree: each is undone in turn, and the hull carved anew.

A cause may lie in all photos or in some while the others are right. Which ones is found by turns: a hull that
most masks agree on tells which photos fit better without the cause, and their change makes a better hull.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from lightprobe.scene.causes import Cause, Kind, Scope, inverted, pose_causes, taken_from
from lightprobe.scene.consistency import View, agreements, rim, trial_hull
from lightprobe.scene.hull import Hull
from lightprobe.scene.intrinsic_causes import intrinsic_causes
from lightprobe.scene.normalise import nearest_point

_PHOTOS = 24  # that causes are tried on
# Pixels along the longer side of the masks that tell how well a cause mends them, and which causes are worth that
_SIDE, _SMALL = 80, 40
# Shares of the masks that must agree, in turn, while wrong ones are among them: a lenient hull is found by a bare
# majority, a strict one shows small differences.
_SHARES = (0.6, 0.7, 0.8), (0.9, 0.9, 0.9)
_FIRST = (0.8, 0.6)  # likewise, while causes are chosen
_TRIED = 6  # causes that get a closer look, for all photos and for a part
_ENDS = 7  # places in the order of photos from which on a cause is sought
_NEARLY_ALL = 0.9  # share of the photos with a cause from which all have it
_SAME = 0.01  # difference in IoU that tells nothing
_BETTER = 0.03  # gain in IoU of a photo that has the cause
_LEAST_GAIN, _MENDED = 0.04, 0.35  # in IoU, and of what was missing, that a cause must bring to be told
_RIVAL, _APART = (
    0.25,
    0.03,
)  # share of that gain, and IoU that is enough, by which the next cause must bring less
_CONVINCING, _SURE = 0.6, 0.85  # IoU that a cause must lead to; the latter where the photos tell little
_AROUND, _AIMED = 0.5, 2  # rim of an inverted mask; half the pixels around the point that all cameras look at
_NUMBERS = (Kind.INTRINSICS, Kind.UNITS)  # kinds whose causes differ by a number
_MOST_OUTLIERS = 12  # photos whose cameras are compared with each other's


@dataclass(frozen=True)
class Diagnosis:
    """A cause, the photos that have it, and what the hull gains where it is undone."""

    cause: Cause
    photos: tuple[int, ...]  # indices of views
    before: float  # mean IoU of the photos as they are
    after: float  # and without the cause
    unclear: tuple[int, ...] = ()  # other photos, which fit as well with the cause as without it


@dataclass(frozen=True)
class _Trial:
    cause: Cause
    chosen: np.ndarray  # (views that are tried,) bool, those with the cause
    hull: Hull | None
    mean: float  # IoU of the views that are tried


def diagnose(views: Sequence[View], *, is_little: bool = False) -> Diagnosis | None:
    """Return the cause without which masks and cameras agree clearly better than with any other, or None.

    views: all photos in the order of their files. is_little: whether the photos are so few, or so alike, that a
    hull fits them in many ways.
    """
    large, views = views, [view.within(_SIDE) for view in views]
    sample = _sample(views)
    as_they_are = [views[i] for i in sample]
    usual = trial_hull(as_they_are)
    before = float(agreements(as_they_are, usual).mean())
    trials = [_tried(cause, views, sample, chosen) for cause, chosen in _candidates(views, sample)]
    best = max(trials, key=lambda trial: trial.mean)
    alike = [t for t in trials if not _is_another(t.cause, best.cause) and t.mean >= best.mean - _SAME]
    if (
        best.cause.kind is not Kind.INTRINSICS
    ):  # of all photos sooner than of some, but of few sooner than of most
        best = min(alike, key=lambda trial: 0 if trial.chosen.all() else trial.chosen.sum())
    rival = max((t.mean for t in trials if _is_another(t.cause, best.cause)), default=0.0)
    gain = best.mean - before
    if best.hull is None or gain <= _SAME or best.mean - max(rival, before) < min(_RIVAL * gain, _APART):
        return None
    unchanged = usual if best.chosen.all() else best.hull
    return _named(best, views, large, unchanged, _SURE if is_little else _CONVINCING)


def _is_another(cause: Cause, best: Cause) -> bool:
    """Tell whether two causes are told apart by more than a number."""
    return cause is not best and not (cause.kind is best.kind and best.kind in _NUMBERS)


def _sample(views: Sequence[View], most: int = _PHOTOS) -> list[int]:
    """Return indices of at most `most` views: in no order that mistakes may have, but always the same ones."""
    shuffled = np.random.default_rng(0).permutation(len(views))
    return sorted(shuffled[:most].tolist())


def _tried(cause: Cause, views: Sequence[View], sample: Sequence[int], chosen: np.ndarray) -> _Trial:
    """Return what comes of a cause undone in the `chosen` of the sampled views, (len(sample),) bool."""
    mixed = _mixed(cause.change(views), views, sample, chosen)
    hull = trial_hull(mixed)
    return _Trial(cause, chosen, hull, float(agreements(mixed, hull).mean()))


def _mixed(
    changed: Sequence[View], views: Sequence[View], sample: Sequence[int], chosen: np.ndarray
) -> list[View]:
    return [changed[i] if is_chosen else views[i] for i, is_chosen in zip(sample, chosen, strict=True)]


def _candidates(views: Sequence[View], sample: Sequence[int]) -> list[tuple[Cause, np.ndarray]]:
    """Return the most promising causes with the sampled views that have them, (len(sample),) bool.

    Small pictures and coarse hulls tell which these are.
    """
    found, small = [*pose_causes(views), *intrinsic_causes(views)], [view.within(_SMALL) for view in views]
    every = np.ones(len(sample), bool)
    trials = [_tried(cause, small, sample, every) for cause in found if cause.scope is not Scope.SOME]
    trials.sort(key=lambda trial: -trial.mean)
    candidates = [(trial.cause, every) for trial in trials[:_TRIED]]
    partial = [cause for cause in found if cause.scope is not Scope.ALL]
    parts = [_best_part(cause, small, sample) for cause in _promising(partial, small, sample)]
    for chosen in _sides(
        max(parts, key=lambda part: part.mean).chosen
    ):  # may be right although the cause is not
        parts += [_tried(cause, small, sample, chosen) for cause in partial]
    parts.sort(key=lambda part: -part.mean)
    return candidates + [(part.cause, part.chosen) for part in parts[:_TRIED] if part.chosen.any()]


def _sides(chosen: np.ndarray) -> list[np.ndarray]:
    """Return a part of the views, (N,) bool, and the other part, where neither is empty."""
    return [] if chosen.all() or not chosen.any() else [chosen, ~chosen]


def _promising(partial: Sequence[Cause], views: Sequence[View], sample: Sequence[int]) -> list[Cause]:
    """Return the causes that some of the sampled views fit best without, by a lenient and by a strict hull."""
    chosen: dict[int, Cause] = {}
    for share in _FIRST:
        hull = trial_hull([views[i] for i in sample], share)
        gains = [np.maximum(_gains(cause.change(views), views, sample, hull), 0).sum() for cause in partial]
        chosen |= {int(index): partial[index] for index in np.argsort(gains)[::-1][:_TRIED]}
    return list(chosen.values())


def _best_part(cause: Cause, views: Sequence[View], sample: Sequence[int]) -> _Trial:
    """Return the part of the sampled views, maybe none, that agree best with the cause undone in it.

    Where as many are wrong as right, a hull of the wrong ones may be found first: the other part is tried, too.
    """
    changed, none = cause.change(views), np.zeros(len(sample), bool)
    tagged = np.array([views[i].orientation != 1 for i in sample])

    def best_of(chosen: Iterable[np.ndarray]) -> _Trial:
        parts = {part.tobytes(): part for found in (none, *chosen) for part in (found, ~found)}
        trials = [_tried(cause, views, sample, part) for part in parts.values() if not part.all()]
        return max(trials, key=lambda trial: trial.mean)

    starts = [none, tagged]
    if cause.kind is Kind.ORDER:  # a photo more or fewer shifts all that follow
        ends = np.linspace(0, len(views), _ENDS + 2)[1:-1]
        starts.append(best_of([np.array(sample) >= end for end in ends]).chosen)
    settled = [_settled(changed, views, sample, start, shares) for start in starts for shares in _SHARES]
    return best_of([*settled, starts[-1]])


def _settled(
    changed: Sequence[View],
    views: Sequence[View],
    sample: Sequence[int],
    start: np.ndarray,
    shares: Sequence[float],
) -> np.ndarray:
    """Return which of the sampled views fit better changed, (len(sample),) bool, in turns with the hull."""
    chosen = start
    for share in shares:
        mixed = _mixed(changed, views, sample, chosen)
        chosen = _gains(changed, views, sample, trial_hull(mixed, share)) > _SAME
    return chosen


def _gains(
    changed: Sequence[View], views: Sequence[View], sample: Iterable[int], hull: Hull | None
) -> np.ndarray:
    """Return how much better the sampled views fit the hull changed than as they are, (len(sample),) float64."""
    pairs = [(changed[i], views[i]) for i in sample]
    return agreements([new for new, _ in pairs], hull) - agreements([old for _, old in pairs], hull)


def _named(
    best: _Trial, views: Sequence[View], large: Sequence[View], usual: Hull | None, convincing: float
) -> Diagnosis | None:
    """Return the diagnosis of the photos that fit better without the cause, or None if that brings little.

    usual: the hull that photos with the cause are compared with as they are.
    """
    every = np.arange(len(views))
    gains = np.ones(len(views)) if best.chosen.all() else _gains_of_all(best, views, large)
    has = gains > _SAME
    if (
        best.cause.kind is Kind.TURNED and has.any()
    ):  # by one orientation all are turned, even where it shows less
        tags = {views[i].orientation for i in every[has]} - {1}
        has |= np.array([view.orientation in tags for view in views]) & (gains > -_SAME)
    if has.mean() >= _NEARLY_ALL and best.cause.scope is not Scope.SOME:
        has[:] = True
    if not has.any():
        return None
    changed = best.cause.change(views)
    before = float(agreements([views[i] for i in every[has]], usual).mean())
    after = float(agreements([changed[i] for i in every[has]], best.hull).mean())
    if after < max(convincing, before + max(_LEAST_GAIN, _MENDED * (1 - before))):
        return None
    unclear = every[~has & (np.abs(gains) <= _SAME)].tolist()
    return Diagnosis(best.cause, tuple(every[has].tolist()), before, after, tuple(unclear))


def _gains_of_all(best: _Trial, views: Sequence[View], large: Sequence[View]) -> np.ndarray:
    """Return how much better all photos fit without the cause, (len(views),) float64.

    Their `large` masks show small differences to a hull of the photos that are clear.
    """
    every = range(len(views))
    has = _gains(best.cause.change(views), views, every, best.hull) > _BETTER
    changed = best.cause.change(large)
    mixed = _mixed(changed, large, every, has)
    return _gains(changed, large, every, trial_hull([mixed[i] for i in _sample(mixed, 2 * _PHOTOS)]))


def diagnose_inverted(views: Sequence[View]) -> Diagnosis | None:
    """Return which masks are inverted, or None.

    The space around an object is as consistent as the object, so it is told by the photos' borders: an inverted
    mask fills them and leaves out what the cameras look at. The hull must then agree with the others.
    """
    suspects = np.array(_look_inverted(views))
    if not suspects.any():
        return None
    cause = inverted()
    changed = cause.change(views)
    mixed = _mixed(changed, views, range(len(views)), suspects)
    hull = trial_hull([mixed[i] for i in _sample(mixed)])
    fits = agreements(mixed, hull)
    convincing = suspects & (fits >= _CONVINCING)
    if not convincing.any():
        return None
    before, after = agreements(views, hull)[suspects].mean(), fits[suspects].mean()
    return Diagnosis(cause, tuple(np.flatnonzero(convincing).tolist()), float(before), float(after))


def _look_inverted(views: Sequence[View]) -> list[bool]:
    """Tell of each view whether its mask fills most of the border and leaves out what all cameras look at."""
    positions = np.stack([view.camera.position for view in views])
    axes = np.stack([-view.camera.camera_to_world[:3, 2] for view in views])
    target = nearest_point(positions, axes)
    return [rim(view.mask) > _AROUND and _leaves_out(view, target) for view in views]


def _leaves_out(view: View, target: np.ndarray | None) -> bool:
    """Tell whether the mask is black around the point `target` (3,), or wherever the photo shows it not."""
    height, width = view.mask.shape
    x, y = width / 2, height / 2
    if target is not None:
        u, v, depth = view.camera.project(target[None])[0]
        x, y = (u, v) if depth > 0 and 0 <= u < width and 0 <= v < height else (x, y)
    rows, columns = (slice(max(0, int(c) - _AIMED), int(c) + _AIMED + 1) for c in (y, x))
    return bool(view.mask[rows, columns].mean() < 0.5)


def diagnose_outliers(views: Sequence[View], outliers: Sequence[int]) -> list[Diagnosis]:
    """Return what the photos `outliers` have that fit the others badly, as far as one cause mends each clearly."""
    others = sorted(set(range(len(views))) - set(outliers))
    chosen = [views[others[i]] for i in _sample([views[k] for k in others])]
    hull = trial_hull(chosen)
    if hull is None:
        return []
    usual = float(np.median(agreements(chosen, hull)))
    found = [cause for cause in pose_causes(views) if cause.scope is not Scope.ALL]
    found += [inverted(), *(taken_from(views, k) for k in outliers[:_MOST_OUTLIERS])]
    trials = [(cause, cause.change(views)) for cause in found]
    by_cause: dict[int, list[tuple[int, float, float]]] = {}
    for index in outliers:
        before = views[index].agreement(hull)
        best, after = _clearly_best(trials, index, hull, before)
        if best is not None and after >= usual - 2 * _LEAST_GAIN:
            by_cause.setdefault(best, []).append((index, before, after))
    return [_together(trials[best][0], photos) for best, photos in by_cause.items()]


def _clearly_best(
    trials: Sequence[tuple[Cause, Sequence[View]]], index: int, hull: Hull, before: float
) -> tuple[int | None, float]:
    """Return which of the causes, with the changed views, mends one photo, and its IoU then; None if none does.

    A mirrored photo is rarer than a turned one, which looks alike where the object is symmetrical.
    """
    scores = np.array([changed[index].agreement(hull) for _, changed in trials])
    rare = np.array([cause.kind is Kind.MIRRORED for cause, _ in trials])
    best = int(np.argmax(scores - _APART * rare))
    rivals = np.delete(scores - _APART * rare, best)
    gain = float(scores[best]) - before
    is_clear = gain >= 2 * _LEAST_GAIN and scores[best] - rivals.max(initial=before) >= min(
        _RIVAL * gain, _APART
    )
    return (best if is_clear else None), float(scores[best])


def _together(cause: Cause, photos: Sequence[tuple[int, float, float]]) -> Diagnosis:
    """Return one diagnosis of photos, each an index with its IoU before and after."""
    indices, before, after = zip(*photos, strict=True)
    return Diagnosis(cause, indices, float(np.mean(before)), float(np.mean(after)))
