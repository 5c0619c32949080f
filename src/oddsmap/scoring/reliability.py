# SPDX-License-Identifier: Apache-2.0
"""Reliability: of the events predicted with 70 %, did 70 % happen?

Source: Niculescu-Mizil and Caruana, Predicting good probabilities with supervised learning (ICML
2005), for the curve; Naeini, Cooper and Hauskrecht, Obtaining well calibrated probabilities using
Bayesian binning (AAAI 2015), for the expected calibration error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.short_repr import short_repr

__all__ = ["BINS", "Reliability"]


BINS = 15
"""Bins of equal width between 0 and 1, as in the calibration literature."""


@dataclass(frozen=True, slots=True, eq=False)
class Reliability:
    """Predicted probabilities in bins of equal width, and what came of them.

    Args:
        count: predictions in each bin, shape (bins,).
        predicted: sum of the probabilities in each bin, shape (bins,).
        happened: how many of the predicted events happened, shape (bins,).
    """

    count: npt.NDArray[np.int64]
    predicted: FloatArray
    happened: npt.NDArray[np.int64]

    __repr__ = short_repr

    @classmethod
    def of(cls, probability: FloatArray, happened: npt.NDArray[np.bool_]) -> Reliability:
        """Sort predictions into bins; a probability of 1 belongs to the last.

        Args:
            probability: of each event, in [0, 1], shape (n,).
            happened: whether it happened, shape (n,).
        """
        place = np.minimum((probability * BINS).astype(np.int64), BINS - 1)
        return cls(
            np.bincount(place, minlength=BINS),
            np.bincount(place, probability, minlength=BINS).astype(np.float64),
            np.bincount(place[happened], minlength=BINS),
        )

    @property
    def mean_predicted(self) -> FloatArray:
        """Mean probability in each bin; NaN where there is none."""
        with np.errstate(invalid="ignore"):
            return self.predicted / self.count

    @property
    def rate(self) -> FloatArray:
        """Share of the events that happened in each bin; NaN where there is none."""
        with np.errstate(invalid="ignore"):
            return self.happened / self.count

    @property
    def ece(self) -> float:
        """Expected calibration error: mean |predicted - rate| over bins, weighted by count."""
        total = self.count.sum()
        return float(np.abs(self.predicted - self.happened).sum() / total) if total else np.nan

    @property
    def ece_of_bins(self) -> float:
        """Mean |predicted - rate| over the bins that hold anything, each weighing the same.

        Where most predictions lie in one bin `ece` is nearly that bin's alone; this one is not.
        """
        used = self.count > 0
        gaps = np.abs(self.mean_predicted - self.rate)[used]
        return float(gaps.mean()) if used.any() else np.nan
