# SPDX-License-Identifier: Apache-2.0
"""Do the walls of a log look like mirrors to its sensor?

A smooth wall answers a sonar along its normal alone. The forward model has one detection
probability for all directions and takes dropouts for independent, so that a fit to such a log puts
the misses elsewhere. Two statistics tell, each of which is nothing where the model is true:

- **Runs.** With the map known, whether one beam drops out says nothing about the next. So the
  correlation between P(dropout | reading) of neighbouring beams of a scan is about 0.
- **Incidence.** Where the axis of a beam meets a wall, the share of beams that hear it does not
  depend on the angle between the axis and the wall's normal (the gradient of the smoothed map).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.forward.beams import Beams

__all__ = ["Mirrors", "look_for_mirrors"]

# On the sonar benchmark both are far above in E6 and near nothing elsewhere: see the table in
# docs/method/full-map.md, which `benchmarks/mirrors.py` prints. Fewer dropouts than a twentieth are
# chance, or errors of the map.
_CORRELATED, _FEWEST_DROPOUTS = 0.15, 0.05
_FALL, _SURE = 0.08, 3.0
_FEWEST = 50
# Head on, and aslant: a cone of 25 degrees still meets a wall within 35 degrees of its normal where
# its axis is at 47.
_HEAD_ON, _ASLANT = 30.0, 50.0
# A wall is where p first exceeds this along the axis; it is heard up to three cells behind.
_WALL, _BEHIND = 0.8, 3.0
# Walls in the last fifth of the range may be out of reach for the noise alone.
_NEAR = 0.8
# Smoothing of the map [cells], and the slope below which it has no direction [1/cell].
_SMOOTH, _STEEP = 2.0, 0.03
_BORDER = 8
# More beams or cells than these tell no more, and take memory.
_MOST_BEAMS, _MOST_CELLS, _BATCH = 50_000, 1 << 24, 1024


@dataclass(frozen=True, slots=True, kw_only=True)
class Mirrors:
    """What was found.

    Args:
        correlation: between the dropouts of neighbouring beams; NaN where there are none.
        pairs: how many pairs of neighbours it is of.
        dropouts: share of the beams that dropped out.
        head_on: share of the walls met within 30 degrees of their normal that were heard.
        aslant: the same at 50 degrees and more.
        beams: how many beams these two are of.
    """

    correlation: float
    pairs: int
    dropouts: float
    head_on: float
    aslant: float
    beams: tuple[int, int]

    @property
    def in_runs(self) -> bool:
        """Whether dropouts come in runs of neighbouring beams, more than by chance."""
        enough = self.pairs >= _FEWEST and self.dropouts >= _FEWEST_DROPOUTS
        sure = self.correlation * math.sqrt(self.pairs) > _SURE
        return enough and self.correlation > _CORRELATED and sure

    @property
    def by_incidence(self) -> bool:
        """Whether walls are heard less often aslant than head on, more than by chance."""
        if min(self.beams) < _FEWEST:
            return False
        shares = (self.head_on, self.aslant)
        variance = sum(p * (1.0 - p) / n for p, n in zip(shares, self.beams, strict=True))
        fall = self.head_on - self.aslant
        return fall > _FALL and fall > _SURE * math.sqrt(variance)

    @property
    def warning(self) -> str:
        """What a person should know, or nothing."""
        seen = []
        if self.by_incidence:
            seen.append(
                f"walls are heard by {self.head_on:.0%} of the beams that meet them head on, by "
                f"{self.aslant:.0%} of those aslant"
            )
        if self.in_runs:
            seen.append(
                f"dropouts come in runs of neighbouring beams (correlation {self.correlation:.2f})"
            )
        if not seen:
            return ""
        return (
            f"the walls look like mirrors: {'; '.join(seen)}. The model has no such misses, and "
            "the fit puts them elsewhere: compare a map made with these parameters with one of "
            "detection = 0.3, p_dropout = 0.3, p_random = 0.1, which may be better"
        )


def look_for_mirrors(
    beams: Beams,
    dropout: FloatArray,
    index: IntArray,
    probability: FloatArray,
    *,
    resolution: float,
    range_max: float,
) -> Mirrors:
    """Look for dropouts in runs and, in 2D, for walls that are heard along their normals alone.

    Args:
        beams: scan after scan, neighbours after each other.
        dropout: P(dropout | reading) of each beam, under the map without it, shape (n,).
        index: cells of the map, shape (m, d), x first.
        probability: p(occupied) of each, shape (m,).
        resolution: side of a cell [m].
        range_max: readings end below it [m].
    """
    beside = (beams.origins[1:] == beams.origins[:-1]).all(axis=1)
    one, other = dropout[:-1][beside], dropout[1:][beside]
    correlation = math.nan
    if len(one) > 1 and one.std() > 0.0 and other.std() > 0.0:
        correlation = float(np.corrcoef(one, other)[0, 1])
    met: list[npt.NDArray[np.bool_]] = [np.empty(0, np.bool_)] * 2
    extent = np.ptp(index, axis=0) + 1 if len(index) else np.zeros(2)
    if beams.ndim == 2 and 0 < math.prod(extent.astype(float)) <= _MOST_CELLS:
        angle, heard = _walls_met(beams, index, probability, resolution, range_max)
        met = [heard[angle < _HEAD_ON], heard[angle >= _ASLANT]]
    head_on, aslant = (float(m.mean()) if len(m) else math.nan for m in met)
    return Mirrors(
        correlation=correlation,
        pairs=len(one),
        dropouts=float(dropout.mean()) if len(dropout) else 0.0,
        head_on=head_on,
        aslant=aslant,
        beams=(len(met[0]), len(met[1])),
    )


def _walls_met(
    beams: Beams, index: IntArray, probability: FloatArray, resolution: float, range_max: float
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Of beams whose axis meets a wall: the angle of incidence [deg], and whether it answers."""
    from scipy.ndimage import gaussian_filter

    # The border holds nothing: walls slope on both sides, and a beam that leaves meets no wall.
    low = index.min(axis=0) - _BORDER
    grid = np.zeros((index.max(axis=0) + 1 + _BORDER - low)[::-1])
    x, y = (index - low).T
    grid[y, x] = probability
    rise_y, rise_x = np.gradient(gaussian_filter(grid, _SMOOTH))
    last = np.array(grid.shape)[::-1] - 1
    along = np.arange(0.5, _NEAR * range_max / resolution, 0.5)
    angles, heard = [np.empty(0)], [np.empty(0, np.bool_)]
    chosen = np.arange(0, len(beams), max(1, len(beams) // _MOST_BEAMS))
    for start in range(0, len(chosen), _BATCH):
        some = chosen[start : start + _BATCH]
        ways = beams.directions[some]
        places = beams.origins[some, None] / resolution + ways[:, None] * along[:, None]
        x, y = np.clip(np.floor(places).astype(np.int64) - low, 0, last).transpose(2, 0, 1)
        wall = grid[y, x] > _WALL
        first = wall.argmax(axis=1)
        row = np.arange(len(some))
        slope = np.stack([rise_x[y[row, first], x[row, first]],
                          rise_y[y[row, first], x[row, first]]], axis=1)  # fmt: skip
        steep = np.linalg.norm(slope, axis=1)
        met = wall.any(axis=1) & (steep >= _STEEP)
        cosine = np.abs((slope[met] * ways[met]).sum(axis=1)) / steep[met]
        angles.append(np.degrees(np.arccos(np.clip(cosine, 0.0, 1.0))))
        limit = (along[first[met]] + _BEHIND) * resolution
        heard.append(beams.ranges[some][met] < np.minimum(limit, range_max))
    return np.concatenate(angles), np.concatenate(heard)
