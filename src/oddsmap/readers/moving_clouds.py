# SPDX-License-Identifier: Apache-2.0
"""Clouds of a folder whose points have times: each point seen from where the sensor was then."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.poses.at_times import PoseArray
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import NoPoseError
from oddsmap.readers.options import ReadOptions
from oddsmap.readers.point_cloud import Cloud
from oddsmap.readers.pose_association import PoseMatch
from oddsmap.scans.beam_times import after_stamp
from oddsmap.scans.beam_timing import BeamTiming, choose_deskew, left_out_note
from oddsmap.scans.deskew import deskew
from oddsmap.scans.found import Found
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan

__all__ = ["MovingClouds"]

# Clouds looked at before mapping, where the first one has times.
_GLANCES = 5
# See `recordings/poses.py`: poses that come ten times a second are enough.
_TOLERANCE_NS = 100_000_000


class MovingClouds:
    """Whether the clouds of a folder are deskewed, and the doing of it.

    Args:
        name: the folder, what messages start with.
        count: how many clouds there are.
        read: the cloud of a number.
        match: their poses; None where each cloud has one of its own.
        options: what the caller says.
        found: where beams that are left out are counted.

    Raises:
        InputError: they are to be deskewed, and have no times, or their poses have none.
    """

    def __init__(
        self,
        name: str,
        count: int,
        read: Callable[[int], Cloud],
        match: PoseMatch | None,
        options: ReadOptions,
        found: Found,
    ) -> None:
        self.notes: tuple[Note, ...] = ()
        self._deskews = False
        self._options = options
        self._left_out = found.left_out
        self._track = None if match is None else match.track
        if options.deskew is False or (options.points_in == "map" and not options.deskew):
            return
        if options.points_in == "map":
            raise InputError(
                f"{name}: points in the frame of the map are where they were seen: leave `deskew` "
                "out, or points_in"
            )
        if match is None or self._track is None:
            if options.deskew:
                raise InputError(
                    f"{name}: deskewing needs the times of scans and poses, as TUM's format has "
                    "them: leave `deskew` out, or give such poses"
                )
            return
        timing = _timing(count, read, match)
        self._deskews, self.notes = choose_deskew(
            name, options.deskew, [timing], self._track.spacing_ns
        )

    def moved(self, i: int, scan: Scan, cloud: Cloud) -> Scan:
        """The scan of a number, deskewed where that was decided and the cloud has times."""
        pose, after = scan.map_from_sensor, None
        if self._deskews:
            after = _after(cloud, scan.stamp_ns)
        if after is None or scan.stamp_ns is None or not isinstance(pose, Pose3):
            return scan
        object.__setattr__(scan, "beam_times_ns", scan.stamp_ns + after)
        try:
            found, self._left_out[i] = deskew(scan, pose, self._poses_at)
        except NoPoseError:
            self._left_out[i] = scan.size
            return Scan(scan.map_from_sensor, np.empty((0, 3)), np.empty(0), scan.stamp_ns)
        return found

    def _poses_at(self, times_ns: IntArray) -> PoseArray:
        if self._track is None:
            raise NoPoseError("there are no poses")
        poses = self._track.at(times_ns, max(self._options.tolerance_ns, _TOLERANCE_NS))
        mounted = self._options.body_from_sensor
        return poses if mounted is None else poses @ PoseArray.fixed(mounted, len(times_ns))

    @property
    def skipped(self) -> Counter[str]:
        """Beams at whose times there is no pose, of the clouds read so far."""
        return +Counter({"beam.no_pose": sum(self._left_out.values())})

    @property
    def found_notes(self) -> tuple[Note, ...]:
        """What to say of them."""
        left_out = sum(self._left_out.values())
        return (left_out_note(left_out),) if left_out else ()


def _timing(count: int, read: Callable[[int], Cloud], match: PoseMatch) -> BeamTiming:
    """The times of some clouds, or of none where the first has none."""
    timing = BeamTiming()
    for i in sorted({0, *range(0, count, max(1, count // _GLANCES))})[:_GLANCES]:
        try:
            cloud = read(i)
        except InputError:
            continue  # said when its turn comes
        stamp = match.stamp_ns(i)
        after = _after(cloud, stamp)
        if after is None and i == 0:
            break
        timing.add(i, stamp or 0, after)
    return timing


def _after(cloud: Cloud, stamp_ns: int | None) -> IntArray | None:
    if cloud.times is None or stamp_ns is None or len(cloud.times) != len(cloud.points):
        return None
    return after_stamp(cloud.times, stamp_ns)
