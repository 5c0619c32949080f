# SPDX-License-Identifier: Apache-2.0
"""g2o graphs with laser scans: the poses are those of the vertices, as they were optimised.

    VERTEX_SE2 id x y theta
    ROBOTLASER1 ...                      the data of the vertex before it, as in a CARMEN log
    EDGE_SE2 from to dx dy dtheta i11 i12 i13 i22 i23 i33
    FIX id

The two poses of a ROBOTLASER1 line, of the laser and of the robot, are odometry. What counts of
them is where the laser sits on the robot; the vertex is the place of the robot.

Source: g2o, OptimizableGraph::load and RobotLaser::read, https://github.com/RainerKuemmerle/g2o
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose2
from oddsmap.readers.carmen_messages import BadLineError, LaserLine, parse_laser_line
from oddsmap.readers.compression import Source
from oddsmap.readers.laser_lines import (
    MAX_BAD_LINES_KEPT,
    find_range_max,
    note_bad_lines,
    quote,
    to_scan,
)
from oddsmap.readers.plain_text import to_number
from oddsmap.scans.memory_log import BadLine, LoadedLog
from oddsmap.scans.note import Note

__all__ = ["matches", "open_g2o"]

_VERTEX = "VERTEX_SE2"
_LASERS = ("ROBOTLASER1", "ROBOTLASER2")
_STARTS = (b"VERTEX_", b"VERTEX2 ", b"VERTEX3 ", b"EDGE_SE")

# A vertex this near to the odometry of its scan was not moved [m, rad].
_NOT_MOVED = 1e-3


def matches(head: bytes) -> bool:
    """Whether a file that starts like this is a graph: its laser lines alone are CARMEN's."""
    return any(line.startswith(_STARTS) for line in head.splitlines())


def open_g2o(source: Source) -> LoadedLog:
    """Read the laser scans of a graph.

    Returns:
        The scans of all ROBOTLASER1 and ROBOTLASER2 lines in file order, each from the vertex
        before it. `sensor["range_max"]` is found as in CARMEN logs.

    Raises:
        InputError: there are no laser lines, or none that can be used.
    """
    reading = _Reading(source)
    for number, text in enumerate(source.content.splitlines(), start=1):
        fields = text.split()
        if fields and not fields[0].startswith(b"#"):
            reading.take(number, fields)
    if not reading.lines:
        raise _no_scan_error(source.path, reading)
    notes = source.initial_notes()
    note_bad_lines(source.path, reading.bad_lines, reading.bad_count, notes, "lines")
    range_max = find_range_max(reading.lines, notes)
    _note_graph(reading, notes)
    return LoadedLog(
        path=source.path,
        format="g2o graph",
        sensor={} if range_max is None else {"range_max": range_max},
        skipped=reading.skipped,
        notes=tuple(notes),
        scans=tuple(
            to_scan(line, pose) for line, pose in zip(reading.lines, reading.poses, strict=True)
        ),
        bad_lines=tuple(reading.bad_lines),
    )


class _Reading:
    """What has been read so far."""

    def __init__(self, source: Source) -> None:
        self.lines: list[LaserLine] = []
        self.poses: list[Pose2] = []
        self.kinds: Counter[str] = Counter()
        self.skipped = source.initial_skipped()
        self.bad_lines: list[BadLine] = []
        self.bad_count = 0
        # The vertex that a scan belongs to; None behind an edge, whose data it would be.
        self._vertex: Pose2 | None = None
        self.unmoved = 0

    def take(self, number: int, fields: list[bytes]) -> None:
        """Read one line, or count why not."""
        kind = fields[0][:24].decode("ascii", "replace")
        self.kinds[kind] += 1
        try:
            if kind == _VERTEX:
                self._vertex = None
                self._vertex = _read_vertex(fields)
            elif kind in _LASERS:
                self._take_laser(kind, fields)
            elif kind.startswith(("EDGE", "VERTEX")):
                self._vertex = None
        except BadLineError as error:
            self.skipped[error.reason] += 1
            self.bad_count += 1
            if len(self.bad_lines) < MAX_BAD_LINES_KEPT:
                self.bad_lines.append(BadLine(number, str(error)))

    def _take_laser(self, kind: str, fields: list[bytes]) -> None:
        line = parse_laser_line(kind, fields)
        robot = line.map_from_robot
        if self._vertex is None:
            raise BadLineError("scan.no_pose", f"{kind} does not follow a {_VERTEX} line")
        if robot is None or not robot.is_finite:
            raise BadLineError("scan.nan_pose", f"{kind} has a robot pose that is NaN or infinite")
        self.lines.append(line)
        # Exactly the vertex where the laser is in the middle of the robot: rounding would move
        # what lies on the border of a cell.
        laser = line.map_from_sensor
        centred = laser == robot
        self.poses.append(self._vertex if centred else self._vertex @ (robot.inverse() @ laser))
        offset = robot.inverse() @ self._vertex
        turn = abs((offset.theta + np.pi) % (2 * np.pi) - np.pi)
        self.unmoved += bool(max(abs(offset.x), abs(offset.y), turn) < _NOT_MOVED)


def _read_vertex(fields: list[bytes]) -> Pose2:
    """The pose of a VERTEX_SE2 line."""
    if len(fields) < 5:
        raise BadLineError("line.short", f"{_VERTEX} has {len(fields)} fields, 5 are needed")
    try:
        x, y, theta = (to_number(field.decode("ascii", "replace")) for field in fields[2:5])
    except ValueError:
        raise BadLineError("line.malformed", f"{_VERTEX} needs numbers for its pose") from None
    pose = Pose2(x, y, theta)
    if not pose.is_finite:
        raise BadLineError("scan.nan_pose", f"{_VERTEX} has a pose that is NaN or infinite")
    return pose


def _note_graph(reading: _Reading, notes: list[Note]) -> None:
    """Note what to know before trusting a map of these scans."""
    edges = sum(count for kind, count in reading.kinds.items() if kind.startswith("EDGE"))
    if edges:
        text = f"{edges} edges (constraints between poses) were not read"
        notes.append(Note(text, code="graph.edges"))
    if reading.unmoved == len(reading.lines) > 1:
        text = "all vertices are where odometry has them: the graph does not look optimised"
        notes.append(Note(text, code="graph.not_optimised", severity="warning"))


def _no_scan_error(path: str, reading: _Reading) -> InputError:
    found = ", ".join(f"{kind} ({count})" for kind, count in reading.kinds.most_common(6))
    if not any(reading.kinds[kind] for kind in _LASERS):
        return InputError(
            f"{path}: a g2o graph without laser lines ({' or '.join(_LASERS)} after its "
            f"{_VERTEX}); found {found}: give a graph that keeps its scans, or the log of the laser"
        )
    first = f", the first: {quote(path, reading.bad_lines[0])}" if reading.bad_lines else ""
    reasons = ", ".join(f"{reason} {count}" for reason, count in reading.skipped.most_common())
    return InputError(
        f"{path}: no usable scan in this g2o graph, lines were skipped ({reasons}){first}: check "
        "that the graph was written whole"
    )
