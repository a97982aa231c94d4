"""Whether a pose found in a photo can be relied on: what was measured, and what follows from it.

A photo without the object has a best pose, too. It shows in the two things that poses are chosen by: how much of
what the photo shows there light can explain on the object, and whether the photo's edges follow its outline.
Both may fit well and say little about how a smooth object of one material is turned: the pose's uncertainty is
measured, too. The limits come from right and wrong poses in photos with the object and from photos without it
(docs/decisions/locating.md).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

GOOD_SCORE = 1.95  # poses some pixels off score up to 1.93, elsewhere up to 1.48; of the right ones 5 % less
_NOTHING = 1.0  # below lie some photos without the object, and no right pose
RIVAL = 0.25  # a pose elsewhere that scores within this of the best explains the photo as well
_UNCERTAIN = 0.015  # right poses have up to .013, those of a smooth object of one material from .018 on
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
    inside: float  # share of the object within the photo
    inliers: int  # matched features that agree about the pose
    rivals: int  # other poses that score about as well
    pose_uncertainty: float  # root mean square motion of the object's points, in the object's size
