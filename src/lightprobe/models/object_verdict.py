"""How far a reconstructed object can be trusted, found from its own photos without any truth.

Every photo can be explained by some light, and the wrong materials bend it: a light that is solved from the
darker half of the surface then fails to explain the brighter half, and the other way round. That failure
(`disagreement`, see `reconstruction.trials.disagreement`) is the number that the verdict rests on, measured on photos
the object was not fitted to. Where none was held out it is of photos it was fitted to, and the object is
doubtful at best. What relighting turned out to be on objects with known materials tells what to expect of it
(docs/decisions/object-verdict.md).

It hardly sees how bright the whole object is, as light and base colour share a factor. Of that the photos'
lights tell a little: where more of it comes from behind the object than from the camera's side, photo after
photo, the object is taken for too bright, and where less, for too dark (`reconstruction.trials.plausibility`). Photos
that are not cut out tell more: their lights are about as bright as their backgrounds. `lightprobe calibrate` settles
the factor from one known patch or lamp.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from lightprobe.core.files import write_json
from lightprobe.core.stored import damaged, read_object

_REMEDY = "make it anew with: lightprobe train SCENE -o RUN --restart"

# Relighting under known novel lights, in dB after one factor per channel, of objects with known materials:
# _AT_TENTH dB where the disagreement is .1, and _PER_DECADE dB more for each tenth of that.
_AT_TENTH, _PER_DECADE = 17.0, 20.0
_GOOD, _POOR = 0.055, 0.072  # disagreements up to which an object is good, and from which it is poor
_UNLIKELY = 3.0  # -ln probability of the photos' lights from which the object is doubtful
_OF_LIGHTS = ("front_bias", "surprise", "excess", "excess_surprise")
_FITTED = "photos that it was fitted to, as none was held out"
_MORE_PHOTOS = ", or train it on at least eight photos, some of them held out (--decompose.validation-photos)"
_DOUBT = 0.3  # what a poor object adds to the error to expect of ln radiance


class Trust(StrEnum):
    """How far an object can be trusted."""

    GOOD = "good"
    DOUBTFUL = "doubtful"
    POOR = "poor"


@dataclass(frozen=True)
class ObjectVerdict:
    """What was measured on photos of an object, under the names of verdict.json, and what follows from it."""

    disagreement: float  # displayed, 0 to 1: by how much each half of the surface fails to explain the other
    photos: int  # that it is the mean over
    front_bias: float = 0.0  # view-light correlation: how much more light comes from the camera's side
    surprise: float = 0.0  # how improbable that is, in -ln probability
    excess: float = 0.0  # by how much lights are brighter than backgrounds, in ln radiance
    excess_surprise: float = 0.0  # how improbable that is, in -ln probability
    held_out: bool = True  # whether the object was not fitted to these photos; else it is doubtful at best

    @property
    def trust(self) -> Trust:
        """How far the object can be trusted."""
        if self.disagreement >= _POOR:
            return Trust.POOR
        is_good = self.disagreement <= _GOOD and not self._brightness_is_wrong and self.held_out
        return Trust.GOOD if is_good else Trust.DOUBTFUL

    @property
    def _brightness_is_wrong(self) -> bool:
        return self.surprise + self.excess_surprise > _UNLIKELY

    @property
    def expected_psnr(self) -> float:
        """What relighting under a known light is likely to score, in dB after one factor per channel."""
        return _AT_TENTH - _PER_DECADE * math.log10(max(self.disagreement, 1e-3) / 0.1)

    @property
    def sentence(self) -> str:
        """What to think of the object, and what to do about a poor one."""
        photos, at_best = ("held-out photos", "") if self.held_out else (_FITTED, " at best")
        found = (
            f"the light read from its dark and from its bright parts differs by {100 * self.disagreement:.1f} % "
            f"({self.photos} {photos}); expect about {self.expected_psnr:.0f} dB{at_best} when it is relit"
        )
        advice = {
            Trust.GOOD: "",
            Trust.DOUBTFUL: "; look at its materials before you rely on it"
            + ("" if self.held_out else _MORE_PHOTOS),
            Trust.POOR: "; its materials are probably wrong: try more steps (--preset standard), more photos under "
            "other lights, or another --seed",
        }[self.trust]
        return f"The object is {self.trust.value}: {found}{advice}.{self._brightness}"

    @property
    def _brightness(self) -> str:
        """A sentence on the object's brightness where it is probably wrong, else nothing."""
        if not self._brightness_is_wrong:
            return ""
        if self.excess_surprise > self.surprise:
            than, wrong = ("dimmer", "bright") if self.excess < 0 else ("brighter", "dark")
            told = f"are {than} than what its photos show around it"
        else:
            side, wrong = (
                ("from behind", "bright") if self.front_bias < 0 else ("from the camera's side", "dark")
            )
            told = f"come {side} more often than chance allows"
        return (
            f" Its lights {told}, so it is probably taken for too {wrong}; lightprobe calibrate mends that."
        )

    @property
    def doubt(self) -> float:
        """What a poor object adds to the error to expect of ln radiance of every map predicted with it."""
        return _DOUBT if self.trust is Trust.POOR else 0.0

    def to_json(self) -> dict[str, Any]:
        """Return a JSON value: the measures, the trust and the sentence."""
        return {
            **vars(self),
            "trust": self.trust.value,
            "expected_psnr": self.expected_psnr,
            "sentence": self.sentence,
        }

    def save(self, path: Path) -> None:
        """Write the verdict as JSON, atomically."""
        write_json(path, self.to_json())

    @staticmethod
    def load(path: Path) -> "ObjectVerdict | None":
        """Return the verdict in a file, None where there is no file; raise `InputError` for a damaged file."""
        if not path.exists():
            return None
        value = read_object(path, _REMEDY)
        error, photos = value.get("disagreement"), value.get("photos")
        if not isinstance(error, (int, float)) or not 0 <= error <= 1:
            raise damaged(path, "'disagreement' is not from 0 to 1", _REMEDY)
        if not isinstance(photos, int) or photos < 1:
            raise damaged(path, "'photos' is no count", _REMEDY)
        lights = {name: value.get(name, 0.0) for name in _OF_LIGHTS}  # which older runs lack
        if not all(isinstance(x, (int, float)) and math.isfinite(x) for x in lights.values()):
            raise damaged(path, f"one of {', '.join(_OF_LIGHTS)} is no number", _REMEDY)
        if lights["surprise"] < 0 or lights["excess_surprise"] < 0:
            raise damaged(path, "a surprise is below 0", _REMEDY)
        held_out = value.get("held_out", True)
        if not isinstance(held_out, bool):
            raise damaged(path, "'held_out' is neither true nor false", _REMEDY)
        found = {name: float(x) for name, x in lights.items()}
        return ObjectVerdict(float(error), photos, **found, held_out=held_out)
