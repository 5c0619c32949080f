# SPDX-License-Identifier: Apache-2.0
"""The forward sensor model p(z | map, pose) of beams, narrow or wide.

A reading is the first echo of the cells in the beam's cone plus noise, or a random number, or a
dropout. One definition serves simulation, likelihood and estimation.

Source: Thrun, Learning occupancy grid maps with forward sensor models (2003); Thrun, Burgard,
Fox: Probabilistic Robotics (2005), sections 6.3 and 9.4.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.cell_index import one_cell
from oddsmap.errors import ConfigError, InputError
from oddsmap.forward import predicted_ranges
from oddsmap.forward.beams import BeamCells, Beams, beam_cells
from oddsmap.forward.occupancy_box import Window
from oddsmap.query.predicted_ranges import MapAlongRays, RangeDistribution
from oddsmap.short_repr import short_repr

if TYPE_CHECKING:
    from oddsmap.kernels.infer.first_echo import Noise

__all__ = ["ForwardModel"]


# An echo from this many sigma behind a reading explains it no better than a random reading does:
# at the defaults its share of L_k is 0.6 % of p_random's at 5 sigma (55 % at 4).
_CUT = 5.0
# Of 8 bytes each; some thousand are usual.
_MOST_BINS = 1 << 26


@dataclass(frozen=True, slots=True, kw_only=True)
class ForwardModel:
    """p(z | map, pose) of one beam, given which cells of its cone are occupied.

    The cells of the cone are sorted by the distance of their nearest point into range bins. An
    occupied cell returns the beam with probability detection * (the share of its angular extent
    that lies inside the cone), independently of the others. The first bin from which a cell
    returns the beam gives the range, from the bin's middle, plus Gaussian noise. With p_random
    the reading is uniform between range_min and range_max instead, and with p_dropout a no-return;
    where no cell returns the beam the reading is a no-return unless it is random. A reading that
    noise takes below range_min carries no information, as everywhere.

    The likelihood is linear in the occupancy of each cell, so that for cells that are occupied
    independently with given probabilities it is the mean over all their maps.

    Args:
        cone_deg: full opening angle of a beam [deg], 0 (a ray) to 180.
        range_max: a reading at or above it is a no-return [m].
        range_min: a reading below it carries no information [m].
        detection: probability that an occupied cell wholly inside the cone returns the beam.
        p_random: probability of a random reading; above 0, or one bad reading would veto a cell
            for ever.
        p_dropout: probability of a no-return whatever stands there.
        sigma: standard deviation of the range noise [m].
        range_bias: added to the distance of a cell's nearest point [m].
        bin_width: width of a range bin [m]; None: a quarter of a cell (half a cell costs 0.002 of
            log loss on the sonar benchmark, an eighth gains nothing).

    Raises:
        ConfigError: a value is outside its range.
    """

    cone_deg: float
    range_max: float
    range_min: float = 0.0
    detection: float = 0.98
    p_random: float = 0.02
    p_dropout: float = 0.02
    sigma: float = 0.035
    range_bias: float = 0.005
    bin_width: float | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if not 0.0 <= self.cone_deg <= 180.0:
            raise ConfigError(
                f"sensor.cone_deg is a full opening angle from 0 to 180, got {self.cone_deg}"
            )
        if self.range_max is None:
            raise ConfigError(
                "sensor.range_max is needed: without it a no-return says nothing about any cell"
            )
        if not 0.0 <= self.range_min < self.range_max < math.inf:
            raise ConfigError(
                "sensor ranges need 0 <= range_min < range_max, finite, got "
                f"{self.range_min} and {self.range_max}"
            )
        if not 0.0 < self.detection <= 1.0:
            raise ConfigError(f"sensor.detection lies above 0 and up to 1, got {self.detection}")
        if not self.p_random > 0.0:
            raise ConfigError(
                f"sensor.p_random lies above 0, got {self.p_random}: at 0 one bad reading would "
                "veto a cell for ever"
            )
        if not (self.p_dropout >= 0.0 and self.p_random + self.p_dropout < 1.0):
            raise ConfigError(
                "sensor.p_dropout is 0 or more and p_random + p_dropout below 1, got "
                f"{self.p_random} + {self.p_dropout}"
            )
        for name in ("sigma", "bin_width"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise ConfigError(f"sensor.{name} is a length above 0 m, got {value}")
        if not abs(self.range_bias) < self.range_max:
            raise ConfigError(f"sensor.range_bias is below range_max, got {self.range_bias}")

    def bin_width_at(self, resolution: float) -> float:
        """Width of a range bin [m] for cells of a side [m]."""
        return resolution / 4 if self.bin_width is None else self.bin_width

    def noise(self, resolution: float) -> Noise:
        """What kernels need to know about readings, for cells of a side [m]."""
        from oddsmap.kernels.infer.first_echo import Noise

        return Noise(
            float(self.range_min),
            float(self.range_max),
            float(self.p_random),
            float(self.p_dropout),
            float(self.sigma),
            float(self.bin_width_at(resolution)),
        )

    def reach(self, ranges: npt.ArrayLike) -> FloatArray:
        """Range beyond which no echo changes the likelihood of a reading [m].

        Args:
            ranges: readings [m], any shape.

        Returns:
            The reading, or range_max for a no-return, plus five sigma; NaN where the reading
            carries no information.
        """
        z = np.asarray(ranges, np.float64)
        far = np.minimum(z, self.range_max) + _CUT * self.sigma
        return np.where(z >= self.range_min, far, np.nan)

    def bin_count(self, resolution: float) -> int:
        """How many range bins there are, for cells of a side [m].

        Raises:
            ConfigError: more than a reading's likelihoods could be held for.
        """
        width = self.bin_width_at(resolution)
        bins = float(self.reach(np.inf)) / width
        if not bins < _MOST_BINS:
            raise ConfigError(
                f"sensor.range_max {self.range_max:g} m and sigma {self.sigma:g} m reach over "
                f"{bins:.1e} bins of {width:g} m: set a smaller range_max, or a larger bin_width"
            )
        return int(bins) + 2

    def bin_likelihoods(self, reading: float, resolution: float) -> tuple[FloatArray, float]:
        """What a reading says about where the first echo came from.

        Args:
            reading: the range z [m]; +Inf or at least range_max: no return.
            resolution: side of a cell [m].

        Returns:
            L_k = p(z | first echo from bin k), shape (bins,), and L_inf = p(z | no echo): the
            probability of a reading within a bin's width of z, or of no return. All 1 for a
            reading that carries no information.
        """
        from oddsmap.kernels.infer.first_echo import bin_likelihoods

        by_bin = np.ones(self.bin_count(resolution))
        if not reading >= self.range_min:
            return by_bin, 1.0
        none = bin_likelihoods(float(reading), self.noise(resolution), by_bin)
        return by_bin, float(none)

    def cells(
        self, beams: Beams, resolution: float, lo: npt.ArrayLike, shape: Sequence[int]
    ) -> Iterator[tuple[slice, BeamCells]]:
        """The cells of a window that beams are about, a block of beams at a time.

        Args:
            beams: with their readings: cells are listed up to the `reach` of each and half a bin.
            resolution: side of a cell [m].
            lo: first cell of the window, shape (d,), x first; cells outside of it are left out.
            shape: of the window's array, (ny, nx) or (nz, ny, nx).

        Yields:
            Which beams, in order, and their cells, sorted by range bin.

        Raises:
            InputError: the window is not of the beams' dimension.
            MapTooLargeError: one beam meets more than 2^28 cells.
        """
        if np.shape(lo) != (beams.ndim,) or len(shape) != beams.ndim:
            raise InputError(
                f"a window for {beams.ndim}D beams has as many axes, got lo {lo!r} and shape "
                f"{tuple(shape)}"
            )
        first = one_cell(lo, beams.ndim)
        width = self.bin_width_at(resolution)
        return beam_cells(
            beams,
            # Cells are cut off by their range, but count from the middle of their bin.
            self.reach(beams.ranges) + width / 2,
            cone_deg=self.cone_deg,
            bin_width=width,
            range_bias=self.range_bias,
            resolution=resolution,
            lo=first,
            shape=shape,
        )

    def likelihood(self, beams: Beams, window: Window) -> FloatArray:
        """p(z | map, pose) of each beam.

        Args:
            beams: with their readings.
            window: the map.

        Returns:
            For each beam the probability of a reading within a bin's width of z, or of no return;
            1 for a reading that carries no information. Shape (n,).

        Raises:
            InputError: the window is not of the beams' dimension.
        """
        from oddsmap.kernels.infer.first_echo import likelihoods

        out = np.empty(len(beams))
        for part, listed in self.cells(beams, window.resolution, window.first, window.shape):
            likelihoods(
                beams.ranges[part],
                self.noise(window.resolution),
                listed.offsets,
                listed.cells,
                listed.bins,
                listed.fractions,
                window.occupancy.ravel(),
                window.detection_or(self.detection),
                out[part],
            )
        return out

    def log_likelihood(self, beams: Beams, window: Window) -> FloatArray:
        """Log of p(z | map, pose) of each beam; arguments and errors as in `likelihood`.

        -Inf only for a no-return where p_dropout is 0 and an echo is certain.
        """
        with np.errstate(divide="ignore"):
            return np.log(self.likelihood(beams, window))

    def first_echoes(
        self, beams: Beams, window: Window
    ) -> Iterator[tuple[slice, FloatArray, FloatArray]]:
        """Where the first echo comes from, a block of beams at a time.

        Args:
            beams: their readings are not looked at.
            window: the map.

        Yields:
            Which beams, in order; P(first echo from bin k), shape (b, bins); P(no echo), (b,).

        Raises:
            InputError: the window is not of the beams' dimension.
        """
        from oddsmap.kernels.infer.first_echo import first_echoes

        unseen = Beams(beams.origins, beams.directions, np.full(len(beams), np.inf))
        for part, listed in self.cells(unseen, window.resolution, window.first, window.shape):
            count = len(listed.offsets) - 1
            echo = np.zeros((count, self.bin_count(window.resolution)))
            none = np.empty(count)
            first_echoes(
                listed.offsets,
                listed.cells,
                listed.bins,
                listed.fractions,
                window.occupancy.ravel(),
                window.detection_or(self.detection),
                echo,
                none,
            )
            yield part, echo, none

    def expected_ranges(self, rays: MapAlongRays) -> FloatArray:
        """Mean distance of the first echo [m], range_max where there is none, shape (n,).

        What the map says, without the sensor's random readings, dropouts and noise. Cells are
        occupied independently; `oddsmap.LogOdds.expected_ranges` and its like ask for it.
        """
        return predicted_ranges.expected_ranges(self, rays)

    def range_distribution(
        self, rays: MapAlongRays, bin_width: float | None = None
    ) -> RangeDistribution:
        """p(z) along rays, all of it: P(z in each bin) = sum_k P(first echo from k) P(z | k).

        Args:
            rays: with the map; `oddsmap.LogOdds.range_distribution` and its like make them.
            bin_width: of readings [m]; None: the model's own.

        Raises:
            ConfigError: bin_width is outside its range.
            MapTooLargeError: memory does not hold it.
        """
        return predicted_ranges.range_distribution(self, rays, bin_width)

    def simulate(
        self,
        origins: npt.ArrayLike,
        directions: npt.ArrayLike,
        window: Window,
        rng: np.random.Generator,
    ) -> Beams:
        """Draw readings from the model: the same generator state gives the same readings.

        Args:
            origins: sensor positions [m], shape (n, d).
            directions: unit vectors along the beams, shape (n, d).
            window: the map.
            rng: where the chance comes from.

        Returns:
            The beams with their readings [m]: finite from range_min to below range_max, +Inf for
            a no-return, NaN where noise took the reading below range_min.

        Raises:
            InputError: as `likelihood` and `Beams`.
        """
        at = np.asarray(origins, np.float64)
        blind = Beams(at, np.asarray(directions, np.float64), np.full(len(at), np.inf))
        which, case, place = rng.random((3, len(blind)))
        noise = self.sigma * rng.standard_normal(len(blind))
        heard = np.empty(len(blind))
        width = self.bin_width_at(window.resolution)
        for part, echo, _ in self.first_echoes(blind, window):
            k = (which[part, None] >= np.cumsum(echo, axis=1)).sum(axis=1)
            heard[part] = np.where(k < echo.shape[1], (k + 0.5) * width, np.inf)
        z = heard + noise
        z = np.where(z < self.range_min, np.nan, np.where(z >= self.range_max, np.inf, z))
        random = self.range_min + (self.range_max - self.range_min) * place
        z = np.where(case < self.p_dropout + self.p_random, random, z)
        z = np.where(case < self.p_dropout, np.inf, z)
        return Beams(blind.origins, blind.directions, z)
