# SPDX-License-Identifier: Apache-2.0
"""The forward model along rays through a map: where the first echo comes from, and all of p(z)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import ConfigError, MapTooLargeError
from oddsmap.forward.beams import BeamCells, Beams
from oddsmap.forward.cell_grid import CellField, windows_of
from oddsmap.limits import memory_limit
from oddsmap.query.predicted_ranges import MapAlongRays, RangeDistribution

__all__ = ["expected_ranges", "range_distribution"]

# Bins of first echoes held at a time: 8 MB.
_BATCH_BINS = 1 << 20
# Beyond so many standard deviations a double has nothing of the normal distribution left.
_CERTAIN = 9.0


class Model(Protocol):
    """What is asked of a `ForwardModel`, which lies above this module."""

    @property
    def range_min(self) -> float: ...
    @property
    def range_max(self) -> float: ...
    @property
    def detection(self) -> float: ...
    @property
    def p_random(self) -> float: ...
    @property
    def p_dropout(self) -> float: ...
    @property
    def sigma(self) -> float: ...

    def bin_width_at(self, resolution: float) -> float: ...

    def bin_count(self, resolution: float) -> int: ...

    def reach(self, ranges: npt.ArrayLike) -> FloatArray: ...

    def cells(
        self, beams: Beams, resolution: float, lo: npt.ArrayLike, shape: Sequence[int]
    ) -> Iterator[tuple[slice, BeamCells]]: ...


def expected_ranges(model: Model, rays: MapAlongRays) -> FloatArray:
    """Mean distance of the first echo, range_max where there is none: see `ForwardModel`."""
    width = model.bin_width_at(rays.resolution)
    middle = (np.arange(model.bin_count(rays.resolution)) + 0.5) * width
    there = np.minimum(middle, model.range_max)
    found = np.empty(len(rays.origins))
    for part, echo, none in _first_echoes(model, rays):
        found[part] = echo @ there + none * model.range_max
    return found


def range_distribution(
    model: Model, rays: MapAlongRays, bin_width: float | None
) -> RangeDistribution:
    """p(z) along rays: see `ForwardModel`."""
    edges = _edges(model, model.bin_width_at(rays.resolution) if bin_width is None else bin_width)
    n, bins = len(rays.origins), len(edges) - 1
    if 8.0 * n * bins > memory_limit():
        raise MapTooLargeError(
            f"p(z) of {n} rays in {bins} bins takes {8e-9 * n * bins:.3g} GB of memory (there are "
            f"{memory_limit() / 1e9:.3g} GB): ask for fewer rays at a time, or a larger bin_width"
        )
    p = np.empty((n, bins))
    no_return, no_information = np.empty(n), np.empty(n)
    heard = 1.0 - model.p_random - model.p_dropout
    anywhere = model.p_random * np.diff(edges) / (model.range_max - model.range_min)
    for part, echo, none in _first_echoes(model, rays):
        below = _below(echo, edges, model.bin_width_at(rays.resolution), model.sigma)
        p[part] = heard * np.diff(below, axis=1) + anywhere
        beyond = none + np.maximum(echo.sum(axis=1) - below[:, -1], 0.0)
        no_return[part] = model.p_dropout + heard * beyond
        no_information[part] = heard * below[:, 0]
    return RangeDistribution(edges, p, no_return, no_information)


def _edges(model: Model, width: float) -> FloatArray:
    """Of bins from range_min to range_max; the last one may be narrower."""
    span = model.range_max - model.range_min
    if not 0.0 < width <= span:
        raise ConfigError(
            f"bin_width is a length above 0 and up to {span:g} m, the sensor's range_max less its "
            f"range_min, got {width}"
        )
    # A last bin of rounding alone is none.
    count = int(np.ceil(span / width - 1e-9))
    return np.append(model.range_min + width * np.arange(count), model.range_max)


def _below(echo: FloatArray, edges: FloatArray, width: float, sigma: float) -> FloatArray:
    """P(echo and its noise below each edge), shape (rays, edges): echoes are from bins' middles."""
    from scipy.special import ndtr

    before = np.concatenate([np.zeros((len(echo), 1)), np.cumsum(echo, axis=1)], axis=1)
    found = np.empty((len(echo), len(edges)))
    for i, edge in enumerate(edges.tolist()):
        first, last = (
            min(max(int((edge + side * _CERTAIN * sigma) / width), 0), echo.shape[1])
            for side in (-1.0, 1.0)
        )
        middle = (np.arange(first, last) + 0.5) * width
        found[:, i] = before[:, first] + echo[:, first:last] @ ndtr((edge - middle) / sigma)
    # So that no bin has less than nothing by rounding.
    return np.maximum.accumulate(found, axis=1)


def _first_echoes(
    model: Model, rays: MapAlongRays
) -> Iterator[tuple[slice, FloatArray, FloatArray]]:
    """P(first echo from each bin), shape (b, bins), and P(no echo), a batch of rays at a time."""
    from oddsmap.kernels.infer.first_echo import first_echoes

    if len(rays.origins) == 0:
        return
    side, bins = rays.resolution, model.bin_count(rays.resolution)
    field, known = CellField(rays.origins.shape[1], 0), np.empty(0)
    detection = np.array([1.0 if rays.reflects else model.detection])
    far = float(model.reach(np.inf)) / side + 2.0
    for run, window in windows_of(field, rays.origins / side, far):
        some = Beams(rays.origins[run], rays.directions[run], np.full(run.stop - run.start, np.inf))
        shape = tuple(int(n) for n in window.shape[::-1])
        for part, listed in model.cells(some, side, window.lo, shape):
            cells = window.number(listed.cells)
            new = np.arange(len(known), len(field.belief))
            known = np.append(known, rays.occupancy(field.index(new)))
            count = len(listed.offsets) - 1
            size = max(1, _BATCH_BINS // bins)
            for begin in range(0, count, size):
                end = min(begin + size, count)
                echo, none = np.zeros((end - begin, bins)), np.empty(end - begin)
                first_echoes(
                    listed.offsets[begin : end + 1], cells, listed.bins, listed.fractions, known,
                    detection, echo, none,
                )  # fmt: skip
                first = run.start + part.start
                yield slice(first + begin, first + end), echo, none
