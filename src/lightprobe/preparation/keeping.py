"""A choice among reconstructions as arrays and back, so that it is made once."""

import json
from collections.abc import Callable
from dataclasses import asdict, fields

import numpy as np

from lightprobe.preparation.cache import Cache
from lightprobe.preparation.candidates import Candidate, Choice
from lightprobe.preparation.judging import Verdict
from lightprobe.preparation.mapping import Lenses
from lightprobe.preparation.solution import Solution


def kept_choice(cache: Cache, name: str, key: str, make: Callable[[], Choice]) -> Choice:
    """Return the choice kept as step `name` under `key`, or the one that `make` makes."""
    return _from_arrays(cache.arrays(name, key, lambda: _to_arrays(make())))


def _to_arrays(choice: Choice) -> dict[str, np.ndarray]:
    """Return a choice as arrays of any shape; of those that were not kept only what is said of them."""
    words = {
        "why": choice.why,
        "trap": choice.trap,
        "moving": choice.moving,
        "kept": _words(choice.kept),
        "tried": [_words(candidate) for candidate in choice.tried],
    }
    solution = {field.name: getattr(choice.kept.solution, field.name) for field in fields(Solution)}
    return {**solution, "words": np.array(json.dumps(words))}


def _words(candidate: Candidate) -> dict[str, object]:
    return {
        "name": candidate.name,
        "verdict": asdict(candidate.verdict),
        "lenses": candidate.lenses.name,
        "apart": candidate.apart,
    }


def _from_arrays(arrays: dict[str, np.ndarray]) -> Choice:
    """Return the choice of `_to_arrays`, arrays of any shape; those that were not kept come without their
    cameras.
    """
    words = json.loads(str(arrays["words"]))
    solution = Solution(**{field.name: arrays[field.name] for field in fields(Solution)})

    def candidate(stored: dict) -> Candidate:
        verdict, apart = Verdict(**stored["verdict"]), tuple(tuple(photos) for photos in stored["apart"])
        return Candidate(stored["name"], solution, verdict, Lenses[stored["lenses"]], apart)

    tried = tuple(candidate(stored) for stored in words["tried"])
    return Choice(candidate(words["kept"]), tried, words["why"], words["trap"], words["moving"])
