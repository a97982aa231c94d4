"""Whether photos ask for a change of the object: what speaks for it is explained better, and by more than
chance.

A change concerns a part of the object: a material that becomes metal, a lid that is opened. Its own pixels
must be explained surely better. That alone could be a light that bends to them; so each half of the object
must also be explained no worse by the other half's light (`reconstruction.agreement`).
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.light.photometry import displayed_error
from lightprobe.reconstruction.material_trials import Sample, Trial, standard_error
from lightprobe.render.split_sum import shade_under

FEWEST_PHOTOS = 8  # that judge a change


@dataclass(frozen=True)
class Bar:
    """How much better the part's own pixels must be explained."""

    sure: float = 2.0  # standard errors of the mean gain over the photos
    least: float = 0.0  # mean logarithm of how many times better


BAR = Bar()


@dataclass(frozen=True)
class Evidence:
    """How well J photos are explained."""

    own: Tensor  # (J,) displayed error of the part's pixels, nan where there are too few
    disagreement: Callable[[], Tensor]  # () -> (J,) of halves, which takes longer to find

    @staticmethod
    def of(
        trial: Trial,
        part: Callable[[Sample], Tensor],
        fewest: int,
        disagreement: Callable[[], Tensor] | None = None,
    ) -> "Evidence":
        """Return it for a fitted trial; part(sample) are the rows (K,) int64 of its pixels that belong to the
        part.

        fewest: pixels that count in a photo. disagreement: where it is shared, as it does not depend on the
        part.
        """
        return Evidence(_part_errors(trial, part, fewest), disagreement or disagreement_of(trial))

    def own_gain(self, before: "Evidence") -> Tensor:
        """Return the logarithms of how many times better the part is explained than `before`, (K,) photos."""
        return _gain(before.own, self.own)

    def explains_part(self, before: "Evidence", bar: Bar = BAR) -> bool:
        """Return whether the part's own pixels are explained better than `before`, over a bar."""
        own = self.own_gain(before)
        return len(own) >= FEWEST_PHOTOS and float(own.mean()) > max(
            bar.least, bar.sure * standard_error(own)
        )

    def speaks_for_change(self, before: "Evidence", bar: Bar = BAR) -> bool:
        """Return whether `explains_part` says so, and halves of the object explain each other no worse."""
        if not self.explains_part(before, bar):
            return False
        whole = _gain(before.disagreement(), self.disagreement())
        return len(whole) >= FEWEST_PHOTOS and float(whole.mean()) > -standard_error(whole)


def disagreement_of(trial: Trial) -> Callable[[], Tensor]:
    """Return what finds the disagreement of halves under a fitted trial, (J,) float64, once it is asked for."""
    return functools.cache(lambda: trial.errors(len(trial.samples)).sum(1))


@torch.no_grad()
def _part_errors(trial: Trial, part: Callable[[Sample], Tensor], fewest: int) -> Tensor:
    """Return the displayed error of the part's pixels in each photo, (J,) float64, nan where it is hardly
    seen.
    """
    errors = []
    for sample in trial.samples:
        rows = part(sample)
        if len(rows) < fewest:
            errors.append(float("nan"))
            continue
        pixels = sample.of_material(trial.material(sample.pixels.position)).select(rows)
        image = shade_under(pixels, trial.lights[sample.name])
        errors.append(float(displayed_error(image, sample.color[rows], sample.clipped[rows])))
    return torch.tensor(errors, dtype=torch.float64)


def _gain(before: Tensor, after: Tensor) -> Tensor:
    """Return the logarithm of the ratio of errors where both are known, (K,)."""
    known = (before > 0) & (after > 0)
    return (before[known] / after[known]).log()
