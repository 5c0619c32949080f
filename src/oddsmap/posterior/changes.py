# SPDX-License-Identifier: Apache-2.0
"""What has changed between two periods: cells whose state differs, with probability.

A cell has the state m1 in the first period and m2 in the second, each 1 (occupied) or 0, at rest
within a period. Before any reading, with p the prior of the cell and c the chance of a change,

    prior(m1, m2) = p(m1) (1 - c)  if m2 = m1,  else  p(m1) c.

The readings z1 of a period depend on its state alone, so the posterior of the pair is
proportional to prior(m1, m2) L1(m1) L2(m2). The evidence of a cell is its Bayes factor: the
increment x = l - l_prior of its log odds, x1 = log L1(1) / L1(0) and x2 likewise, in a calibrated
view as in one of log odds. Divided by
p(0) L1(0) L2(0), with l_prior = logit(p), the four pairs (m1, m2) weigh

    (0, 0): (1 - c)                        (1, 1): exp(l_prior + x1 + x2) (1 - c)
    (0, 1): exp(x2) c                      (1, 0): exp(l_prior + x1) c

and P(m1 != m2 | z1, z2) is the share of the lower two. Logarithms are added, so no weight
overflows: with overwhelming evidence in both periods the answer tends to 0 or 1, without a NaN.

Source: Bayes' rule on the pair; the increments are those of Thrun, Burgard, Fox: Probabilistic
Robotics (2005), table 9.1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence.lookup import units_at
from oddsmap.kernels.units import ONE
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.odds import sigmoid
from oddsmap.plot.thumbnail import Pictured, Thumbnail, of_quantity
from oddsmap.posterior.count_view import CountView
from oddsmap.short_repr import FEW_CELLS, described, grid_facts

if TYPE_CHECKING:
    from typing import Unpack

    from matplotlib.axes import Axes

    from oddsmap.plot.on_axes import PlotOptions

__all__ = ["Changes", "changed"]


@dataclass(frozen=True, slots=True, eq=False)
class Changes(Pictured):
    """Cells seen in both periods, and how probably each has changed.

    Args:
        index: the cells, shape (n, d), x first, in order of their index, x changing fastest.
        probability: P(the state differs), shape (n,).
        resolution: side of a cell [m].
    """

    index: IntArray
    probability: FloatArray
    resolution: float

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        d = self.index.shape[1]
        few = 0 < len(self.index) <= FEW_CELLS
        box = (self.index.min(axis=0), self.index.max(axis=0) + 1) if few else None
        yield from grid_facts(d, self.resolution, len(self.index), box)
        if few:
            yield f"{np.count_nonzero(self.probability >= 0.5):,} rather changed than not"

    def to_probability_map(self) -> ProbabilityMap:
        """Probabilities of a change with their place in the world; 0 where not observed.

        Raises:
            InputError: 3D cells, or none at all.
        """
        if self.index.shape[1] != 2:
            raise InputError("a picture needs 2D cells, these are 3D: use index")
        if len(self.index) == 0:
            raise InputError("no cell was seen in both periods, there is nothing to compare")
        lo, hi = self.index.min(axis=0), self.index.max(axis=0) + 1
        nx, ny = (int(n) for n in hi - lo)
        probability, observed = np.zeros((ny, nx)), np.zeros((ny, nx), np.bool_)
        x, y = (self.index - lo).T
        probability[y, x], observed[y, x] = self.probability, True
        origin = (float(lo[0]) * self.resolution, float(lo[1]) * self.resolution)
        return ProbabilityMap(probability, observed, self.resolution, origin)

    def _thumbnail(self) -> Thumbnail | None:
        if self.index.shape[1] != 2 or not len(self.index):
            return None
        grid = self.to_probability_map()
        value = np.where(grid.observed, grid.probability, np.nan)
        return of_quantity(value, "P(changed)", (0.0, 1.0))

    def plot(self, ax: Axes | None = None, **options: Unpack[PlotOptions]) -> Axes:
        """Draw changes into axes of Matplotlib: see `oddsmap.plot.on_axes.plot_quantity`.

        Args:
            ax: where; None: the current axes of pyplot.
            options: title, trajectory, crop, whole, colour_bar, cmap: see
                `oddsmap.plot.on_axes.PlotOptions`.
        """
        from oddsmap.plot.on_axes import plot_quantity

        grid = self.to_probability_map()
        return plot_quantity(grid, ax, label="P(changed)", limits=(0.0, 1.0), **options)


def changed(before: CountView, after: CountView, *, p_change: float = 0.1) -> Changes:
    """Compare two periods: the posterior probability that a cell's state differs.

    Only the evidence of the two counts, not a `clamp` of the views.

    Args:
        before: the first period's view, of log odds or calibrated. Calibrated views have each the
            prior that was fitted to its map: give both the same, `grid.calibrated(prior=0.1)`.
        after: the second period's, of a map of its own: one made with the first's as its prior
            already assumes that nothing changed.
        p_change: probability before any reading that a cell changes its state.

    Returns:
        The cells with evidence in both.

    Raises:
        ConfigError: p_change is not between 0 and 1.
        InputError: the maps differ in resolution or dimensions, or the views in their prior.
    """
    if not 0.0 < p_change < 1.0:
        raise ConfigError(f"p_change is a probability between 0 and 1, got {p_change}")
    if not (isinstance(before, CountView) and isinstance(after, CountView)):
        raise InputError(
            "changed compares two views of hits and passes, one per period: give grid.log_odds() "
            f"or grid.calibrated(), got {type(before).__name__} and {type(after).__name__}"
        )
    first, second = before.evidence, after.evidence
    for name in ("resolution", "ndim"):
        if getattr(first, name) != getattr(second, name):
            raise InputError(
                f"maps of different {name} cannot be compared cell by cell: "
                f"{getattr(first, name)} before, {getattr(second, name)} after"
            )
    index, hits, passes = first.cells()
    later_hits, later_passes = units_at(second, index)
    both = (later_hits > 0) | (later_passes > 0)
    index = index[both]
    prior = before.prior_at(index)
    if not np.array_equal(prior, after.prior_at(index)):
        raise InputError(
            "the two periods have different priors: give both views the same, a number or a map"
        )
    x1 = before.increment(hits[both] / ONE, passes[both] / ONE)
    x2 = after.increment(later_hits[both] / ONE, later_passes[both] / ONE)
    log_c, log_same = np.log(p_change), np.log1p(-p_change)
    differ = log_c + np.logaddexp(prior + x1, x2)
    same = log_same + np.logaddexp(0.0, prior + x1 + x2)
    return Changes(index, sigmoid(differ - same), first.resolution)
