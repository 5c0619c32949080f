# SPDX-License-Identifier: Apache-2.0
"""The sensor's parameters from a log, without ground truth.

    map of all beams                    # full-map estimation under the parameters so far
    -> causes of each reading           # echo, random or dropout, from the map without it
    -> p_random, p_dropout, sigma       # expectation maximisation
    -> cone width, detection            # searched, the map estimated anew for each
    -> standard errors                  # how sharp the maximum is

docs/method/full-map.md explains the method.

Source: Dempster, Laird and Rubin, Maximum likelihood from incomplete data via the EM algorithm
(1977); Thrun, Burgard, Fox: Probabilistic Robotics (2005), section 6.3.2, for beams on a known map.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from oddsmap.config.full_map import FullMapConfig
from oddsmap.errors import ConfigError, InputError
from oddsmap.scans.log import Log
from oddsmap.scans.measurement import Measurement
from oddsmap.scoring.fit import NOISE, Fit
from oddsmap.scoring.mirrors import Mirrors, look_for_mirrors
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.registry import Sensor, sensor_of_log
from oddsmap.sensors.usable_beams import usable_beams
from oddsmap.short_repr import short_repr

if TYPE_CHECKING:
    from oddsmap.forward.beams import Beams
    from oddsmap.forward.model import ForwardModel
    from oddsmap.scoring.leave_one_out import LeaveOneOut

__all__ = ["BINS_PER_CELL", "Calibration", "calibrate", "no_dropouts"]

BINS_PER_CELL = 8
"""Bins of ranges: those of a quarter of a cell would add (cell / 4)^2 / 12 to sigma^2."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """A sensor model that fits a log.

    Args:
        sensor: with the parameters found.
        errors: standard error of each parameter found: 1 / sqrt(second derivative of minus the log
            likelihood), each by itself, the others held; NaN for one at its bound.
        edge: how abruptly echoes set in at the edge of the cone: an occupied cell with a fraction
            f of its width inside echoes with detection * min(1, edge * f). A nuisance: found so
            that the width of the cone does not have to stand for it, and not part of the sensor.
        log_likelihood: mean over beams of the log density [1/m] of a reading, or probability of a
            no-return, each predicted from the map of all others [nats].
        updates: of p_random, p_dropout and sigma.
        converged: False where they still moved.
        scans: how many were used.
        beams: how many readings.
        skipped: scans and beams that carry no information, by reason.
        notes: what the log could not tell.
        mirrors: whether the walls of a log of cones look like mirrors, see `scoring.mirrors`.
    """

    sensor: BeamSensor | ConeSensor
    errors: dict[str, float]
    edge: float
    log_likelihood: float
    updates: int
    converged: bool
    scans: int
    beams: int
    skipped: Counter[str]
    notes: tuple[str, ...] = ()
    mirrors: Mirrors | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Doubts about the fit as a whole, one sentence each."""
        warning = "" if self.mirrors is None else self.mirrors.warning
        return (warning,) if warning else ()

    __repr__ = short_repr

    @property
    def values(self) -> dict[str, float]:
        """The parameters found, by the names of the configuration."""
        return {name: float(getattr(self.sensor, name)) for name in self.errors}

    def to_toml(self) -> str:
        """A configuration that `oddsmap build --config` takes."""
        lines = ["[sensor]", f'kind = "{self.sensor.kind}"']
        for name in ("cone_deg", "detection", *NOISE):
            value = getattr(self.sensor, name, None)
            if value is None:
                continue
            error = self.errors.get(name)
            stated = "as it was" if error is None else f"+- {error:.2g}"
            if error is not None and math.isnan(error):
                stated = "at its bound"
            lines.append(f"{name} = {float(f'{value:.5g}')!r}  # {stated}")
        for name in ("range_min", "range_max", "clear_range"):
            value = getattr(self.sensor, name)
            if value:
                lines.append(f"{name} = {float(value)!r}")
        return "\n".join(lines) + "\n"


def calibrate(
    log: Log | Iterable[Measurement],
    resolution: float,
    *,
    sensor: Sensor | None = None,
    settings: FullMapConfig | None = None,
    threads: int = 1,
    noise_only: bool = False,
    updates: int = 20,
    progress: Callable[[str, float], None] | None = None,
) -> Calibration:
    """Find the forward sensor model that explains a log best, together with its map.

    Each reading is predicted from the map of all others. The more the beams overlap, the more
    there is to learn; the pose of the sensor is taken as exact.

    Args:
        log: what `open_log` returns, or any scans.
        resolution: side of a cell [m].
        sensor: where to start, and what stays as it is (range_max...); default: what the log says.
        settings: how beliefs are propagated; `method` is "sum-product", which alone has the
            messages that this takes.
        threads: how many threads to use; does not change the result by a bit.
        noise_only: True: leave cone width and detection probability as they are, which takes a
            tenth of the time.
        updates: how many updates there may be of p_random, p_dropout and sigma in a row.
        progress: called after each step with what was done and the mean log likelihood.

    Returns:
        The sensor with standard errors of its parameters.

    Raises:
        InputError: no usable scan, or no reading is an echo.
        ConfigError: the sensor has no forward model, or no range_max; or another method.
        MapTooLargeError: it would not fit in memory.
    """
    if sensor is None:
        sensor = sensor_of_log(log)
    if not isinstance(sensor, BeamSensor | ConeSensor):
        raise ConfigError(
            f"calibration is for beams and cones; a sensor of kind {sensor.kind} sees cells one by "
            "one and has no forward model of ranges"
        )
    settings = settings or FullMapConfig()
    if settings.method != "sum-product":
        raise ConfigError(
            "calibration predicts each reading from the messages of all others, which full_map."
            f'method = "sum-product" alone has; got "{settings.method}"'
        )
    if threads < 1 or updates < 1:
        raise ConfigError(f"threads and updates: at least 1, got {threads} and {updates}")
    from oddsmap.scoring.leave_one_out import LeaveOneOut

    scans = list(log)
    if not scans:
        raise InputError("the scans: no usable scan (there are none); nothing to calibrate with")
    beams, scan_count, skipped = usable_beams(scans, sensor, float(resolution))
    model = dataclasses.replace(sensor.forward_model(), bin_width=float(resolution) / BINS_PER_CELL)
    if scan_count == 0:
        reasons = ", ".join(f"{n} x {why}" for why, n in skipped.most_common())
        raise InputError(f"the scans: no usable scan ({reasons}); nothing to calibrate with")
    if not (beams.ranges < model.range_max).any():
        raise InputError("calibration needs readings that end somewhere: there are no-returns only")
    # Before the work, not after it: a sensor with hit_width takes no sigma.
    sensor = dataclasses.replace(sensor, sigma=model.sigma)
    work = LeaveOneOut(beams, float(resolution), settings, threads)
    fit = Fit(work, model, len(beams), updates, progress)
    fit.settle()
    fit.renew_noise()
    if not noise_only:
        # Wide searches, then near ones: what each finds depends on the others.
        reach = float(np.median(beams.ranges[np.isfinite(beams.ranges)]))
        angle = math.degrees(resolution / max(reach, resolution))
        for share in (1.0, 0.6, 0.4):
            if model.cone_deg > 0.0:
                fit.search_edge(angle, share)
                fit.search_cone(angle, share)
            fit.search_detection(share)
            fit.settle()
            fit.renew_noise()
    errors = fit.noise_errors() | fit.errors
    names = [name for name in ("cone_deg", "detection", *NOISE) if name in errors]
    return Calibration(
        sensor=dataclasses.replace(sensor, **{name: getattr(fit.model, name) for name in names}),
        errors={name: errors[name] for name in names},
        edge=fit.edge,
        log_likelihood=work.log_likelihood(fit.model) / len(beams),
        updates=fit.updates,
        converged=fit.converged,
        scans=scan_count,
        beams=len(beams),
        skipped=skipped + Counter(getattr(log, "skipped", {})),
        notes=() if work.no_returns.any() else (no_dropouts(model.p_dropout, skipped),),
        mirrors=_mirrors(work, fit.model, beams, float(resolution)),
    )


def _mirrors(
    work: LeaveOneOut, model: ForwardModel, beams: Beams, resolution: float
) -> Mirrors | None:
    # A narrow beam that grazes a wall crosses corners of its cells, and is heard farther on.
    if model.cone_deg == 0.0:
        return None
    from oddsmap.kernels.infer.responsibilities import DROPOUT

    dropout = work.causes(model)[:, DROPOUT]
    return look_for_mirrors(
        beams, dropout, *work.cells(), resolution=resolution, range_max=model.range_max
    )


def no_dropouts(kept: float, skipped: Counter[str]) -> str:
    """What to say where no no-return tells p_dropout."""
    no_returns = skipped["beam.no_return"]
    what = "the log has no no-returns"
    if no_returns:
        what = (
            f"no no-return counts ({no_returns:,} are skipped; sensor.clear_range lets them count)"
        )
    return f"{what}: p_dropout cannot be told from it; kept at {kept:g}"
