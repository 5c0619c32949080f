# SPDX-License-Identifier: Apache-2.0
"""The decay-rate map: how soon a beam ends in the matter of a cell.

Along a beam the chance of being reflected within a short length dl is lambda dl, with one decay
rate lambda [1/m] per cell, so a beam is reflected within a length l with probability
1 - exp(-lambda l). All beams together passed a length L inside the cell and `hits` of them ended
there. As a function of lambda their likelihood is lambda^hits exp(-lambda L), and with a
Gamma(shape, rate) prior the posterior is

    lambda | z ~ Gamma(shape + hits, rate + L)

in closed form, cells independent of each other. Other than in a reflection map, a beam that cuts a
corner of a cell says less than one that crosses it whole.

Source: Schaefer, Luft, Burgard: An analytical lidar sensor model based on ray path information
(2017), the decay rate; Luft, Schaefer, Schubert, Burgard: Closed-form full map posteriors for robot
localization with lidar sensors (2017), the Gamma posterior.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.cell_index import cell_box
from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.kernels.units import ONE
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.plot.drawn_quantities import DrawnQuantities
from oddsmap.plot.thumbnail import MOST_CELLS, Thumbnail, of_quantity
from oddsmap.query.places import Placed
from oddsmap.short_repr import described

__all__ = ["DecayQuantity", "DecayRate"]

Region = tuple[npt.ArrayLike, npt.ArrayLike]
DecayQuantity = Literal["mean", "mode", "std", "interval-width", "lower", "upper", "p-pass"]


class DecayRate(Placed, DrawnQuantities[DecayQuantity]):
    """p(decay rate | z_1:t) of each cell, a Gamma distribution.

    Regions are pairs (lo, hi) of cell indices, x first, hi past the last cell; by default the
    box of known cells. Arrays have shape (ny, nx), row = y ascending; (nz, ny, nx) in 3D. Cells
    without evidence have the values of the prior.

    Args:
        evidence: the map, with path lengths; what is added to it later shows in the view.

    Other Args:
        shape: the prior's weight of hits [votes], above 0.
        rate: the prior's length without a hit [m], above 0; None: the side of a cell. With
            shape = 1 a beam then passes an unseen cell with probability 1/2.
        level: mass of the credible interval.

    Raises:
        InputError: the map keeps no path lengths.
        ConfigError: a value is outside its range.
    """

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        yield from self.evidence.place_facts()
        yield f"Gamma prior of shape {self.shape:g}, rate {self.rate:g} m"
        yield f"intervals of {self.level:g}"

    def __init__(
        self,
        evidence: Evidence,
        *,
        shape: float = 1.0,
        rate: float | None = None,
        level: float = 0.95,
    ) -> None:
        length = evidence.resolution if rate is None else rate
        for name, value in (("shape", shape), ("rate", length)):
            if not 0.0 < value < math.inf:
                raise ConfigError(f"the Gamma prior's {name} is a number above 0, got {value}")
        _check_level(level)
        if evidence.lengths is None:
            raise InputError(
                "decay rates need the length of beams inside cells, which this map does not keep: "
                'build it with map.path_lengths and votes "beam"'
            )
        self.evidence, self._lengths = evidence, evidence.lengths
        self.shape, self.rate, self.level = float(shape), float(length), level

    @property
    def ndim(self) -> int:
        """2 or 3."""
        return self.evidence.ndim

    @property
    def resolution(self) -> float:
        """Side of a cell [m]."""
        return self.evidence.resolution

    def at(self, points: npt.ArrayLike) -> FloatArray:
        """Expected decay rate at points [1/m], shape (n,); the prior's where nothing was seen.

        Args:
            points: in the map frame [m], shape (n, d), x first.

        Raises:
            InputError: as in `cell_of`.
        """
        cells = self.cell_of(points)
        hits, _ = self.evidence.tiles.at(cells)
        _, lengths = self._lengths.at(cells)
        unit = self.resolution / ONE
        return np.asarray((self.shape + hits / ONE) / (self.rate + lengths * unit))

    def mean(self, region: Region | None = None) -> FloatArray:
        """Expected decay rate [1/m]: (shape + hits) / (rate + length)."""
        shape, rate = self._parameters(region)
        return shape / rate

    def mode(self, region: Region | None = None) -> FloatArray:
        """Most probable decay rate [1/m]: (shape + hits - 1) / (rate + length), at least 0."""
        shape, rate = self._parameters(region)
        return np.maximum(shape - 1.0, 0.0) / rate

    def std(self, region: Region | None = None) -> FloatArray:
        """Standard deviation of the decay rate [1/m]."""
        shape, rate = self._parameters(region)
        return np.sqrt(shape) / rate

    def interval(
        self, region: Region | None = None, *, level: float | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Equal-tailed credible interval of the decay rate [1/m]: lower and upper ends.

        Args:
            region: which cells.
            level: mass inside; None: the view's.
        """
        mass = self.level if level is None else level
        _check_level(mass)
        return _interval(*self._parameters(region), mass)

    def p_pass(self, region: Region | None = None, *, way: float | None = None) -> FloatArray:
        """Probability that a beam passes a way through a cell's matter: E[exp(-lambda way)].

        That is (rate' / (rate' + way))^shape' with the posterior's parameters.

        Args:
            region: which cells.
            way: length of the way [m]; None: the side of a cell.
        """
        length = self.evidence.resolution if way is None else way
        if not 0.0 <= length < math.inf:
            raise ConfigError(f"a way is a length of 0 m or more, got {length}")
        return _p_pass(*self._parameters(region), length)

    def observed(self, region: Region | None = None) -> npt.NDArray[np.bool_]:
        """True where a region's cells have any evidence."""
        lo, hi = self._region(region)
        hits, passes = self.evidence.region_units(lo, hi)
        return (hits > 0) | (passes > 0) | (self.evidence.region_lengths(lo, hi) > 0.0)

    def quantity(self, name: DecayQuantity, region: Region | None = None) -> FloatArray:
        """One of the quantities by its name.

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
            "mean": self.mean, "mode": self.mode, "std": self.std, "p-pass": self.p_pass
        }  # fmt: skip
        if name not in known:
            names = ", ".join(get_args(DecayQuantity))
            raise ConfigError(f"{name!r} is not a quantity; known: {names}")
        return known[name](region)

    def cells(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """The cells with evidence, in order of their index, x changing fastest.

        Returns:
            index, shape (n, d), x first; the posterior's shape = shape + hits, and its rate =
            rate + length [m], shape (n,).
        """
        index, hits, _, length = self._cells()
        return index, self.shape + hits, self.rate + length

    def _thumbnail(self) -> Thumbnail | None:
        box = self.evidence.bounds()
        if self.ndim != 2 or box is None or np.prod(box[1] - box[0]) > MOST_CELLS:
            return None
        return of_quantity(np.where(self.observed(), self.mean(), np.nan), self._label("mean"))

    def _plane(self, show: DecayQuantity) -> ProbabilityMap:
        if self.evidence.ndim != 2:
            raise InputError("a picture needs a 2D map, this one is 3D; write .npz")
        lo, _ = self._region(None)
        side = self.evidence.resolution
        return ProbabilityMap(
            probability=self.quantity(show),
            observed=self.observed(),
            resolution=side,
            origin=(float(lo[0]) * side, float(lo[1]) * side),
        )

    def _limits(self, show: DecayQuantity) -> tuple[float, float] | None:
        return (0.0, 1.0) if show == "p-pass" else None

    def save_npz(self, path: str | os.PathLike[str], *, force: bool = False) -> None:
        """Write cells, counts and the posterior: see `oddsmap.map_files.npz.save_npz`.

        `probability` is that of a beam ending within one side of a cell; `length` [m], `mean`,
        `std`, `lower` and `upper` [1/m] (float32) are added.
        """
        from oddsmap.map_files.npz import save_npz

        index, hits, passes, length = self._cells()
        shape, rate = self.shape + hits, self.rate + length
        lower, upper = _interval(shape, rate, self.level)
        save_npz(
            Path(path),
            index=index,
            hits=hits,
            passes=passes,
            probability=1.0 - _p_pass(shape, rate, self.evidence.resolution),
            observed=np.ones(len(index), np.bool_),
            resolution=self.evidence.resolution,
            extra={
                "length": length, "mean": shape / rate, "std": np.sqrt(shape) / rate,
                "lower": lower, "upper": upper,
            },
            force=force,
        )  # fmt: skip

    def _cells(self) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Cells with votes or with a length: index, hits and passes [votes], length [m]."""
        voted, hits, passes = self.evidence.cells()
        measured, lengths = self.evidence.cell_lengths()
        index, row = np.unique(np.concatenate([voted, measured]), axis=0, return_inverse=True)
        values = np.zeros((3, len(index)))
        values[0, row.ravel()[: len(voted)]] = hits / ONE
        values[1, row.ravel()[: len(voted)]] = passes / ONE
        values[2, row.ravel()[len(voted) :]] = lengths * (self.evidence.resolution / ONE)
        order = np.lexsort(index.T)
        return index[order], *values[:, order]

    def _label(self, show: DecayQuantity) -> str:
        interval = f"{100.0 * self.level:g} % interval"
        return {
            "mean": "mean decay rate [1/m]",
            "mode": "most probable decay rate [1/m]",
            "std": "standard deviation of the decay rate [1/m]",
            "interval-width": f"width of the {interval} of the decay rate [1/m]",
            "lower": f"lower end of the {interval} of the decay rate [1/m]",
            "upper": f"upper end of the {interval} of the decay rate [1/m]",
            "p-pass": f"P(a beam passes {self.evidence.resolution:g} m of the cell)",
        }[show]

    def _region(self, region: Region | None) -> tuple[IntArray, IntArray]:
        if region is not None:
            return cell_box(*region, self.evidence.ndim)
        nothing = np.zeros(self.evidence.ndim, np.int64)
        return self.evidence.bounds() or (nothing, nothing)

    def _parameters(self, region: Region | None) -> tuple[FloatArray, FloatArray]:
        lo, hi = self._region(region)
        hits, _ = self.evidence.region(lo, hi)
        return self.shape + hits, self.rate + self.evidence.region_lengths(lo, hi)


def _check_level(level: float) -> None:
    if not 0.0 < level < 1.0:
        raise ConfigError(f"level lies between 0 and 1, got {level}")


def _interval(shape: FloatArray, rate: FloatArray, level: float) -> tuple[FloatArray, FloatArray]:
    from scipy.special import gammaincinv

    tail = (1.0 - level) / 2
    # A quantile of Gamma(shape, rate) is that of Gamma(shape, 1) over the rate.
    shapes, row = np.unique(shape, return_inverse=True)
    lower, upper = gammaincinv(shapes, tail), gammaincinv(shapes, 1.0 - tail)
    place = row.reshape(shape.shape)
    return np.asarray(lower[place] / rate), np.asarray(upper[place] / rate)


def _p_pass(shape: FloatArray, rate: FloatArray, way: float) -> FloatArray:
    return np.asarray(np.exp(-shape * np.log1p(way / rate)))
