# SPDX-License-Identifier: Apache-2.0
"""Scores against ground truth, by hand and pair by pair."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oddsmap
from oddsmap.errors import InputError
from oddsmap.scoring.truth import Scores, evaluate


def naive_scores(p: list[float], truth: list[bool]) -> Scores:
    """Every pair of cells for the AUC, every bin for the ECE."""
    pairs = [
        1.0 if a > b else 0.5 if a == b else 0.0
        for a, t in zip(p, truth, strict=True) if t
        for b, s in zip(p, truth, strict=True) if not s
    ]  # fmt: skip
    n = len(p)
    given_truth = [
        min(max(a if t else 1 - a, 1e-9), 1 - 1e-9) for a, t in zip(p, truth, strict=True)
    ]
    ece = 0.0
    for k in range(15):
        inside = [(a, t) for a, t in zip(p, truth, strict=True) if min(int(a * 15), 14) == k]
        ece += abs(sum(a for a, _ in inside) - sum(t for _, t in inside)) / n
    both = sum(a > 0.5 and t for a, t in zip(p, truth, strict=True))
    either = sum(a > 0.5 or t for a, t in zip(p, truth, strict=True))
    return Scores(
        auc=sum(pairs) / len(pairs) if pairs else math.nan,
        log_loss=-sum(map(math.log, given_truth)) / n,
        brier=sum((a - t) ** 2 for a, t in zip(p, truth, strict=True)) / n,
        ece=ece,
        iou=both / either if either else math.nan,
        n=n,
    )


cells = st.lists(
    st.tuples(
        st.sampled_from([0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0]) | st.floats(0, 1), st.booleans()
    ),
    min_size=1,
    max_size=40,
)


@given(cells)
def test_scores_are_those_of_the_definitions(drawn: list[tuple[float, bool]]) -> None:
    p, truth = [a for a, _ in drawn], [t for _, t in drawn]
    got, expected = evaluate(p, truth), naive_scores(p, truth)
    for name in Scores.__dataclass_fields__:
        assert getattr(got, name) == pytest.approx(getattr(expected, name), nan_ok=True, abs=1e-9)


def test_a_perfect_map_and_its_opposite() -> None:
    truth = np.array([[True, False], [False, True]])
    best = evaluate(truth.astype(float), truth)
    assert (best.auc, best.brier, best.ece, best.iou, best.n) == (1.0, 0.0, 0.0, 1.0, 4)
    assert best.log_loss == pytest.approx(1e-9, rel=1e-6)  # nothing is surer than that
    worst = evaluate(1.0 - truth, truth)
    assert (worst.auc, worst.brier, worst.iou) == (0.0, 1.0, 0.0)
    assert worst.log_loss == pytest.approx(-math.log(1e-9))


def test_the_mask_chooses() -> None:
    p, truth = np.array([0.9, 0.2, 0.6]), np.array([1, 0, 0])
    assert evaluate(p, truth, [1, 1, 0]) == evaluate(p[:2], truth[:2])
    assert oddsmap.evaluate is evaluate


@pytest.mark.parametrize(
    ("p", "truth", "mask", "message"),
    [
        ([0.5], [True, False], None, r"of one shape, got \(1,\), \(2,\) and \(1,\)"),
        ([0.5, 0.5], [True, False], [False, False], "no cell to score"),
        ([0.5, 1.5], [True, False], None, "between 0 and 1"),
        ([0.5, math.nan], [True, False], None, "between 0 and 1"),
        ([0.5, 0.5], [0.3, 0.0], None, "truth holds True and False"),
    ],
)
def test_wrong_input(
    p: list[float], truth: list[float], mask: npt.ArrayLike | None, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        evaluate(p, truth, mask)


def test_what_is_not_scored_may_be_anything() -> None:
    assert evaluate([0.5, math.nan], [True, False], [True, False]).n == 1
