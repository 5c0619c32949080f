# SPDX-License-Identifier: Apache-2.0
"""A few scans of a log, kept while it is read: what the checks look at.

A log is read once, for its map. What passes by is thinned to some places along the log and, at
each, to a scan and a few that follow it soon, of which a few hundred returns are kept.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose
from oddsmap.scans.depth_image import DepthScan
from oddsmap.scans.grid_scan import GridScan
from oddsmap.scans.lazy_log import LazyLog
from oddsmap.scans.log import Log
from oddsmap.scans.measurement import Measurement
from oddsmap.scans.scan import Scan

__all__ = ["Glance", "Sample", "sample_of"]

# Returns kept of a scan: 25 places take 1 MB.
_RETURNS = 512


@dataclass(frozen=True, slots=True, eq=False)
class Glance:
    """What is kept of a scan.

    Args:
        pose: map_from_sensor as it was read.
        points: some of its returns in the sensor frame [m], shape (n, d).
        typical_range: the median distance of its returns from the sensor [m], NaN without any.
        from_image: True where it was a depth image, whose z axis looks forward.
        stamp_ns: its time [ns], where it has one.
    """

    pose: Pose
    points: FloatArray
    typical_range: float
    from_image: bool = False
    stamp_ns: int | None = None

    @property
    def ndim(self) -> int:
        """2 or 3."""
        return int(self.points.shape[1])


@dataclass(slots=True, eq=False)
class Sample:
    """Scans picked from a stream of any length; bounded in memory.

    Args:
        expected: how many scans will come; None where that is not known.
        range_max: a reading from here on is no return [m]. Where all of a scan's are, they are
            kept: the limit may be the one that is in another unit.
        places: how many along the log; checks of a whole log find no more with twice as many.
        gaps: how many scans after a place's first one its others are: soon enough to overlap with
            it, late enough to have moved.
    """

    expected: int | None = None
    range_max: float = math.inf
    places: int = 24
    gaps: tuple[int, ...] = (1, 4, 16)
    _stride: int = field(default=1, init=False)
    _kept: dict[int, Glance] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self._stride = max(1, (self.expected or 0) // self.places)

    def watch(self, scans: Iterable[Measurement], first: int = 0) -> Iterator[Measurement]:
        """The same scans; the sample starts again, and fills as they are taken.

        A scan that knows its number goes by that: the same are picked where a log is read in parts.

        Args:
            scans: those of a log, from one of them on.
            first: the number of the first of them.
        """
        self._kept.clear()
        for at, scan in enumerate(scans, first):
            number = at if scan.number is None else scan.number
            if self.wants(number):
                self.add(number, scan)
            yield scan

    def wants(self, number: int) -> bool:
        """Whether the scan of this number, counted from 0, is one to look at."""
        after = number % self._stride
        return after == 0 or after in self.gaps

    def add(self, number: int, scan: Measurement) -> None:
        """Look at a scan."""
        if isinstance(scan, GridScan) or not scan.map_from_sensor.is_finite:
            return
        self._kept[number] = _glance(scan, self.range_max)
        if len(self._kept) > 2 * self.places * (1 + len(self.gaps)):
            self._stride *= 2
            self._kept = {n: kept for n, kept in self._kept.items() if self.wants(n)}

    def include(self, other: Sample) -> None:
        """Take in what was kept of another part of the same log."""
        self._kept = dict(sorted({**self._kept, **other._kept}.items()))

    @property
    def glances(self) -> list[Glance]:
        """The scans that were kept, in order."""
        return list(self._kept.values())

    def pairs(self) -> list[tuple[Glance, Glance]]:
        """Scans that lie near each other in the log, the earlier first."""
        return [(first, later) for first, *rest in self.groups() for later in rest]

    def groups(self) -> list[list[Glance]]:
        """The scans of each place, in order."""
        starts = [n for n in self._kept if n % self._stride == 0]
        return [
            [self._kept[start + gap] for gap in (0, *self.gaps) if start + gap in self._kept]
            for start in starts[:: max(1, len(starts) // self.places)]
        ]


def sample_of(log: Log | Iterable[Measurement], range_max: float | None = None) -> Sample:
    """Look at a log that nobody reads otherwise.

    Of a log whose scans can be read one by one only those that are wanted are read.

    Args:
        log: what `open_log` returns, or any scans.
        range_max: a reading from here on is no return [m]; by default what the log says.
    """
    stated = getattr(log, "sensor", {}).get("range_max", math.inf)
    expected = len(log) if isinstance(log, Sequence) else getattr(log, "scan_count", None)
    sample = Sample(expected, stated if range_max is None else range_max)
    if isinstance(log, LazyLog):
        for number in filter(sample.wants, range(log.scan_count)):
            try:
                sample.add(number, log.read_scan(number))
            except InputError:
                if not log.skip_bad:
                    raise
    else:
        for _ in sample.watch(log):
            pass
    return sample


def _glance(scan: Scan | DepthScan, range_max: float) -> Glance:
    from_image = isinstance(scan, DepthScan)
    ranges, directions, origins = _pixels(scan) if isinstance(scan, DepthScan) else _beams(scan)
    with np.errstate(invalid="ignore"):
        seen = np.isfinite(ranges) & (ranges > 0)
        within = seen & (ranges < range_max)
    kept = within if within.any() else seen
    with np.errstate(over="ignore"):  # of numbers that are no ranges
        points = directions[kept] * ranges[kept, None]
        typical = float(np.median(ranges[kept])) if kept.any() else math.nan
        points = points if origins is None else points + origins[kept]
    return Glance(scan.map_from_sensor, points, typical, from_image, scan.stamp_ns)


def _beams(scan: Scan) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    step = max(1, scan.size // _RETURNS)
    origins = None if scan.beam_origins is None else scan.beam_origins[::step]
    return scan.ranges[::step], scan.directions[::step], origins


def _pixels(scan: DepthScan) -> tuple[FloatArray, FloatArray, None]:
    # Every k-th row and column: whole images would take longer than reading them.
    camera = scan.camera
    step = max(1, math.isqrt(scan.size // _RETURNS))
    some = (slice(None, None, step), slice(None, None, step))
    depth = scan.depth[some].astype(np.float64)
    ranges = np.where(depth > 0, depth, np.nan) * camera.range_per_depth[some]
    directions = camera.directions.reshape(camera.height, camera.width, 3)[some]
    return ranges.ravel(), directions.reshape(-1, 3), None
