"""Whether a pose found in a photo can be relied on: what was measured, and what follows from it.

A photo without the object has a best pose, too. It shows in the things that poses are chosen by: how much of what
the photo shows there light can explain on the object, whether the photo's edges follow its outline, and how many
features that look like the object's agree. They may fit well and say little about how a smooth object of one material
is turned: the pose's uncertainty is measured, too. The limits come from right and wrong poses in photos with the object and from
photos without it (docs/decisions/locating.md).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

GOOD_SCORE = 2.2  # poses some pixels off score up to 2.10, elsewhere up to 1.84; of the right ones 7 % less
_NOTHING = 1.0  # below lie some photos without the object, and no right pose
RIVAL = 0.25  # a pose elsewhere that scores within this of the best explains the photo as well
_UNCERTAIN = 0.015  # right poses have up to .013, poses of a smooth object of one material from .018 on
_INSIDE = 0.5  # share of the object in the photo, below which its pose rests on little
_DOUBT = 0.3  # of ln radiance: as of a photo that is doubtful for other reasons (see photo-verdict.md there)


class PoseStatus(StrEnum):
    """What to do with a pose."""

    GOOD = "good"
    AMBIGUOUS = "ambiguous"
    DOUBTFUL = "doubtful"
    REFUSED = "refused"


@dataclass(frozen=True)
class PoseVerdict:
    """What was measured on a photo at the pose found in it, and what follows."""

    score: float  # of the pose, `refinement.Fit.score`
    explained: float  # share of what the photo shows on the object that light explains, at most 1
    edges: float  # 0 to 1, how well edges of the photo follow the outline
    agreed: float  # share of the features matched with the training photos' that agree, 0 to 1
    inside: float  # share of the object within the photo
    rivals: int  # other poses that score about as well
    pose_uncertainty: float  # root mean square motion of the object's points, in its size

    @property
    def status(self) -> PoseStatus:
        """The worst finding's status."""
        found = {status for status, _ in self._findings()}
        order = (PoseStatus.REFUSED, PoseStatus.DOUBTFUL, PoseStatus.AMBIGUOUS)
        return next((status for status in order if status in found), PoseStatus.GOOD)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The findings of that status, and what to do about each; none for a good pose."""
        return tuple(sentence for status, sentence in self._findings() if status is self.status)

    @property
    def doubt(self) -> float:
        """What the pose adds to the error to expect of ln radiance: 0 for a good one."""
        return 0.0 if self.status is PoseStatus.GOOD else _DOUBT

    def to_json(self) -> dict[str, Any]:
        """Return a JSON value: the measures, the status and the sentences."""
        measures = dict(vars(self))
        measures["leeway"] = measures.pop("pose_uncertainty")  # its stored name
        return {**measures, "status": self.status.value, "sentences": list(self.sentences)}

    def _findings(self) -> Iterator[tuple[PoseStatus, str]]:
        measured = f"light explains {100 * max(self.explained, 0):.0f} % of it there, "
        measured += f"{100 * self.edges:.0f} % of the object's outline lies on edges, and "
        measured += f"{100 * self.agreed:.0f} % of the features that look like its own agree"
        if self.score < _NOTHING:
            yield (
                PoseStatus.REFUSED,
                f"The object was not found in this photo (at the best place {measured}); give its camera, or take a "
                "photo that shows the object whole and sharp, from a side that the training photos show.",
            )
        elif self.score < GOOD_SCORE:
            yield (
                PoseStatus.DOUBTFUL,
                f"The object may not stand where it was found in this photo ({measured}); look at the overlay before "
                "using the map.",
            )
        if self.inside < _INSIDE:
            yield (
                PoseStatus.DOUBTFUL,
                f"Only {100 * self.inside:.0f} % of the object lie within this photo where it was found; look at the "
                "overlay before using the map.",
            )
        if self.rivals:
            others = "another pose explains" if self.rivals == 1 else f"{self.rivals} other poses explain"
            yield (
                PoseStatus.AMBIGUOUS,
                f"The object looks alike from several sides, and {others} this photo about as well: the map may be "
                "turned about the object; look at the overlay, or give the photo's camera.",
            )

        elif self.pose_uncertainty > _UNCERTAIN:
            yield (
                PoseStatus.AMBIGUOUS,
                "The photo hardly tells how the object is turned: its points could lie "
                f"{200 * self.pose_uncertainty:.0f} % of its size elsewhere and it would look about the same; the map may be "
                "turned as much. Look at the overlay, or give the photo's camera.",
            )


def rival_scores(scores: list[float]) -> int:
    """Return how many of the scores after the first, the best, are about as good."""
    return sum(score >= scores[0] - RIVAL for score in scores[1:])
