# SPDX-License-Identifier: Apache-2.0
"""The exact joint posterior of small maps: p(m | z_1:t) over all 2^n maps of n cells.

What every mapper approximates, written out: a yardstick for tests, and something to learn from.

Source: Thrun, Burgard, Fox: Probabilistic Robotics (2005), section 9.1, where it is set aside as
intractable; the first-echo likelihood is that of `oddsmap.forward.model`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.cell_index import one_cell
from oddsmap.errors import ConfigError, InputError, MapTooLargeError
from oddsmap.forward.beams import Beams
from oddsmap.forward.model import ForwardModel
from oddsmap.scans.scan import Scan
from oddsmap.short_repr import described, extent_of

__all__ = ["MOST_CELLS", "ExactPosterior"]


MOST_CELLS = 20
"""2^20 maps: 8 MB per copy of the joint posterior."""


class ExactPosterior:
    """p(m | z_1:t) over all maps of a few cells; cells outside of the window are free.

    Map number b has cell i occupied where bit i of b is 1, cells counted as in the flat array of
    the window (x fastest).

    Args:
        shape: of the window, (ny, nx) or (nz, ny, nx), of at most 20 cells.

    Other Args:
        resolution: side of a cell [m].
        lo: index of the first cell, shape (d,), x first; default: zeros.
        prior: p(x) of each cell, a number or an array of the window's shape.
        coupling: J of the Ising prior: each pair of equal neighbours (4 in 2D, 6 in 3D)
            multiplies p(m) by exp(J); 0: cells are independent.

    Raises:
        MapTooLargeError: more than 20 cells.
        ConfigError: a prior outside (0, 1) or of another shape, or a coupling that is not a number.
        InputError: the window has no cells, or not 2 or 3 axes.

    Example:
        A sonar cone meets two cells side by side, and something returns the beam. Each cell alone
        is probably occupied; that both are is not certain, but that neither is can be ruled out.
        The marginals cannot say this: their product gives "neither" 9 % in place of 0.1 %.

        >>> beam = Beams(np.array([[0.05, 0.1]]), np.array([[1.0, 0.0]]), np.array([0.26]))
        >>> model = ForwardModel(cone_deg=30, range_max=1.0)
        >>> two = ExactPosterior((2, 1), resolution=0.1, lo=(3, 0))  # the beam runs between them
        >>> two.update(beam, model)
        >>> two.marginals().ravel().round(2)
        array([0.7, 0.7])
        >>> two.probabilities.round(3)  # neither, the lower, the upper, both
        array([0.001, 0.301, 0.301, 0.398])
        >>> two.product_approximation().round(3)
        array([0.091, 0.211, 0.211, 0.488])
    """

    def __repr__(self) -> str:
        return described(self, self._facts)

    def _facts(self) -> Iterator[str]:
        lo = self.lo * self.resolution
        yield f"{' x '.join(map(str, self.shape[::-1]))} cells of {self.resolution:g} m"
        yield extent_of(lo, lo + np.array(self.shape[::-1]) * self.resolution)
        yield f"{1 << self.cell_count:,} maps"

    def __init__(
        self,
        shape: Sequence[int],
        *,
        resolution: float,
        lo: npt.ArrayLike | None = None,
        prior: npt.ArrayLike = 0.5,
        coupling: float = 0.0,
    ) -> None:
        self.shape = tuple(int(count) for count in shape)
        if len(self.shape) not in (2, 3) or min(self.shape) < 1:
            raise InputError(f"a window has shape (ny, nx) or (nz, ny, nx), got {self.shape}")
        self.cell_count = math.prod(self.shape)
        if self.cell_count > MOST_CELLS:
            raise MapTooLargeError(
                f"a window of {self.cell_count} cells has 2^{self.cell_count} maps: "
                f"the exact posterior takes up to {MOST_CELLS} cells"
            )
        if not 0.0 < resolution < math.inf:
            raise InputError(f"a window needs a positive resolution [m], got {resolution}")
        self.resolution = float(resolution)
        d = len(self.shape)
        self.lo = np.zeros(d, np.int64) if lo is None else one_cell(lo, d)
        if not math.isfinite(coupling):
            raise ConfigError(f"coupling is a finite number, got {coupling}")
        p = np.asarray(prior, np.float64)
        if p.shape not in ((), self.shape) or not ((p > 0.0) & (p < 1.0)).all():
            raise ConfigError(
                f"prior is a probability between 0 and 1, or an array of them of shape "
                f"{self.shape}, got {prior!r}"
            )
        each = np.broadcast_to(p, self.shape).ravel()
        self._log_joint = np.log(_product(each)) + coupling * _equal_pairs(self.shape)
        self._log_joint -= _log_sum(self._log_joint)

    @property
    def maps(self) -> BoolArray:
        """All maps, in order of their number, shape (2^n, *shape)."""
        return self._map_of(np.arange(1 << self.cell_count))

    @property
    def probabilities(self) -> FloatArray:
        """p(m | z_1:t) of each map, shape (2^n,), sums to 1."""
        return np.exp(self._log_joint - _log_sum(self._log_joint))

    @property
    def log_evidence(self) -> float:
        """Log of p(z_1:t): how well the sensor model and the prior predicted all readings."""
        return _log_sum(self._log_joint)

    def update(
        self,
        beams: Beams | Scan,
        model: ForwardModel,
        *,
        detection: npt.ArrayLike | None = None,
    ) -> None:
        """Multiply by p(z | m, pose) of some beams.

        Args:
            beams: from known poses; readings that carry no information change nothing.
            model: the forward sensor model.
            detection: chance of detection of each cell, of the window's shape; default: the
                model's.

        Raises:
            InputError: beams of another dimension, a scan whose pose is not finite, or detection
                outside [0, 1], or readings that no map explains. The posterior is as before.
        """
        if isinstance(beams, Scan):
            if not beams.map_from_sensor.is_finite:
                raise InputError(f"the pose of a scan is not finite: {beams.map_from_sensor}")
            beams, _ = Beams.from_scans([beams])
        chance = np.asarray(model.detection if detection is None else detection, np.float64)
        if chance.shape not in ((), self.shape) or not ((chance >= 0) & (chance <= 1)).all():
            raise InputError(f"detection lies in [0, 1] and has shape {self.shape}")
        chance = np.broadcast_to(chance, self.shape).ravel()
        log_joint = self._log_joint.copy()
        full = log_joint.reshape((2,) * self.cell_count)
        for part, listed in model.cells(beams, self.resolution, self.lo, self.shape):
            for b, reading in enumerate(beams.ranges[part]):
                rows = slice(listed.offsets[b], listed.offsets[b + 1])
                cells = listed.cells[rows]
                by_bin, none = model.bin_likelihoods(float(reading), self.resolution)
                over = _over_maps(
                    chance[cells] * listed.fractions[rows], listed.bins[rows], by_bin, none
                )
                # Axis a of `full` is cell n - 1 - a; so is that of what is added to it, once the
                # cells of the beam, nearest first, are put in the window's order.
                count = len(cells)
                order = np.argsort(-cells)
                over = over.reshape((2,) * count).transpose(count - 1 - order)
                sizes = np.ones(self.cell_count, np.int64)
                sizes[self.cell_count - 1 - cells] = 2
                with np.errstate(divide="ignore"):
                    full += np.log(over).reshape(sizes)
        self._keep(log_joint)

    def update_likelihood(self, likelihood: npt.ArrayLike) -> None:
        """Multiply by the likelihood p(z | m) of any other reading.

        Args:
            likelihood: of each map, in the order of `maps`, shape (2^n,), up to a factor.

        Raises:
            InputError: another shape, a negative or infinite value, or no map is possible.
        """
        by_map = np.asarray(likelihood, np.float64)
        if by_map.shape != self._log_joint.shape or not ((by_map >= 0) & np.isfinite(by_map)).all():
            raise InputError(
                f"the likelihood of {len(self._log_joint)} maps is as many numbers of 0 or more, "
                f"got shape {by_map.shape}"
            )
        with np.errstate(divide="ignore"):
            self._keep(self._log_joint + np.log(by_map))

    def marginals(self) -> FloatArray:
        """p(m_i = 1 | z_1:t) of each cell, of the window's shape."""
        joint = self.probabilities
        each = [joint.reshape(-1, 2, 1 << i)[:, 1].sum() for i in range(self.cell_count)]
        return np.array(each, np.float64).clip(0.0, 1.0).reshape(self.shape)

    def product_approximation(self) -> FloatArray:
        """The joint that the marginals alone would give, cells independent, shape (2^n,)."""
        return _product(self.marginals().ravel())

    def product_divergence(self) -> float:
        """KL(joint || product of the marginals) [nats]: what a map of single cells cannot say.

        By the entropies, sum of H(m_i) less H(m): a marginal that rounds to 1 gives no infinity.
        """
        p = self.marginals()
        cells = -np.sum(_p_log_p(p)) - np.sum(_p_log_p(1.0 - p))
        return max(0.0, float(cells + np.sum(_p_log_p(self.probabilities))))

    def sample(self, count: int, rng: np.random.Generator) -> BoolArray:
        """Draw maps from the joint posterior, shape (count, *shape)."""
        number = rng.choice(len(self._log_joint), size=count, p=self.probabilities)
        return self._map_of(number)

    def most_probable(self) -> BoolArray:
        """The map of the largest posterior probability, of the window's shape."""
        return self._map_of(np.array([np.argmax(self._log_joint)])).reshape(self.shape)

    def _map_of(self, number: npt.NDArray[np.int64]) -> BoolArray:
        bits = (number[:, None] >> np.arange(self.cell_count)) & 1
        return np.asarray(bits == 1).reshape(-1, *self.shape)

    def _keep(self, log_joint: FloatArray) -> None:
        if log_joint.max() == -np.inf:
            raise InputError("these readings rule out every map that the ones before left possible")
        self._log_joint = log_joint


def _over_maps(
    chances: FloatArray, bins: npt.NDArray[np.int32], by_bin: FloatArray, none: float
) -> FloatArray:
    # p(z | m) over all maps of a beam's cells, bit i = cell i, nearest first. Built bin by bin, so
    # that the arrays double with each cell: the whole costs little more than the last bin.
    through, heard = np.ones(1), np.zeros(1)
    for k in np.unique(bins):
        silent = np.ones(1)
        for chance in chances[bins == k]:
            silent = np.multiply.outer([1.0, 1.0 - chance], silent).ravel()
        heard = (heard + np.multiply.outer(by_bin[k] * (1.0 - silent), through)).ravel()
        through = np.multiply.outer(silent, through).ravel()
    return heard + none * through


def _product(p: FloatArray) -> FloatArray:
    joint = np.ones(1)
    for occupied in p:
        joint = np.multiply.outer([1.0 - occupied, occupied], joint).ravel()
    return joint


def _equal_pairs(shape: tuple[int, ...]) -> FloatArray:
    # How many pairs of neighbours are equal, for each map.
    number = np.arange(1 << math.prod(shape))
    cell = np.arange(math.prod(shape)).reshape(shape)
    count = np.zeros(len(number))
    for axis in range(len(shape)):
        one = np.moveaxis(cell, axis, 0)[:-1].ravel()
        other = np.moveaxis(cell, axis, 0)[1:].ravel()
        for i, j in zip(one, other, strict=True):
            count += ((number >> i) ^ (number >> j)) & 1 == 0
    return count


def _p_log_p(p: FloatArray) -> FloatArray:
    return p * np.log(np.where(p > 0.0, p, 1.0))


def _log_sum(log_values: FloatArray) -> float:
    highest = float(log_values.max())
    return highest + math.log(float(np.sum(np.exp(log_values - highest))))
