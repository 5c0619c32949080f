# SPDX-License-Identifier: Apache-2.0
"""Scores of a map whose truth is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.scoring.reliability import Reliability
from oddsmap.short_repr import short_repr

__all__ = ["Scores", "evaluate"]


_MIN_PROBABILITY = 1e-9


@dataclass(frozen=True, slots=True)
class Scores:
    """How well probabilities of occupancy fit the truth.

    Args:
        auc: area under the ROC curve: the chance that an occupied cell has a higher probability
            than a free one, ties counting half; NaN where all cells are alike.
        log_loss: mean -log of the probability given to the truth [nats], probabilities clipped to
            [1e-9, 1 - 1e-9].
        brier: mean squared difference of probability and truth.
        ece: expected calibration error over 15 bins of equal width.
        iou: intersection over union of the occupied cells, those with a probability above 1/2;
            NaN where there is none in either.
        n: how many cells were scored.
    """

    auc: float
    log_loss: float
    brier: float
    ece: float
    iou: float
    n: int

    __repr__ = short_repr


def evaluate(
    probability: npt.ArrayLike, truth: npt.ArrayLike, mask: npt.ArrayLike | None = None
) -> Scores:
    """Score probabilities of occupancy against ground truth.

    Args:
        probability: p(occupied) of each cell, any shape; the prior where nothing is known.
        truth: True where a cell is occupied, of the same shape.
        mask: True for the cells to score, of the same shape; default: all.

    Returns:
        The scores.

    Raises:
        InputError: shapes differ, no cell is to be scored, or a value is no probability or no
            truth value.
    """
    p, t = np.asarray(probability, np.float64), np.asarray(truth)
    scored = np.ones(p.shape, np.bool_) if mask is None else np.asarray(mask)
    if not p.shape == t.shape == scored.shape:
        raise InputError(
            "evaluate needs probability, truth and mask of one shape, got "
            f"{p.shape}, {t.shape} and {scored.shape}"
        )
    for name, value in (("truth", t), ("mask", scored)):
        if value.dtype != np.bool_ and not np.isin(value, (0, 1)).all():
            raise InputError(f"evaluate: {name} holds True and False, got {value.dtype} values")
    chosen = scored.astype(np.bool_)
    p, occupied = p[chosen], t[chosen].astype(np.bool_)
    if len(p) == 0:
        raise InputError("evaluate: there is no cell to score")
    if not ((p >= 0.0) & (p <= 1.0)).all():
        raise InputError("evaluate: probabilities lie between 0 and 1 in every cell scored")
    of_truth = np.where(occupied, p, 1.0 - p)
    called = p > 0.5
    union = int(np.count_nonzero(called | occupied))
    return Scores(
        auc=_auc(p, occupied),
        log_loss=float(-np.log(np.clip(of_truth, _MIN_PROBABILITY, 1.0 - _MIN_PROBABILITY)).mean()),
        brier=float(((p - occupied) ** 2).mean()),
        ece=Reliability.of(p, occupied).ece,
        iou=int(np.count_nonzero(called & occupied)) / union if union else np.nan,
        n=len(p),
    )


def _auc(p: FloatArray, occupied: npt.NDArray[np.bool_]) -> float:
    # By the ranks of the occupied cells (Mann and Whitney, 1947); equal values share theirs.
    positive = int(np.count_nonzero(occupied))
    negative = len(p) - positive
    if positive == 0 or negative == 0:
        return np.nan
    _, place, count = np.unique(p, return_inverse=True, return_counts=True)
    rank = np.cumsum(count) - (count - 1) / 2
    above = float(rank[place[occupied]].sum()) - positive * (positive + 1) / 2
    return above / (positive * negative)
