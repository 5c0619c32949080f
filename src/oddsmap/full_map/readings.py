# SPDX-License-Identifier: Apache-2.0
"""Scans become beams for the forward model: which readings say something, by the log's rules."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from oddsmap.config.config import Config
from oddsmap.errors import ConfigError
from oddsmap.forward.beams import Beams
from oddsmap.limits import MAX_COORDINATE
from oddsmap.scans.measurement import Measurement, ranges_of
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor

__all__ = ["ranging_sensor", "usable_beams"]


# Settings of the filter that would change which readings count, and how much.
_OF_THE_FILTER = {
    "map": ("half_life", "path_lengths"),
    "sensor": ("mark_z_min", "mark_z_max", "body_min", "body_max"),
}


def ranging_sensor(config: Config) -> BeamSensor | ConeSensor:
    """The sensor of a configuration that full-map estimation can take.

    Raises:
        ConfigError: its sensor has no forward model, or something is set that the forward model
            does not know and that would change what is mapped.
    """
    sensor = config.sensor
    if not isinstance(sensor, BeamSensor | ConeSensor):
        raise ConfigError(
            f"full-map estimation is for beams and cones; a sensor of kind {sensor.kind} sees "
            "cells one by one: use --estimator filter, which is exact for it"
        )
    for section, names in _OF_THE_FILTER.items():
        for name in names:
            value = getattr(getattr(config, section), name)
            if value is not None and value is not False:
                raise ConfigError(
                    f"{section}.{name} is for the filter, full-map estimation has no such thing: "
                    f"leave it out, or use --estimator filter (got {value})"
                )
    return sensor


def usable_beams(
    scans: Sequence[Measurement],
    sensor: BeamSensor | ConeSensor,
    resolution: float = np.inf,
) -> tuple[Beams, int, Counter[str]]:
    """The beams of some scans that carry information.

    +Inf is a no-return. So is a finite reading of a cone at or above range_max: should it be a
    fault, `p_dropout` is there for it. A narrow beam's reaches past all that was ever seen there,
    and counts only where `clear_range` is set, whatever its length, as in the filter.

    Args:
        scans: measurements of one dimension; depth images are taken as beams.
        sensor: says which readings count.
        resolution: side of a cell [m]: a scan is skipped where its pose is 2^45 cells or more from
            the map's origin; by default none is.

    Returns:
        Beams, of finite range or +Inf; how many scans have any; what was skipped, by reason.

    Raises:
        InputError: scans of the plane and of space are mixed, or a scan is not of ranges.
    """
    taken = ranges_of(scans)
    beams, skipped = Beams.from_scans(taken)
    limit = MAX_COORDINATE * resolution
    here = np.abs(beams.origins).max(axis=1, initial=0.0) < limit
    z = beams.ranges
    range_max = np.inf if sensor.range_max is None else sensor.range_max
    nothing = here & np.isnan(z)
    below = here & (z < sensor.range_min)
    over = here & np.isfinite(z) & (z >= range_max)
    taken_for_no_return = isinstance(sensor, ConeSensor) or sensor.clear_range is not None
    lost = np.zeros_like(over) if taken_for_no_return else over
    used = here & ~(nothing | below | lost)
    skipped["beam.nan"] = int(np.count_nonzero(nothing))
    skipped["beam.below_range_min"] = int(np.count_nonzero(below))
    skipped["beam.no_return"] = int(np.count_nonzero(lost))
    finite = [scan for scan in taken if scan.map_from_sensor.is_finite]
    whose = np.repeat(np.arange(len(finite)), [scan.size for scan in finite])
    scan_count = len(np.unique(whose[used]))
    near = sum(bool(np.abs(s.map_from_sensor.translation).max() < limit) for s in finite)
    skipped["scan.pose_too_far"] = len(finite) - near
    skipped["scan.empty"] = near - scan_count
    kept = Beams(beams.origins[used], beams.directions[used], np.where(over, np.inf, z)[used])
    return kept, scan_count, +skipped
