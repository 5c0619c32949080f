# SPDX-License-Identifier: Apache-2.0
"""How `oddsmap score` shows what several ways to count predict: hits and passes, or occupancy."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from oddsmap.scoring.reflection import Predicted
    from oddsmap.scoring.reliability import Reliability

__all__ = ["curve_facts", "curve_lines", "facts_of_ways", "lines_of_ways"]


def facts_of_ways(ways: Mapping[str, Predicted]) -> dict[str, Any]:
    """For --json: scores by what predicts."""
    return {name: _facts(way) for name, way in ways.items()}


def lines_of_ways(
    ways: Mapping[str, Predicted], more: Mapping[str, Mapping[str, float]] | None = None
) -> Iterator[str]:
    """For people: a table.

    Args:
        ways: scores by what predicts.
        more: further columns, by their heads: a number for each way.
    """
    columns = more or {}
    heads = "".join(f"{head:>8}" for head in columns)
    yield (
        f"          way               log loss     ECE{heads}   p < .01: said, true"
        "   p > .99: said, true"
    )
    for name, way in ways.items():
        values = "".join(f"{column[name]:8.3f}" for column in columns.values())
        sure = f"{_sure(way.sure_free, 5):>22}{_sure(way.sure_hit, 3):>22}"
        yield f"          {name:16}  {way.log_loss:8.4f}  {way.ece:6.4f}{values}{sure}"


def curve_facts(curve: Reliability) -> list[dict[str, Any]]:
    """For --json: each bin's number of predictions, mean prediction, and share that happened."""
    return [
        {"count": float(n), "predicted": _number(p), "happened": _number(r)}
        for n, p, r in zip(curve.count, curve.mean_predicted, curve.rate, strict=True)
    ]


def curve_lines(curve: Reliability) -> Iterator[str]:
    """For people: the bins that hold anything."""
    yield "          predicted  happened  predictions"
    for n, p, r in zip(curve.count, curve.mean_predicted, curve.rate, strict=True):
        if n:
            yield f"          {p:9.3f}  {r:8.3f}  {n:11,.0f}"


def _facts(way: Predicted) -> dict[str, Any]:
    return {
        "log_loss": way.log_loss,
        "ece": way.ece,
        "reliability": curve_facts(way.reliability),
        **{
            key: {"predicted": _number(p), "happened": _number(share), "votes": votes}
            for key, (p, share, votes) in (
                ("below_0.01", way.sure_free), ("above_0.99", way.sure_hit)
            )
        },
    }  # fmt: skip


def _sure(sure: tuple[float, float, float], digits: int) -> str:
    return f"{sure[0]:.{digits}f}, {sure[1]:.{digits}f}" if sure[2] else "none"


def _number(value: float) -> float | None:
    return None if math.isnan(value) else float(value)
