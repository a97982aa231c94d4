"""Several reconstructions of the same photos, and the one that is kept: with a still background the first one
lies.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.preparation.features import Features, match_photos
from lightprobe.preparation.judging import (
    ObjectMatches,
    Verdict,
    central,
    from_one_tripod,
    moving_features,
    unexplained,
)
from lightprobe.preparation.mapping import FEWEST_MATCHES, Lenses, Matches, reconstruct
from lightprobe.preparation.solution import Solution

WHOLE, MOVING, SECOND, MASKED = "whole photos", "what moves", "what moves against the rest", "within masks"
_NEARLY_ALL = 0.9  # of the photos registered: other lenses are not tried then
_EXPLAINED = (
    0.8  # share of the object's matches from which a reconstruction is believed to be that of the object
)
_SECOND_PAIRS = (
    0.5  # pairs per photo that fit together in another way than the cameras say, from which it is looked at
)
_BETTER = 1.1  # times the score that another reconstruction needs to take the place of an earlier one
_MANY_LENSES = (
    0.1  # focal lengths per photo: so many are those of photos from anywhere, whose EXIF means little
)


@dataclass(frozen=True)
class Candidate:
    """One reconstruction and how it does on the object."""

    name: str
    solution: Solution
    verdict: Verdict
    lenses: Lenses
    apart: tuple[
        tuple[int, ...], ...
    ] = ()  # photos of each model that does not join this one, the largest first

    def to_json(self) -> dict[str, object]:
        """Return it as prepare.json has it."""
        return {
            "reconstruction": self.name,
            **self.verdict.to_json(),
            "lenses": str(self.lenses),
            "other_models_photos": [len(photos) for photos in self.apart],
        }


@dataclass(frozen=True)
class Choice:
    """The reconstruction that is kept."""

    kept: Candidate
    tried: tuple[Candidate, ...]
    why: str
    trap: str | None  # a sentence where the whole photos would have misled
    moving: bool  # what was reconstructed moves before a background: all of it is the object


def choose(
    photos: Sequence[Features],
    matches: Matches,
    focal: Sequence[float | None],
    inside: Sequence[np.ndarray] | None,
    *,
    seed: int = 0,
    on_model: Callable[[str], None] = lambda name: None,
) -> Choice:
    """Return the best reconstruction of matches (M, 2) without masks.

    inside: the features that are known, or thought, to lie on the object, (N,) bool for each photo; None:
    those around the middle. Raises `InputError` when nothing can be reconstructed.
    """
    regions = central(photos) if inside is None else inside
    if from_one_tripod(photos, matches):
        moving = match_photos(photos, moving_features(photos, matches))
        on_model(MOVING)
        kept = best_lenses(MOVING, photos, moving, focal, ObjectMatches(photos, moving, regions, seed), seed)
        if kept is not None:
            trap = (
                "Trap: the background stands still in the photos while the object was turned before it; features that "
                "stay at their place were left out, as they would have held the cameras still."
            )
            why = "only this explains what moves: the rest stands at the same place in every photo"
            return Choice(kept, (kept,), why, trap, True)
    on_model(WHOLE)
    asked = ObjectMatches(photos, matches, regions, seed)
    whole = best_lenses(WHOLE, photos, matches, focal, asked, seed)
    if whole is None:
        raise InputError(
            "No cameras were found: too few features of the photos match; take more photos of it that overlap, sharp "
            "and with less than 20 degrees between neighbours."
        )
    return _against_second(photos, matches, focal, regions, whole, seed, on_model)


def _against_second(
    photos: Sequence[Features],
    matches: Matches,
    focal: Sequence[float | None],
    regions: Sequence[np.ndarray],
    whole: Candidate,
    seed: int,
    on_model: Callable[[str], None],
) -> Choice:
    """Return the whole photos' reconstruction, or that of what does not fit it where this is the object."""
    good = f"it explains {whole.verdict.explained:.0%} of the matches on the object"
    plain = Choice(whole, (whole,), good, None, False)
    if whole.verdict.explained >= _EXPLAINED:
        return plain
    left = unexplained(photos, matches, whole.solution)
    everywhere = [np.ones(len(features.points), bool) for features in photos]
    asked = ObjectMatches(photos, left, everywhere, seed)
    if len(asked.pairs) < _SECOND_PAIRS * len(photos):
        return plain
    on_model(SECOND)
    second = best_lenses(SECOND, photos, left, focal, asked, seed)
    if second is None:
        return plain
    total, own = len(photos), ObjectMatches(photos, matches, regions, seed)
    whole, second = (replace(found, verdict=own.judge(found.solution)) for found in (whole, second))
    if second.verdict.score(total) < _BETTER * whole.verdict.score(total):
        return Choice(whole, (whole, second), good, None, False)
    trap = (
        f"Trap: the whole photos gave cameras for {whole.verdict.registered} of {total} photos that explain only "
        f"{whole.verdict.explained:.0%} of the matches on the object: the background stands still while the object was "
        "turned or moved."
    )
    why = f"it explains {second.verdict.explained:.0%} of the matches on the object"
    return Choice(second, (whole, second), why, trap, True)


def within_masks(
    photos: Sequence[Features],
    focal: Sequence[float | None],
    inside: Sequence[np.ndarray],
    choice: Choice,
    *,
    seed: int = 0,
) -> Choice:
    """Return the choice after a reconstruction from the features `inside` the masks alone, (N,) bool for each
    photo.

    It is made where the one that is kept explains too little of the object, and kept where it is better.
    """
    own = match_photos(photos, inside)
    asked = ObjectMatches(photos, own, inside, seed)
    before = replace(choice.kept, verdict=asked.judge(choice.kept.solution))
    enough = before.verdict.explained >= _EXPLAINED and before.verdict.registered >= _NEARLY_ALL * len(photos)
    if enough:
        return replace(choice, kept=before)
    found = best_lenses(MASKED, photos, own, focal, asked, seed)
    total = len(photos)
    if found is None or found.verdict.score(total) < before.verdict.score(total):
        return replace(choice, kept=before)
    why = (
        f"it explains {found.verdict.explained:.0%} of the object's matches, of {found.verdict.registered} photos; "
        f"{before.name} {before.verdict.explained:.0%}, of {before.verdict.registered}"
    )
    trap = choice.trap
    if trap is None and before.verdict.explained < _EXPLAINED:
        trap = (
            f"Trap: {before.name} gave cameras for {before.verdict.registered} of {total} photos that explain only "
            f"{before.verdict.explained:.0%} of the matches on the object: the background does not move with it."
        )
    return Choice(found, (*choice.tried, found), why, trap, choice.moving)


def best_lenses(
    name: str,
    photos: Sequence[Features],
    matches: Matches,
    focal: Sequence[float | None],
    asked: ObjectMatches,
    seed: int,
) -> Candidate | None:
    """Return the reconstruction of matches (M, 2) with the lenses that register most photos, None when none
    does.

    Of several models that do not join, the one that does best on the object. Between lenses, matches and
    photos being the same, what registers more is better: a wrong lens loses photos.
    """
    best: Candidate | None = None
    for lenses in _trials(photos, focal):
        models = reconstruct(photos, matches, focal, lenses, seed)
        if not models:
            continue
        verdicts = [asked.judge(model) for model in models]
        kept = max(range(len(models)), key=lambda k: verdicts[k].score(len(photos)))
        apart = tuple(tuple(model.photo.tolist()) for k, model in enumerate(models) if k != kept)
        found = Candidate(name, models[kept], verdicts[kept], lenses, apart)
        if best is None or len(found.solution.photo) > len(best.solution.photo):
            best = found
        if len(found.solution.photo) >= _NEARLY_ALL * _matched(matches, len(photos)):
            break
    return best


def _trials(photos: Sequence[Features], focal: Sequence[float | None]) -> list[Lenses]:
    """Return which lenses to try, in order."""
    told = {
        (f.width, f.height, None if r is None else round(r, 3)) for f, r in zip(photos, focal, strict=True)
    }
    sizes = {(f.width, f.height) for f in photos}
    anywhere = len(told) > max(3, _MANY_LENSES * len(photos))
    order = [Lenses.BY_SIZE] if anywhere or not any(focal) else [Lenses.AS_TOLD, Lenses.BY_SIZE]
    return order + ([Lenses.EACH_ITS_OWN] if len(sizes) < len(photos) and anywhere else [])


def _matched(matches: Matches, count: int) -> int:
    """Return how many photos have matches (M, 2) enough to be registered."""
    linked = {photo for pair, rows in matches.items() if len(rows) >= FEWEST_MATCHES for photo in pair}
    return min(len(linked), count)
