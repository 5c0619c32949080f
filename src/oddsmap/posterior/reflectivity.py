# SPDX-License-Identifier: Apache-2.0
"""What all maps of reflectivities can do, whichever estimator they come from.

A cell's reflectivity is the chance that it returns a beam which reaches it. What is known of it is
a Beta distribution, and cells are independent of each other.
"""

from __future__ import annotations

import math
import os
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray, Region
from oddsmap.cell_index import cell_box
from oddsmap.errors import ConfigError, InputError
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.odds import State, Thresholds
from oddsmap.plot.drawn_quantities import DrawnQuantities
from oddsmap.plot.thumbnail import MOST_CELLS, Thumbnail, of_quantity
from oddsmap.posterior.beta import IntervalKind, beta_interval, beta_mode
from oddsmap.query.queries import PointStates, Queries
from oddsmap.short_repr import described, grid_facts

if TYPE_CHECKING:
    from oddsmap.map_files.npz import Column
    from oddsmap.map_files.ros_reader import RosMode

    Rows: TypeAlias = npt.NDArray[Any] | Column

__all__ = [
    "BetaView", "IntervalKind", "Quantity", "Table", "beta_mean", "beta_std", "check_beta_prior"
]  # fmt: skip

Table: TypeAlias = "tuple[Rows, Rows, Rows, Mapping[str, Rows]]"
Quantity = Literal["mean", "mode", "std", "interval-width", "lower", "upper", "p-above"]


def check_beta_prior(a: float, b: float) -> None:
    """Refuse weights of a Beta prior that are not above 0 and finite (ConfigError)."""
    for name, weight in (("a", a), ("b", b)):
        if not 0.0 < weight < math.inf:
            raise ConfigError(f"the Beta prior's {name} is a weight above 0, got {weight}")


class BetaView(Queries, DrawnQuantities[Quantity]):
    """p(reflectivity | z_1:t) of each cell, a Beta distribution.

    Regions are pairs (lo, hi) of cell indices, x first, hi past the last cell; by default the
    box of known cells. Arrays have shape (ny, nx), row = y ascending; (nz, ny, nx) in 3D. Cells
    of which nothing is known have the values of the Beta(a, b) prior.

    Args:
        a: the prior's weight of hits [votes], above 0; a = b = 1 is uniform.
        b: its weight of passes [votes], above 0.
        threshold: reflectivity that tells occupied from free.
        level: mass of the credible interval.
        kind: "equal-tailed" or "highest-density" (the shortest): see
            `oddsmap.posterior.beta.beta_interval`.

    Raises:
        ConfigError: a value is outside its range.
    """

    _reflects: ClassVar[bool] = True

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        yield from grid_facts(self.ndim, self.resolution, None, self.bounds())
        yield from self._settings_facts()

    def _settings_facts(self) -> Iterator[str]:
        yield f"Beta prior {self.a:.4g}, {self.b:.4g}"
        yield f"threshold {self.threshold:g}"
        yield f"{self.kind} intervals of {self.level:g}"

    def __init__(
        self, *, a: float, b: float, threshold: float, level: float, kind: IntervalKind
    ) -> None:
        check_beta_prior(a, b)
        for name, value in (("threshold", threshold), ("level", level)):
            if not 0.0 < value < 1.0:
                raise ConfigError(f"{name} lies between 0 and 1, got {value}")
        if kind not in get_args(IntervalKind):
            known = " or ".join(get_args(IntervalKind))
            raise ConfigError(f"the interval is {known}, got {kind!r}")
        self.a, self.b = float(a), float(b)
        self.threshold, self.level, self.kind = threshold, level, kind

    @property
    @abstractmethod
    def ndim(self) -> int:
        """2 for a 2D map, 3 for a 3D map."""

    @property
    @abstractmethod
    def resolution(self) -> float:
        """Side of a cell [m]."""

    @abstractmethod
    def bounds(self) -> tuple[IntArray, IntArray] | None:
        """The box of known cells: first index and past the last, shape (d,); None: no cells."""

    @abstractmethod
    def parameters(self, region: Region | None = None) -> tuple[FloatArray, FloatArray]:
        """Alpha and beta of a region's cells; a and b where nothing is known."""

    @abstractmethod
    def parameters_at(
        self, index: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
        """Alpha and beta of single cells, and whether anything is known of them, shape (n,) each.

        Args:
            index: cells, shape (n, d), x first.
        """

    @abstractmethod
    def observed(self, region: Region | None = None) -> npt.NDArray[np.bool_]:
        """True where something is known of a region's cells."""

    @abstractmethod
    def cells(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """The known cells, in order of their index, x changing fastest.

        Returns:
            index, shape (n, d), x first; alpha and beta, shape (n,).
        """

    @abstractmethod
    def _counts(self) -> tuple[FloatArray, FloatArray]:
        """Weights of hits and passes of the known cells [votes], shape (n,)."""

    def mean(self, region: Region | None = None) -> FloatArray:
        """Expected reflectivity: alpha / (alpha + beta)."""
        return beta_mean(*self.parameters(region))

    def mode(self, region: Region | None = None) -> FloatArray:
        """Most probable reflectivity: (alpha - 1) / (alpha + beta - 2).

        Where alpha or beta is 1 or less the density is largest at 0 or at 1, and NaN where it is
        flat or has two peaks: see `oddsmap.posterior.beta.beta_mode`.
        """
        return beta_mode(*self.parameters(region))

    def std(self, region: Region | None = None) -> FloatArray:
        """Standard deviation of the reflectivity."""
        return beta_std(*self.parameters(region))

    def interval(
        self,
        region: Region | None = None,
        *,
        level: float | None = None,
        kind: IntervalKind | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Credible interval of the reflectivity: lower and upper ends.

        Args:
            region: which cells.
            level: mass inside; None: the view's.
            kind: None: the view's.
        """
        mass, which = self.level if level is None else level, kind or self.kind
        lower, upper = self._on_pairs(
            lambda alpha, beta: np.stack(beta_interval(alpha, beta, mass, which)), region
        )
        return lower, upper

    def p_above(
        self, region: Region | None = None, *, threshold: float | None = None
    ) -> FloatArray:
        """P(reflectivity > threshold); None: the view's threshold."""
        limit = self.threshold if threshold is None else threshold
        if not 0.0 < limit < 1.0:
            raise ConfigError(f"threshold lies between 0 and 1, got {limit}")
        above: FloatArray = self._on_pairs(
            lambda alpha, beta: _p_above(alpha, beta, limit)[None], region
        )[0]
        return above

    def state(self, region: Region | None = None) -> npt.NDArray[np.int8]:
        """Decide by the credible interval: values of `oddsmap.State`.

        Occupied where the whole interval lies above the threshold, free where it lies below,
        undecided where it straddles it, unknown where nothing is known.
        """
        box = self._region(region)
        lower, upper = self.interval(box)
        return self._decided(lower, upper, self.observed(box))

    def _decided(
        self, lower: FloatArray, upper: FloatArray, observed: npt.NDArray[np.bool_]
    ) -> npt.NDArray[np.int8]:
        state = np.full(lower.shape, State.UNDECIDED, np.int8)
        state[lower > self.threshold] = State.OCCUPIED
        state[upper < self.threshold] = State.FREE
        state[~observed] = State.UNKNOWN
        return state

    def _probability_at(self, cells: IntArray) -> FloatArray:
        return beta_mean(*self.parameters_at(cells)[:2])

    def _states_at(self, cells: IntArray, thresholds: Thresholds | None) -> PointStates:
        _no_thresholds(thresholds)
        alpha, beta, observed = self.parameters_at(cells)
        lower, upper = self.intervals(alpha, beta)
        # A surprise may leave less weight than the prior's: that is no count.
        hits, passes = np.maximum(alpha - self.a, 0.0), np.maximum(beta - self.b, 0.0)
        state = self._decided(lower, upper, observed)
        return PointStates(cells, beta_mean(alpha, beta), state, hits, passes, (lower, upper))

    def _state_parts(
        self, thresholds: Thresholds | None, within: Region | None = None
    ) -> Iterator[tuple[IntArray, npt.NDArray[np.int8]]]:
        _no_thresholds(thresholds)
        index, alpha, beta = self.cells()
        lower, upper = self.intervals(alpha, beta)
        yield index, self._decided(lower, upper, np.ones(len(index), np.bool_))

    def _probability_parts(self) -> Iterator[tuple[IntArray, FloatArray]]:
        index, alpha, beta = self.cells()
        yield index, beta_mean(alpha, beta)

    def quantity(self, name: Quantity, region: Region | None = None) -> FloatArray:
        """One of the quantities by its name on the command line.

        Raises:
            ConfigError: an unknown name.
        """
        if name == "lower":
            return self.interval(region)[0]
        if name == "upper":
            return self.interval(region)[1]
        if name == "interval-width":
            lower, upper = self.interval(region)
            return upper - lower
        known: dict[str, Callable[[Region | None], FloatArray]] = {
            "mean": self.mean, "mode": self.mode, "std": self.std, "p-above": self.p_above
        }  # fmt: skip
        if name not in known:
            raise ConfigError(f"{name!r} is not a quantity; known: {', '.join(get_args(Quantity))}")
        return known[name](region)

    def to_probability_map(self, region: Region | None = None) -> ProbabilityMap:
        """The mean with its place in the world; 2D maps only.

        Raises:
            InputError: a 3D map.
        """
        return self._plane("mean", region)

    def save_ros(
        self, path: str | os.PathLike[str], *, mode: RosMode = "scale", force: bool = False
    ) -> tuple[Path, Path]:
        """Write the mean as a ROS map of probabilities: see `map_files.ros_writer.save_ros`.

        The thresholds written are 0 and 1, so that readers take every value as it is.

        Raises:
            ConfigError: mode "trinary", which would make free and occupied of the mean.
        """
        from oddsmap.map_files.ros_writer import save_ros

        if mode == "trinary":
            raise ConfigError(
                f'{path}: a mean reflectivity is not a state; use mode "scale" or "raw"'
            )
        return save_ros(
            self.to_probability_map(),
            Path(path),
            mode=mode,
            thresholds=Thresholds(0.0, 1.0),
            force=force,
        )

    def _thumbnail(self) -> Thumbnail | None:
        box = self.bounds()
        if self.ndim != 2 or box is None or np.prod(box[1] - box[0]) > MOST_CELLS:
            return None
        mean = np.where(self.observed(), self.mean(), np.nan)
        return of_quantity(mean, "mean reflectivity", (0.0, 1.0))

    def _limits(self, show: Quantity) -> tuple[float, float] | None:
        return None if show in ("std", "interval-width") else (0.0, 1.0)

    def save_npz(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write cells, counts and the posterior: see `oddsmap.map_files.npz.save_npz`.

        `probability` is the mean; `std`, `lower` and `upper` (float32) are added.
        """
        from oddsmap.map_files.npz import all_true, save_npz

        index, hits, passes, values = self._table()
        save_npz(
            Path(path),
            index=index,
            hits=hits,
            passes=passes,
            probability=values["mean"],
            observed=all_true(index.shape[0]),
            resolution=self.resolution,
            extra={name: values[name] for name in ("std", "lower", "upper")},
            force=force,
        )

    def _table(self) -> Table:
        """What `save_npz` writes of the known cells: index, weights, and values by name."""
        index, alpha, beta = self.cells()
        hits, passes = self._counts()
        lower, upper = self.intervals(alpha, beta)
        values = {"mean": beta_mean(alpha, beta), "std": beta_std(alpha, beta)}
        return index, hits, passes, {**values, "lower": lower, "upper": upper}

    def intervals(self, alpha: FloatArray, beta: FloatArray) -> FloatArray:
        """Lower and upper ends of the view's interval, shape (2, n)."""
        return _on_unique_pairs(
            lambda x, y: np.stack(beta_interval(x, y, self.level, self.kind)), alpha, beta
        )

    def _label(self, show: Quantity) -> str:
        interval = f"{100.0 * self.level:g} % {self.kind} interval"
        return {
            "mean": "mean reflectivity",
            "mode": "most probable reflectivity",
            "std": "standard deviation of the reflectivity",
            "interval-width": f"width of the {interval} of the reflectivity",
            "lower": f"lower end of the {interval} of the reflectivity",
            "upper": f"upper end of the {interval} of the reflectivity",
            "p-above": f"P(reflectivity > {self.threshold:g})",
        }[show]

    def _plane(self, show: Quantity, region: Region | None = None) -> ProbabilityMap:
        if self.ndim != 2:
            raise InputError(
                "a picture or a ROS map needs a 2D map, this one is 3D; "
                "write its reflectivity as .npz"
            )
        lo, hi = self._region(region)
        resolution = self.resolution
        return ProbabilityMap(
            probability=self.quantity(show, (lo, hi)),
            observed=self.observed((lo, hi)),
            resolution=resolution,
            origin=(float(lo[0]) * resolution, float(lo[1]) * resolution),
        )

    def _region(self, region: Region | None) -> tuple[IntArray, IntArray]:
        if region is not None:
            return cell_box(*region, self.ndim)
        nothing = np.zeros(self.ndim, np.int64)
        return self.bounds() or (nothing, nothing)

    def _on_pairs(
        self, function: Callable[[FloatArray, FloatArray], FloatArray], region: Region | None
    ) -> FloatArray:
        return _on_unique_pairs(function, *self.parameters(region))


def _on_unique_pairs(
    function: Callable[[FloatArray, FloatArray], FloatArray], alpha: FloatArray, beta: FloatArray
) -> FloatArray:
    """A function of (alpha, beta), shape (k, ...), evaluated once for each pair that occurs.

    Maps have far fewer pairs than cells, and a quantile takes microseconds.
    """
    rows, row = np.unique(alpha.ravel(), return_inverse=True)
    columns, column = np.unique(beta.ravel(), return_inverse=True)
    pairs, pair = np.unique(row * len(columns) + column, return_inverse=True)
    if len(pairs) == 0:
        return np.empty((len(function(np.ones(1), np.ones(1))), *alpha.shape))
    values = function(rows[pairs // len(columns)], columns[pairs % len(columns)])
    return values[:, pair].reshape(-1, *alpha.shape)


def _no_thresholds(thresholds: Thresholds | None) -> None:
    if thresholds is not None:
        raise ConfigError(
            "a view of reflectivity decides by its interval and its own threshold, not by "
            "thresholds of probability: give reflection(threshold=, level=)"
        )


def beta_mean(alpha: FloatArray, beta: FloatArray) -> FloatArray:
    """Mean of Beta distributions."""
    return alpha / (alpha + beta)


def beta_std(alpha: FloatArray, beta: FloatArray) -> FloatArray:
    """Their standard deviation."""
    total = alpha + beta
    return np.sqrt(alpha / total * (beta / total) / (total + 1.0))


def _p_above(alpha: FloatArray, beta: FloatArray, threshold: float) -> FloatArray:
    from scipy.special import betainc

    # The upper tail as the lower one of 1 - m: no digits are lost where it is small.
    return np.asarray(betainc(beta, alpha, 1.0 - threshold))
