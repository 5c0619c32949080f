# SPDX-License-Identifier: Apache-2.0
"""Simulated scans as a CARMEN log, one FLASER line each."""

from __future__ import annotations

import gzip
import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import BufferedIOBase
from pathlib import Path

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.atomic_write import atomic_output
from oddsmap.errors import ConfigError, InputError
from oddsmap.poses.pose import Pose2
from oddsmap.scans.scan import Scan

__all__ = ["write_carmen"]


_HEADER = (
    "# CARMEN Logfile\n"
    "# written by the simulator of oddsmap\n"
    "# message formats defined: PARAM FLASER\n"
    "# PARAM param_name param_value\n"
    "PARAM robot_frontlaser_offset 0.0 nohost 0\n"
    "# FLASER num_readings [range_readings] x y theta odom_x odom_y odom_theta "
    "ipc_timestamp ipc_hostname logger_timestamp\n"
)
_HOST = "oddsmap"

# Time between scans without a stamp: 5 scans per second, the pace of a SICK on a serial line.
_PERIOD_NS = 200_000_000

# Directions that differ by more than this [rad] are another fan; 1 nrad is 0.1 um at 80 m.
_SAME_FAN = 1e-9


def write_carmen(
    path: str | Path, scans: Iterable[Scan], *, no_return: float = 81.83, force: bool = False
) -> None:
    """Write scans to a CARMEN log; the scans may come from a generator, one is held at a time.

    Poses and ranges are written with all their digits and read back as the same numbers, so
    that no end point changes its cell. The pose of the sensor is written as that of the robot
    as well. A scan's stamp is its time; a scan without one comes 0.2 s after the one before.
    The same scans give the same bytes.

    Args:
        path: the log; with the suffix `.gz` it is compressed.
        scans: of a 2D lidar whose beams are the fan CARMEN takes for granted:
            n beams from -90 degrees on, 180/n degrees apart (n even) or 180/(n - 1) (n odd).
        no_return: written for +Inf [m]; 81.83 is what a SICK gives.
        force: True where an existing file may be replaced.

    Raises:
        ConfigError: `no_return` is not positive and finite.
        InputError: a scan that such a log cannot hold (another fan, a 3D pose or one that
            is not finite, a negative or NaN range, a range at or above `no_return`), or no scan.
        OutputError: the file exists or cannot be written. No error leaves a new file.
    """
    if not (math.isfinite(no_return) and no_return > 0):
        raise ConfigError(f"write_carmen: no_return must be positive [m], got {no_return}")
    path = Path(path)
    with atomic_output(path, force=force) as part, _open(part) as file:
        file.write(_HEADER.encode())
        scan_count = 0
        for line in _lines(scans, no_return, path):
            file.write(line.encode())
            scan_count += 1
        if scan_count == 0:
            raise InputError(f"{path}: there is no scan to write")


@contextmanager
def _open(path: Path) -> Iterator[BufferedIOBase]:
    with path.open("xb") as raw:
        if path.suffix != ".gz":
            yield raw
            return
        # Neither the temporary name nor the time goes in: the same scans, the same bytes.
        with gzip.GzipFile(filename="", mode="wb", fileobj=raw, mtime=0) as packed:
            yield packed


def _lines(scans: Iterable[Scan], no_return: float, path: Path) -> Iterator[str]:
    fan: FloatArray | None = None
    time_ns = -_PERIOD_NS
    for i, scan in enumerate(scans):
        where = f"{path}: scan {i}"
        if scan.directions is not fan:  # scans of one sensor share the array
            _check_fan(scan.directions, where)
            fan = scan.directions
        time_ns = time_ns + _PERIOD_NS if scan.stamp_ns is None else scan.stamp_ns
        ranges = _range_words(scan.ranges, no_return, where)
        pose = _pose_words(scan, where)
        time = _seconds(time_ns)
        yield f"FLASER {len(ranges)} {' '.join(ranges)} {pose} {pose} {time} {_HOST} {time}\n"


def _check_fan(directions: FloatArray, where: str) -> None:
    n = len(directions)
    if directions.shape[1] != 2:
        raise InputError(f"{where}: CARMEN logs hold 2D scans, this one is 3D")
    if n < 2:
        raise InputError(f"{where}: a CARMEN fan needs at least 2 beams, got {n}")
    step = math.pi / (n if n % 2 == 0 else n - 1)
    angles = -math.pi / 2 + step * np.arange(n)
    expected = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    off = np.abs(directions - expected).max()
    if not off <= _SAME_FAN:
        raise InputError(
            f"{where}: CARMEN takes {n} beams to start at -90 degrees and to be "
            f"{math.degrees(step):.6g} degrees apart, and these do not (off by {off:.3g} rad): "
            "give the lidar that fan"
        )


def _range_words(ranges: FloatArray, no_return: float, where: str) -> list[str]:
    nothing = ranges == np.inf
    wrong = ~(nothing | ((ranges >= 0) & (ranges < no_return)))  # NaN is wrong as well
    if wrong.any():
        beam = int(np.flatnonzero(wrong)[0])
        raise InputError(
            f"{where}, beam {beam}: a range must be +Inf or in [0, {no_return}) m to be told from "
            f"no return in a CARMEN log, got {ranges[beam]}"
        )
    # tolist gives Python floats, and repr the fewest digits that read back as the same number.
    return [repr(r) for r in np.where(nothing, no_return, ranges).tolist()]


def _pose_words(scan: Scan, where: str) -> str:
    pose = scan.map_from_sensor
    if not isinstance(pose, Pose2):
        raise InputError(f"{where}: CARMEN logs hold 2D poses, this one is 3D")
    if not pose.is_finite:
        raise InputError(f"{where}: the pose is not finite: {pose}")
    return f"{float(pose.x)!r} {float(pose.y)!r} {float(pose.theta)!r}"


def _seconds(time_ns: int) -> str:
    """Seconds with all nine decimals, without the rounding of a float."""
    sign = "-" if time_ns < 0 else ""
    seconds, remainder = divmod(abs(time_ns), 1_000_000_000)
    return f"{sign}{seconds}.{remainder:09d}"
