# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap score --truth` says of occupancy."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oddsmap.cli.scored_tables import curve_lines, facts_of_ways, lines_of_ways

if TYPE_CHECKING:
    from oddsmap.cli.voice import Voice
    from oddsmap.posterior.belief import Belief
    from oddsmap.scoring.occupancy import OccupancyScores

__all__ = ["facts", "lines", "score"]


def score(belief: Belief, truth: Path, voice: Voice) -> OccupancyScores:
    """Scores of p(occupied) by a map that is taken for the truth.

    Raises:
        OddsmapError: it cannot be read, or does not go with the map.
    """
    from oddsmap.cli.export_sources import open_source
    from oddsmap.errors import InputError
    from oddsmap.scoring.occupancy import score_occupancy

    try:
        return score_occupancy(belief, open_source(truth, None, {}, voice))
    except InputError as error:
        said = str(error)
        raise InputError(said if said.startswith(str(truth)) else f"{truth}: {said}") from None


def facts(scores: OccupancyScores | None) -> dict[str, Any]:
    """For --json; None: there was no truth to score by."""
    if scores is None:
        return {"occupancy": None}
    ways = facts_of_ways(scores.of)
    for name, iou in scores.iou.items():
        ways[name]["iou"] = None if math.isnan(iou) else iou
    return {
        "occupancy": {
            "cells": scores.cells,
            "occupied": scores.occupied,
            "cells_without_truth": scores.without_truth,
            "told_by": ways,
        }
    }


def lines(scores: OccupancyScores | None, posterior: str) -> Iterator[str]:
    """For people; of the view that --posterior names, its reliability."""
    if scores is None:
        return
    yield (
        f"occupied  {scores.occupied:,} of {scores.cells:,} known cells by the truth, "
        f"{scores.without_truth:,} more have none; told by"
    )
    yield from lines_of_ways(scores.of, {"IoU": scores.iou})
    way = posterior.replace("-", " ")
    way = way if way in scores.of else next(iter(scores.of))
    yield f"          the same by {way}, in bins:"
    yield from curve_lines(scores.of[way].reliability)
