"""Several reconstructions of the same photos, and the one that is kept."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, fields, replace

import numpy as np

from lightprobe.core.errors import InputError
from lightprobe.preparation import judging, view_graph
from lightprobe.preparation.adjustment import placed
from lightprobe.preparation.cache import Cache
from lightprobe.preparation.features import Features, match_photos
from lightprobe.preparation.mapping import FEWEST_MATCHES, Lenses, Matches, Pair, Solution, reconstruct

WHOLE, MOVING, SECOND = "whole photos", "what moves", "what moves against the rest"
_NEARLY_ALL = 0.9  # of the photos registered: other lenses are not tried then
EXPLAINED = 0.8  # share of the object's matches from which a reconstruction is taken for the object's
_SECOND_PAIRS = 0.5  # pairs per photo that fit in another way than the cameras say, that are worth a look
_BETTER = 1.1  # times the score that another reconstruction needs to take the place of an earlier one
_MANY_LENSES = 0.1  # focal lengths per photo: so many are of photos from anywhere, whose EXIF means little


@dataclass(frozen=True)
class Reconstruction:
    """A solution from some of the matches, and how it does on the object."""

    name: str
    solution: Solution
    fit: judging.ObjectFit
    lenses: Lenses
    share: dict[int, float] = field(default_factory=dict)  # as in `Tracks`; empty before cameras are placed
    agreement: dict[int, float] = field(default_factory=dict)  # likewise
    apart: tuple[tuple[int, ...], ...] = ()  # photos of each model that does not join, the largest first

    def to_json(self) -> dict[str, object]:
        """Return the reconstruction as prepare.json has it."""
        others = {"lenses": str(self.lenses), "other_models_photos": [len(photos) for photos in self.apart]}
        return {"reconstruction": self.name, **self.fit.to_json(), **others}


@dataclass(frozen=True)
class Choice:
    """The reconstruction that is kept, of several."""

    kept: Reconstruction
    tried: tuple[Reconstruction, ...]
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
) -> tuple[Choice, Matches]:
    """Return the best reconstruction of matches (M, 2) by pair, and the matches that it is made of.

    inside: the features known, or thought, to lie on the object, (N,) bool for each photo; None: those around
    the middle. Raises `InputError` when nothing can be reconstructed.
    """
    regions = judging.central(photos) if inside is None else inside
    if judging.from_one_tripod(photos, matches):
        moving = match_photos(photos, judging.moving_features(photos, matches))
        on_model(MOVING)
        asked = judging.ObjectMatches(photos, moving, regions, seed)
        kept = best_lenses(MOVING, photos, moving, focal, asked, seed)
        if kept is not None:
            trap = (
                "Trap: the background stands still in the photos while the object was turned before it; features that "
                "stay at their place were left out, as they would have held the cameras still."
            )
            why = "only this explains what moves: the rest stands at the same place in every photo"
            return Choice(kept, (kept,), why, trap, True), moving
    on_model(WHOLE)
    asked = judging.ObjectMatches(photos, matches, regions, seed)
    whole = best_lenses(WHOLE, photos, matches, focal, asked, seed)
    if whole is None:
        raise InputError(
            "No cameras were found: too few features of the photos match; take more photos of it that overlap, sharp "
            "and with less than 20 degrees between neighbours."
        )
    good = f"it explains {whole.fit.explained:.0%} of the matches on the object"
    plain, total = Choice(whole, (whole,), good, None, False), len(photos)
    if whole.fit.explained >= EXPLAINED:
        return plain, matches
    left = judging.unexplained(photos, matches, whole.solution)
    everywhere = [np.ones(len(features.points), bool) for features in photos]
    rest = judging.ObjectMatches(photos, left, everywhere, seed)
    if len(rest.pairs) < _SECOND_PAIRS * total:
        return plain, matches
    on_model(SECOND)
    second = best_lenses(SECOND, photos, left, focal, rest, seed)
    if second is None:
        return plain, matches
    second = replace(second, fit=asked.judge(second.solution))
    if second.fit.score(total) < _BETTER * whole.fit.score(total):
        return replace(plain, tried=(whole, second)), matches
    trap = (
        f"Trap: the whole photos gave cameras for {whole.fit.registered} of {total} photos that explain only "
        f"{whole.fit.explained:.0%} of the matches on the object: the background stands still while the object was "
        "turned or moved."
    )
    why = f"it explains {second.fit.explained:.0%} of the matches on the object"
    return Choice(second, (whole, second), why, trap, True), left


def with_exact_cameras(
    choice: Choice,
    photos: Sequence[Features],
    matches: Matches,
    pictures: Sequence[np.ndarray],
    match_more: Callable[[list[Pair]], Matches],
) -> Choice:
    """Return a choice whose cameras are placed exactly, as `adjustment.placed` does; arguments as there.

    Where the object moved against its background, `matches` are a part of all, and no more are made.
    """
    exact = placed(photos, matches, choice.kept.solution, pictures, None if choice.moving else match_more)
    kept = replace(
        choice.kept,
        solution=exact.solution,
        share=exact.share,
        agreement=exact.agreement,
        apart=exact.apart + choice.kept.apart,
    )
    return replace(choice, kept=kept)


def best_lenses(
    name: str,
    photos: Sequence[Features],
    matches: Matches,
    focal: Sequence[float | None],
    asked: judging.ObjectMatches,
    seed: int,
) -> Reconstruction | None:
    """Return the reconstruction of matches (M, 2) with the lenses that register most photos, or None.

    Only pairs that agree on rotations have a vote (`view_graph`). Of several models that do not join, it has
    the one that does best on the object. Between lenses, matches and photos being the same, the one that
    registers more is better: a wrong lens loses photos.
    """
    best: Reconstruction | None = None
    agreed = view_graph.consistent(photos, matches, focal, seed).matches
    for lenses in _trials(photos, focal):
        models = reconstruct(photos, agreed, focal, lenses, seed)
        if not models:
            continue
        fits = [asked.judge(model) for model in models]
        kept = max(range(len(models)), key=lambda k: fits[k].score(len(photos)))
        apart = tuple(tuple(model.photo.tolist()) for k, model in enumerate(models) if k != kept)
        found = Reconstruction(name, models[kept], fits[kept], lenses, apart=apart)
        if best is None or len(found.solution.photo) > len(best.solution.photo):
            best = found
        if len(found.solution.photo) >= _NEARLY_ALL * _matched(agreed, len(photos)):
            break
    return best


def _trials(photos: Sequence[Features], focal: Sequence[float | None]) -> list[Lenses]:
    """Return which lenses to try, in order."""
    pairs = zip(photos, focal, strict=True)
    told = {(f.width, f.height, None if ratio is None else round(ratio, 3)) for f, ratio in pairs}
    sizes = {(f.width, f.height) for f in photos}
    anywhere = len(told) > max(3, _MANY_LENSES * len(photos))
    order = [Lenses.BY_SIZE] if anywhere or not any(focal) else [Lenses.AS_TOLD, Lenses.BY_SIZE]
    return order + ([Lenses.EACH_ITS_OWN] if len(sizes) < len(photos) and anywhere else [])


def _matched(matches: Matches, count: int) -> int:
    """Return how many photos have matches (M, 2) enough to be registered."""
    linked = {photo for pair, rows in matches.items() if len(rows) >= FEWEST_MATCHES for photo in pair}
    return min(len(linked), count)


def kept_choice(cache: Cache, name: str, key: str, make: Callable[[], Choice]) -> Choice:
    """Return the choice kept as step `name` under `key`, or the one that `make` makes."""
    return _from_arrays(cache.arrays(name, key, lambda: _to_arrays(make())))


def _to_arrays(choice: Choice) -> dict[str, np.ndarray]:
    """Return a choice as arrays; of reconstructions that are not kept only what is said of them."""
    words = {key: getattr(choice, key) for key in ("why", "trap", "moving")}
    words |= {"kept": _words(choice.kept), "tried": [_words(tried) for tried in choice.tried]}
    solution = {field.name: getattr(choice.kept.solution, field.name) for field in fields(Solution)}
    return {**solution, "words": np.array(json.dumps(words))}


def _words(found: Reconstruction) -> dict[str, object]:
    fit, lenses = asdict(found.fit), found.lenses.name
    judged = [[photo, share, found.agreement[photo]] for photo, share in found.share.items()]
    return {"name": found.name, "verdict": fit, "lenses": lenses, "apart": found.apart, "judged": judged}


def _from_arrays(arrays: dict[str, np.ndarray]) -> Choice:
    """Return the choice of `_to_arrays`; the reconstructions that were not kept come without cameras."""
    words = json.loads(str(arrays["words"]))
    solution = Solution(**{field.name: arrays[field.name] for field in fields(Solution)})

    def reconstruction(stored: dict) -> Reconstruction:
        fit, apart = (
            judging.ObjectFit(**stored["verdict"]),
            tuple(tuple(photos) for photos in stored["apart"]),
        )
        share, agreement = ({int(row[0]): float(row[k]) for row in stored["judged"]} for k in (1, 2))
        lenses = Lenses[stored["lenses"]]
        return Reconstruction(stored["name"], solution, fit, lenses, share, agreement, apart)

    tried = tuple(reconstruction(stored) for stored in words["tried"])
    return Choice(reconstruction(words["kept"]), tried, words["why"], words["trap"], words["moving"])
