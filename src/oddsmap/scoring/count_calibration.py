# SPDX-License-Identifier: Apache-2.0
"""The forward model of narrow beams from a map's own counts, each scan predicted without itself.

    map of all scans, calibrated        # what it knows of each cell
    -> causes of each reading           # from the counts without its own scan: exact
    -> p_random, p_dropout, sigma       # expectation maximisation
    -> detection                        # searched

What it is for is scores, localising and predicted readings: none of it changes a vote. And sigma is
found but not stated, for in a filter it would spread the hits.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Callable, Iterable

import numpy as np

from oddsmap.errors import ConfigError, InputError
from oddsmap.evidence_map import build_map
from oddsmap.forward.model import ForwardModel
from oddsmap.kernels.infer.responsibilities import RANDOM
from oddsmap.posterior.count_view import CountView
from oddsmap.scans.log import Log
from oddsmap.scans.measurement import Measurement
from oddsmap.scoring.calibration import BINS_PER_CELL, Calibration, no_dropouts
from oddsmap.scoring.counts_without import CountsWithout, spread_over
from oddsmap.scoring.fit import NOISE, Fit
from oddsmap.scoring.leave_one_out import Work
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.registry import Sensor

__all__ = ["calibrate_by_counts", "calibrate_narrow"]

# A parameter is told where its value explains the readings better than where it started by this
# [nats], or is known to half of itself.
_GAIN = 2.0
_HALF = 0.5
# Shares of readings that no other scan explains, before the fit and after it, beyond which nothing
# can be said of the sensor.
_MOST_UNEXPLAINED, _MOST_RANDOM = 0.95, 0.5


def calibrate_by_counts(
    view: CountView,
    scans: Iterable[Measurement],
    sensor: BeamSensor,
    *,
    method: str = "rays",
    noise_only: bool = False,
    updates: int = 20,
    progress: Callable[[str, float], None] | None = None,
    skipped: Counter[str] | None = None,
) -> Calibration:
    """Find the forward model of narrow beams that explains the scans of a map best.

    Args:
        view: of the map, by preference the calibrated one.
        scans: those that it was made of; a hundred or two of them are looked at.
        sensor: that they were mapped with: where to start.
        method: that they were mapped with, see `build_map`.
        noise_only: True: leave the detection probability as it is.
        updates: how many updates there may be of p_random, p_dropout and sigma in a row.
        progress: called after each step with what was done and the mean log likelihood.
        skipped: what the map skipped, by reason; None: of the scans looked at alone.

    Returns:
        The sensor with what the log could tell, and notes on what it could not. Its sigma is that
        of `sensor`; what was found is in the notes.

    Raises:
        InputError: no usable scan, no reading is an echo, other scans predict none, or the map was
            not made of these scans.
        ConfigError: the sensor has no range_max, or the map's evidence fades.
        MapTooLargeError: the beams would not fit in memory.
    """
    of_map = view.evidence.config.map
    if of_map.half_life is not None or of_map.half_life_scans is not None:
        raise ConfigError(
            "the map forgets (map.half_life, map.half_life_scans): what a scan has added to it is "
            "not known any more, so that no scan can be predicted without itself; calibrate "
            "without, and build with the sensor found"
        )
    start = dataclasses.replace(sensor.forward_model(), bin_width=view.resolution / BINS_PER_CELL)
    work = CountsWithout(view, spread_over(scans), sensor, method)
    skipped = work.skipped if skipped is None else skipped
    if work.scans == 0:
        reasons = ", ".join(f"{n} x {why}" for why, n in work.skipped.most_common())
        raise InputError(f"the scans: no usable scan ({reasons or 'there are none'})")
    if not (work.beams.ranges < start.range_max).any():
        raise InputError("calibration needs readings that end somewhere: there are no-returns only")
    work.settle(start, 1.0, 0)
    shares = work.causes(start)[~work.no_returns]
    _check_overlap(float(shares[:, RANDOM].mean()), _MOST_UNEXPLAINED)
    fit = Fit(work, start, len(work.beams), updates, progress)
    fit.settle()
    fit.renew_noise()
    for share in () if noise_only else (1.0, 0.4):
        fit.search_detection(share)
        fit.renew_noise()
    _check_overlap(fit.model.p_random, _MOST_RANDOM)
    errors = fit.noise_errors() | fit.errors
    told, notes = _told(work, fit.model, start, errors)
    if not work.no_returns.any():
        notes.append(no_dropouts(start.p_dropout, skipped))
    if "sigma" in told:
        notes.append(
            f"sigma of ranges is {fit.model.sigma:.3g} m; the filter's stays {sensor.sigma:g}, for "
            "it would spread hits over cells (--set sensor.sigma of oddsmap score)"
        )
    names = [name for name in ("detection", "p_random", "p_dropout") if name in told]
    return Calibration(
        sensor=dataclasses.replace(sensor, **{name: getattr(fit.model, name) for name in names}),
        errors={name: errors[name] for name in names},
        edge=1.0,
        log_likelihood=work.log_likelihood(fit.model) / len(work.beams),
        updates=fit.updates,
        converged=fit.converged,
        scans=work.scans,
        beams=len(work.beams),
        skipped=skipped,
        notes=tuple(notes),
    )


def calibrate_narrow(
    log: Log | Iterable[Measurement],
    resolution: float,
    sensor: Sensor,
    *,
    threads: int = 1,
    noise_only: bool = False,
    progress: Callable[[str, float], None] | None = None,
) -> Calibration:
    """Map a log, and fit the forward model to it: see `calibrate_by_counts`.

    Args:
        log: what `open_log` returns, or any scans.
        resolution: side of a cell [m].
        sensor: where to start.
        threads: how many threads map.
        noise_only: True: leave the detection probability as it is.
        progress: called after each step with what was done and the mean log likelihood.

    Raises:
        InputError, ConfigError, MapTooLargeError: as there; or the sensor has no narrow beams.
    """
    if not isinstance(sensor, BeamSensor):
        raise ConfigError(
            "counts predict narrow beams, and hits of wide ones belong to one cell of many: "
            "calibrate for a full map (--estimator full-map)"
        )
    sensor.forward_model()  # refuses a sensor without range_max before the work
    scans = log if hasattr(log, "scan_count") else list(log)
    grid = build_map(scans, resolution, sensor=sensor, threads=threads)
    return calibrate_by_counts(
        grid.calibrated(), scans, sensor, noise_only=noise_only, progress=progress,
        skipped=None if grid.report is None else grid.report.skipped,
    )  # fmt: skip


def _check_overlap(unexplained: float, most: float) -> None:
    if unexplained > most:
        raise InputError(
            f"{unexplained:.0%} of the readings do not end where other scans saw anything: there "
            "are too few scans of a place to predict one by the others, or their poses are off"
        )


def _told(
    work: Work, found: ForwardModel, start: ForwardModel, errors: dict[str, float]
) -> tuple[set[str], list[str]]:
    """Which parameters the readings tell, and what to say of the others and of bounds."""
    best, told = work.log_likelihood(found), set()
    notes = []
    for name in ("detection", *NOISE):
        if name not in errors:
            continue
        value, before, error = getattr(found, name), getattr(start, name), errors[name]
        gain = best - work.log_likelihood(dataclasses.replace(found, **{name: before}))
        if gain > _GAIN or error < _HALF * value:
            told.add(name)
            if math.isnan(error):
                notes.append(f"{name} is at its bound, {value:g}: the log has nothing of the kind")
        else:
            sure = "" if np.isnan(error) else f" +- {error:.2g}"
            notes.append(
                f"the log cannot tell {name} ({value:.3g}{sure} explains it no better than "
                f"{before:g}): kept at {before:g}"
            )
    return told, notes
