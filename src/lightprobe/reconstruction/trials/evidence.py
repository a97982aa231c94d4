"""How photos judge a change of a part of the object: a material that becomes metal, a lid that is opened."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from lightprobe.reconstruction.trials.trial import Sample, Trial

FEWEST_PHOTOS = 8  # that judge a change


@dataclass(frozen=True)
class Bar:
    """How large the mean of gains over photos must be, to be more than chance and worth a change."""

    sure: float = 2.0  # standard errors of the mean
    least: float = 0.0

    def cleared_by(self, gains: Tensor) -> bool:
        """Return whether the mean of the gains (K,) of K photos is over the bar; never for K = 0."""
        return float(gains.mean()) > max(self.least, self.sure * standard_error(gains))


BAR = Bar()


def standard_error(values: Tensor) -> float:
    """Return the standard error of the mean of values (K,); 0 where a single one has no spread."""
    return float(values.std()) / len(values) ** 0.5 if len(values) > 1 else 0.0


@dataclass(frozen=True)
class Evidence:
    """How well a fitted trial explains J photos, and a part of the object in them."""

    trial: Trial
    own: Tensor  # (J,) displayed error of the part's pixels, nan where there are too few

    @staticmethod
    def of(trial: Trial, part: Callable[[Sample], Tensor], fewest: int) -> "Evidence":
        """Return the evidence on a part; part(sample): the rows (K,) int64 of the sample's pixels on the
        part.

        fewest: pixels of the part that count in a photo.
        """
        errors = []
        for sample in trial.samples:
            rows = part(sample)
            errors.append(trial.part_error(sample, rows) if len(rows) >= fewest else float("nan"))
        return Evidence(trial, torch.tensor(errors, dtype=torch.float64))

    def own_gain(self, before: "Evidence") -> Tensor:
        """Return the logarithm of how many times better than `before` the part is explained, (K,) photos."""
        return _gain(before.own, self.own)

    def explains_part(self, before: "Evidence", bar: Bar = BAR) -> bool:
        """Return whether the part's own pixels are explained better than `before`, over a bar."""
        gain = self.own_gain(before)
        return len(gain) >= FEWEST_PHOTOS and bar.cleared_by(gain)

    def speaks_for_change(self, before: "Evidence", bar: Bar = BAR) -> bool:
        """Return whether `explains_part` says so, and halves of the object disagree no more than `before`."""
        if not self.explains_part(before, bar):
            return False
        whole = _gain(before.trial.disagreement, self.trial.disagreement)
        return len(whole) >= FEWEST_PHOTOS and float(whole.mean()) > -standard_error(whole)


def _gain(before: Tensor, after: Tensor) -> Tensor:
    """Return the logarithm of the ratio of errors where both are known, (K,)."""
    known = (before > 0) & (after > 0)
    return (before[known] / after[known]).log()
