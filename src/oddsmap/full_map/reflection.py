# SPDX-License-Identifier: Apache-2.0
"""Reflection maps from beams of any width: glass and leaves under a sonar's cone.

Counting gives a hit of a wide beam to all cells of an arc. Here the forward model p(z | map, pose)
shares it among them by how likely each is to have caused it, all cells being estimated together:
the factors of full-map estimation, with a Beta distribution of each cell's reflectivity in place
of a probability of being occupied (`kernels/infer/beta_factor.py`).

    scans -> BeamCollector       # collector.py: the cells of each beam, numbered
          -> filter_beams        # "adf": one pass, in the order of the log
           | revisit_beams       # "ep": the same again, until the means rest
         (-> expected_counts     # "em": counts, until the means rest)
          -> ReflectionMap

It is a poor estimator of whether a cell is occupied: that is what `build_full_map` is for.

Source: Minka, Expectation propagation for approximate Bayesian inference (2001); Luft, Schaefer,
Schubert, Burgard, Closed-form full map posteriors (2018), for Beta maps.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.config.config import Config, MapConfig
from oddsmap.errors import ConfigError
from oddsmap.full_map.collector import BeamCollector
from oddsmap.full_map.reflection_map import REST, ReflectionMap
from oddsmap.full_map.toy_beams import toy_beams
from oddsmap.kernels.infer.cell_status import REACHED
from oddsmap.posterior.reflectivity import check_beta_prior
from oddsmap.scans.log import Log
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.registry import Sensor, sensor_of_log
from oddsmap.warm_up import warm_up

if TYPE_CHECKING:
    from oddsmap.kernels.infer.beam_factor import BeamRows
    from oddsmap.kernels.infer.first_echo import Noise

__all__ = ["ReflectionMethod", "build_reflection_map"]

ReflectionMethod = Literal["ep", "adf", "em"]

# Of the old message, from the second sweep on.
_KEPT = 0.5
# Smallest range noise, as a share of a cell.
_SPREAD = 1.0 / 3.0


def build_reflection_map(
    log: Log | Iterable[Measurement],
    resolution: float,
    *,
    sensor: Sensor | None = None,
    a: float = 0.05,
    b: float = 0.15,
    range_bias: float | None = None,
    method: ReflectionMethod = "ep",
    sweeps: int = 30,
    progress: Callable[[int, float], None] | None = None,
) -> ReflectionMap:
    """Estimate how often each cell returns the beams that reach it, whatever their width.

    "adf", assumed-density filtering, looks at each beam once, in the order of the log, and keeps
    all that a Beta distribution can hold of what it says. "ep", expectation propagation, goes
    through the beams again until the means rest, each time taking out what a beam has said before:
    nearer to the truth, with better intervals, and independent of the beams' order where it rests.
    "em" goes on from "adf" with fractional counts: of each beam, how likely a cell was to have
    returned it, or to have let it pass, under the current means; the counts of the last sweep,
    with the prior, are the result. Under wide cones its intervals are too narrow by far, since
    they know nothing of the doubt about the other cells.

    Args:
        log: what `open_log` returns, or any scans.
        resolution: side of a cell [m].

    Other Args:
        sensor: the sensor model; default: what the log says about its sensor, as in `build_map`.
            Its `detection` has no effect: what a cell returns is what is estimated. Its range noise
            is taken to be a third of a cell at least, since a surface lies anywhere in its cell.
        a: the Beta prior's weight of hits. By default cells are held to be free or solid rather
            than half-way, as most are (the flat prior, a = b = 1, draws both to the middle), and
            free more often: where each is believed to be solid half the time, no beam is believed
            to come far, and a log of few beams says nothing.
        b: its weight of passes.
        range_bias: how far behind the nearest point of its cell a surface lies [m]; None: 2 / pi
            of a cell, from there to its centre, on average over all 2D directions.
        method: "ep", "adf" or "em".
        sweeps: "ep", "em": the largest number of sweeps.
        progress: called after each sweep but that of "adf" with its number and the mean change.

    Returns:
        The map; its `report` says what was used and what was skipped.

    Raises:
        InputError: no usable scan, or 2D and 3D scans together.
        ConfigError: a parameter outside its range, or a sensor without range_max.
        MapTooLargeError: it would not fit in memory.
    """
    from oddsmap.forward.beam_rows import note_observed
    from oddsmap.kernels.infer.beam_factor import NAT
    from oddsmap.kernels.infer.beta_factor import filter_beams

    check_beta_prior(a, b)
    if method not in get_args(ReflectionMethod):
        raise ConfigError(
            f"a reflection map's method is {' or '.join(get_args(ReflectionMethod))}, "
            f"got {method!r}"
        )
    if sweeps < 1:
        raise ConfigError(f"sweeps: at least 1 is needed, got {sweeps}")
    if sensor is None:
        sensor = sensor_of_log(log)
    config = Config(
        map=MapConfig(resolution=float(resolution), votes=sensor.default_votes), sensor=sensor
    )
    collector = BeamCollector(config, "reflection")
    collector.add_log(log)
    bias = 2.0 / math.pi * resolution if range_bias is None else float(range_bias)
    sigma = max(collector.model.sigma, _SPREAD * resolution)
    model = dataclasses.replace(collector.model, detection=1.0, range_bias=bias, sigma=sigma)
    compile_s = warm_up(_estimate_toys)
    started = time.perf_counter()
    field, rows = collector.list_beams((0.5, 0.5), model)
    noise = model.noise(resolution)
    alpha, beta = np.full(len(field.belief), float(a)), np.full(len(field.belief), float(b))
    done, residual = 1, 0.0
    if method == "ep":
        done, residual = _propagate(rows, noise, alpha, beta, sweeps, progress)
    else:
        filter_beams(rows, np.arange(len(rows.readings)), noise, np.ones(1), alpha, beta)
    if method == "em":
        done, residual = _count(rows, noise, alpha, beta, sweeps, progress, (a, b))
    field.belief[:] = np.rint((np.log(alpha) - np.log(beta)) * NAT)
    note_observed(field, rows, model, resolution, np.ones(1))
    shape = (-1, field.block_cells)
    found = ReflectionMap(
        config,
        field.coords,
        alpha.reshape(shape),
        beta.reshape(shape),
        field.observed.reshape(shape) == REACHED,
        a=a,
        b=b,
        sweeps=done,
        residual=residual,
    )
    found.report = collector.report
    found.report.compile_s += compile_s
    found.report.integrate_s += time.perf_counter() - started
    found.provenance = [
        {**entry, "method": method, "range_bias": bias} for entry in collector.provenance
    ]
    return found


def _propagate(
    rows: BeamRows,
    noise: Noise,
    alpha: FloatArray,
    beta: FloatArray,
    max_sweeps: int,
    progress: Callable[[int, float], None] | None,
) -> tuple[int, float]:
    """Expectation propagation from the prior on, in place; its sweeps and residual."""
    from oddsmap.kernels.infer.beta_factor import revisit_beams

    order = np.arange(len(rows.readings))
    added = np.zeros((len(rows.cells), 2), np.float32)
    met = np.unique(rows.cells)
    for number in range(1, max_sweeps + 1):
        mean = alpha / (alpha + beta)
        kept = 0.0 if number == 1 else _KEPT
        revisit_beams(rows, order, noise, np.ones(1), alpha, beta, added, kept)
        residual = _moved(mean, alpha, beta, met)
        if progress is not None:
            progress(number, residual)
        if residual < REST:
            break
    return number, residual


def _count(
    rows: BeamRows,
    noise: Noise,
    alpha: FloatArray,
    beta: FloatArray,
    max_sweeps: int,
    progress: Callable[[int, float], None] | None,
    prior: tuple[float, float],
) -> tuple[int, float]:
    """EM, in place: the prior and the expected counts of the last sweep; sweeps and residual."""
    from oddsmap.kernels.infer.beta_factor import VOTE, expected_counts

    met = np.unique(rows.cells)
    for number in range(1, max_sweeps + 1):
        mean = alpha / (alpha + beta)
        hits, passes = np.zeros((2, len(alpha)), np.int64)
        # Trials that tell something about the cell alone: with others counted, intervals of cells
        # that a cone hardly touches would be too narrow.
        expected_counts(rows, noise, np.ones(1), mean, True, hits, passes)
        alpha[:], beta[:] = prior[0] + hits / VOTE, prior[1] + passes / VOTE
        residual = _moved(mean, alpha, beta, met)
        if progress is not None:
            progress(number, residual)
        if residual < REST:
            break
    return number, residual


def _moved(
    before: FloatArray, alpha: FloatArray, beta: FloatArray, met: npt.NDArray[np.int32]
) -> float:
    """By how much means have changed, on average over the cells that beams meet."""
    change = np.abs(alpha / (alpha + beta) - before)[met]
    return float(change.mean()) if len(change) else 0.0


def _estimate_toys() -> None:
    from oddsmap.forward.beam_rows import note_observed
    from oddsmap.kernels.infer.beta_factor import filter_beams

    for field, rows, model in toy_beams():
        alpha, beta = np.full((2, len(field.belief)), 0.1)
        noise = model.noise(1.0)
        filter_beams(rows, np.arange(1), noise, np.ones(1), alpha, beta)
        _propagate(rows, noise, alpha, beta, 1, None)
        _count(rows, noise, alpha, beta, 1, None, (0.1, 0.1))
        note_observed(field, rows, model, 1.0, np.ones(1))
