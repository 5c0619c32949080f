# SPDX-License-Identifier: Apache-2.0
"""What the doctor keeps of a log: some scans at places along it, and all its times and poses."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from oddsmap.doctor.trial import Alternative
from oddsmap.plausibility.sample import Glance, Sample
from oddsmap.poses.pose import Pose, Pose2, Pose3
from oddsmap.scans.grid_scan import GridScan
from oddsmap.scans.measurement import Measurement

__all__ = ["Examined", "examine"]

# Scans of a place after its first, by number: close together and far apart, whatever the sensor's
# rate and the robot's speed.
_GAPS = (1, 2, 4, 8, 16, 32)
# Places, and single scans along it, to find places that were visited again.
_WAYPOINTS = 600
_PLACES = 30


@dataclass(slots=True, eq=False)
class Examined:
    """The scans of one sensor.

    Args:
        sensor_id: of the log's sensors.
        sample: scans at places along the log, several at each.
        way: single scans all along the log.
        stamps: time of each scan [ns], where it has one.
        poses: map_from_sensor of each scan, as it was read.
        beams: how many readings there are.
        zeros: how many of them are 0.
    """

    sensor_id: str
    sample: Sample
    way: Sample
    stamps: list[int | None] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)
    beams: int = 0
    zeros: int = 0
    groups: list[list[Glance]] = field(default_factory=list)
    waypoints: list[Glance] = field(default_factory=list)

    def add(self, scan: Measurement) -> None:
        """Look at the next scan."""
        if isinstance(scan, GridScan):
            return
        number = len(self.poses)
        self.stamps.append(scan.stamp_ns)
        self.poses.append(scan.map_from_sensor)
        readings = scan.depth if hasattr(scan, "depth") else scan.ranges
        self.beams += readings.size
        if not hasattr(scan, "depth"):  # of a depth image a 0 is how nothing is written
            self.zeros += readings.size - int(np.count_nonzero(readings))
        for sample in (self.sample, self.way):
            if sample.wants(number):
                sample.add(number, scan)

    @property
    def ndim(self) -> int:
        """2 or 3."""
        return 2 if isinstance(self.poses[0], Pose2) else 3

    @property
    def unit(self) -> float:
        """The median of the typical ranges of scans [m]; NaN where nothing was seen."""
        typical = [g.typical_range for group in self.groups for g in group]
        known = [value for value in typical if not math.isnan(value)]
        return float(np.median(known)) if known else math.nan

    def read_as(self, alternative: Alternative) -> None:
        """Take an alternative for what the log meant from here on."""
        self.groups = [[_read(glance, alternative) for glance in group] for group in self.groups]
        self.waypoints = [_read(glance, alternative) for glance in self.waypoints]
        nothing = np.empty((0, self.ndim))
        self.poses = [
            _read(Glance(pose, nothing, math.nan, stamp_ns=stamp), alternative).pose
            for pose, stamp in zip(self.poses, self.stamps, strict=True)
        ]


def _read(glance: Glance, alternative: Alternative) -> Glance:
    pose, points = alternative.place(glance)
    if alternative.scale != 1.0:
        if isinstance(pose, Pose2):
            pose = Pose2(pose.x * alternative.scale, pose.y * alternative.scale, pose.theta)
        else:
            pose = Pose3(pose.translation * alternative.scale, pose.rotation)
    return dataclasses.replace(glance, pose=pose, points=points)


def examine(
    scans: Iterable[Measurement],
    range_max: float = math.inf,
    expected: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> list[Examined]:
    """Go through the scans of a log.

    Args:
        scans: of one log.
        range_max: a reading from here on is no return [m].
        expected: how many scans each sensor has, where that is known.
        progress: called with the number of scans done so far.

    Returns:
        What was kept, for each sensor.
    """
    found: dict[str, Examined] = {}
    for done, scan in enumerate(scans, 1):
        if scan.sensor_id not in found:
            found[scan.sensor_id] = Examined(
                scan.sensor_id,
                Sample(expected, range_max, _PLACES, _GAPS),
                Sample(expected, range_max, _WAYPOINTS, gaps=()),
            )
        found[scan.sensor_id].add(scan)
        if progress is not None:
            progress(done)
    for each in found.values():
        groups = each.sample.groups()
        each.groups, each.waypoints = groups[:: -(-len(groups) // _PLACES) or 1], each.way.glances
    return [each for each in found.values() if each.poses]
