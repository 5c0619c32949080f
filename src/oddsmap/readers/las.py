# SPDX-License-Identifier: Apache-2.0
"""LAS, LAZ and COPC as logs: points in the map, joined to a trajectory on GPS time.

Such files have no scans. Points are cut into pieces of a tenth of a second, so that one vote for
each cell and scan is what it is elsewhere; the ray of each point starts where the sensor was at its
own time. The file is read twice: once for its times, and once for its points, in pieces.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import InputError
from oddsmap.limits import memory_limit
from oddsmap.poses.trajectory import Trajectory
from oddsmap.readers.gps_time import clock_offset_ns, clock_offset_of_utc_ns
from oddsmap.readers.gps_track import is_gpx, places_in_map, read_gpx
from oddsmap.readers.las_points import (
    LasFacts,
    LasPoints,
    las_crs,
    las_facts,
    matches,
    read_las_points,
)
from oddsmap.readers.options import FilePath, ReadOptions
from oddsmap.readers.pose_association import stated_poses
from oddsmap.readers.pose_file import PoseFile
from oddsmap.readers.sensor_track import SensorTrack, pose_at, scan_seen_from
from oddsmap.scans.log import Log, SensorInfo
from oddsmap.scans.log_items import ReadOnDemand
from oddsmap.scans.memory_log import LoadedLog
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan

__all__ = ["matches", "open_las"]

_FORMAT = "LAS points"
# One scan: a turn of most LIDARs, and short enough that a point seen again counts again.
_PIECE_NS = 100_000_000
# Trajectories of surveys come with 1 to 200 poses a second.
_TOLERANCE_S = 0.5
# No LIDAR of a survey reaches so far [m]; what does is in other coordinates.
_FARTHEST_M = 20_000.0
# Bytes that a point takes while it waits to be put in order.
_BYTES_OF_POINT = 150
# Times that 64 bits of nanoseconds hold, with room for an offset.
_MAX_TIME_S = 4e9


def open_las(path: str, options: ReadOptions) -> Log:
    """Open a LAS, LAZ or COPC file.

    Raises:
        InputError: it cannot be read; it has no times, or no trajectory is given, or one of
            another time or place.
    """
    options.refuse(
        path, "a LAS file", "times", "camera", "columns", "depth_scale", "scans", "frame"
    )
    options.refuse(path, "a LAS file", "deskew")
    if options.points_in == "sensor":
        raise InputError(
            f"{path}: the points of a LAS file are in the map, not in the frame of a sensor: "
            "leave points_in (--points-in) out"
        )
    facts = las_facts(path)
    notes = _notes(facts)
    if options.origin is not None:
        options.refuse(path, "a LAS file from one place", "clock_offset_s", "body_from_sensor")
        _check_coordinates(path, facts)
        return _from_one_place(path, options.origin, notes)
    if options.poses is None:
        raise InputError(
            f"{path}: a LAS file has points and does not say where they were seen from: give the "
            "trajectory of the sensor with --poses FILE (poses=), or with --origin X Y Z "
            "(origin=) the place where it stood"
        )
    if not facts.timed:
        raise InputError(
            f"{path}: its points have no GPS times (point format 0, 2 or 4): they cannot be "
            "joined to a trajectory"
        )
    census = _take_census(path)
    _check_coordinates(path, facts)
    poses = _poses(path, options.poses, options, facts)
    tolerance = round((_TOLERANCE_S if options.tolerance_s is None else options.tolerance_s) * 1e9)
    track = SensorTrack.of(poses.trajectory, options.body_from_sensor, tolerance)
    _check_place(path, facts, track)
    offset, note = round(options.clock_offset_s * 1e9), None
    stamps = int(track.stamps_ns[0]), int(track.stamps_ns[-1])
    if not offset and poses.globe and is_gpx(track.path):  # always in UTC
        offset, note = clock_offset_of_utc_ns(path, census.span, track.path, stamps)
    elif not offset:
        offset, note = clock_offset_ns(path, census.span, track.path, stamps)
    if not census.in_order:
        needed = census.count * _BYTES_OF_POINT
        if needed > memory_limit() // 2:
            raise InputError(
                f"{path}: its {census.count} points are not in the order of their times, and "
                f"putting them in order takes {needed / 1e9:.3g} GB: sort the file by GPS time"
            )
    return LasLog(
        path=path,
        track=track,
        offset_ns=offset,
        in_order=census.in_order,
        opening_notes=(*notes, *poses.notes, *((note,) if note else ())),
    )


def _poses(
    path: str, stated: FilePath | Trajectory, options: ReadOptions, facts: LasFacts
) -> PoseFile:
    """Poses or positions, those of GPS in the coordinates of the points."""
    if isinstance(stated, Trajectory):
        return PoseFile(stated)
    if is_gpx(stated):
        found = PoseFile(read_gpx(stated), oriented=False, globe=True)
    else:
        found = stated_poses(stated, replace(options, points_in="map"), globe_does=True)
    if not found.globe:
        return found
    if facts.unit:
        raise InputError(
            f"{path}: its coordinates are in {facts.unit}, and heights of GPS in metres: project "
            "the track to these coordinates (t x y z)"
        )
    text = (
        "positions of GPS: taken into the coordinates of the points, with their heights as they "
        "are, which may be off by the height of the geoid"
    )
    return replace(
        found,
        trajectory=places_in_map(found.trajectory, las_crs(path), path),
        notes=(*found.notes, Note(text, code="pose.gps", severity="warning")),
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class LasLog(ReadOnDemand):
    """Points of a LAS file as scans; satisfies the `Log` protocol.

    Args:
        path: the file.
        track: where the sensor was.
        offset_ns: what turns the times of points into those of the track [ns].
        in_order: the points are in the order of their times, to within a piece or so.
        opening_notes: what to know before they are read.
        points_in_map: poses do not move the points, and how they fit says nothing of the poses.
    """

    path: str
    track: SensorTrack
    offset_ns: int
    in_order: bool
    opening_notes: tuple[Note, ...] = ()
    format: str = _FORMAT
    scan_count: int | None = None
    points_in_map: bool = True
    _skipped: Counter[str] = field(default_factory=Counter, init=False, repr=False)

    @property
    def sensor(self) -> Mapping[str, float]:
        """Nothing is known of it."""
        return {}

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """The one sensor."""
        return {"": SensorInfo()}

    @property
    def skipped(self) -> Counter[str]:
        """Points that could not be used, by reason, as far as the log has been read."""
        return +self._skipped

    @property
    def notes(self) -> tuple[Note, ...]:
        """What to know about this log."""
        return self.opening_notes

    def __len__(self) -> int:
        """Never known before the points are read.

        Raises:
            TypeError: always.
        """
        raise TypeError(f"{self.path}: the number of scans is not known before they are read")

    def __iter__(self) -> Iterator[Scan]:
        """The pieces in the order of time; can be started again."""
        self._skipped.clear()
        for times, points in _pieces(self._timed(), in_order=self.in_order):
            places, known = self.track.at(times + self.offset_ns)
            self._skipped["beam.no_pose"] += int(len(known) - np.count_nonzero(known))
            if known.any():
                yield scan_seen_from(points[known], places[known], times[known] + self.offset_ns)

    def _timed(self) -> Iterator[tuple[IntArray, FloatArray]]:
        """Times [ns] and points of each chunk."""
        for part in read_las_points(self.path):
            self._skipped["beam.withheld"] += part.left_out
            usable = np.abs(part.times_s) < _MAX_TIME_S
            self._skipped["beam.no_pose"] += int(len(usable) - np.count_nonzero(usable))
            yield _nanoseconds(part.times_s[usable]), part.points[usable]


def _pieces(
    chunks: Iterator[tuple[IntArray, FloatArray]], *, in_order: bool
) -> Iterator[tuple[IntArray, FloatArray]]:
    """Cut points into pieces of one length of time, each whole and sorted.

    Of chunks in order, pieces are given out that end a piece or more before the last time so far;
    of others, all at the end.
    """
    waiting: list[tuple[IntArray, FloatArray]] = []
    for chunk in chunks:
        waiting.append(chunk)
        if not in_order:
            continue
        times, points = _joined(waiting)
        done = int(np.searchsorted(times, _begin_of_last(times) - _PIECE_NS))
        yield from _cut(times[:done], points[:done])
        waiting = [(times[done:], points[done:])]
    yield from _cut(*_joined(waiting))


def _begin_of_last(times: IntArray) -> int:
    """When the piece of the last time begins; times are in order."""
    return int(times[-1]) // _PIECE_NS * _PIECE_NS if len(times) else 0


def _joined(parts: list[tuple[IntArray, FloatArray]]) -> tuple[IntArray, FloatArray]:
    """All of these, in the order of time."""
    times = np.concatenate([np.empty(0, np.int64), *(times for times, _ in parts)])
    points = np.concatenate([np.empty((0, 3)), *(points for _, points in parts)])
    order = np.argsort(times, kind="stable")
    return times[order], points[order]


def _cut(times: IntArray, points: FloatArray) -> Iterator[tuple[IntArray, FloatArray]]:
    borders = np.flatnonzero(np.diff(times // _PIECE_NS)) + 1
    ends = [0, *borders.tolist(), len(times)]
    for start, end in pairwise(ends):
        if end > start:
            yield times[start:end], points[start:end]


def _nanoseconds(seconds: FloatArray) -> IntArray:
    """Whole and broken seconds apart: their product would be rounded to 64 ns."""
    whole = np.floor(seconds)
    return whole.astype(np.int64) * 10**9 + np.round((seconds - whole) * 1e9).astype(np.int64)


@dataclass(frozen=True, slots=True)
class _Census:
    """What the times of all points are."""

    span: tuple[int, int]
    count: int
    in_order: bool


def _take_census(path: str) -> _Census:
    """Read all times.

    Raises:
        InputError: there is none, or none that is not 0.
    """
    first, last, count, in_order = math.inf, -math.inf, 0, True
    any_time = False
    for part in read_las_points(path):
        times = part.times_s[np.abs(part.times_s) < _MAX_TIME_S]
        if not len(times):
            continue
        any_time |= bool(times.any())
        so_far = np.maximum(np.maximum.accumulate(times), last)
        in_order &= bool((so_far - times).max() < _PIECE_NS / 1e9)
        first, last = min(first, float(times.min())), float(so_far[-1])
        count += len(times)
    if not count:
        raise InputError(f"{path}: it holds no points that have a time")
    if not any_time:
        raise InputError(
            f"{path}: the GPS times of all its {count} points are 0: they cannot be joined to a "
            "trajectory; take the file as it was before another program wrote it"
        )
    ends = _nanoseconds(np.array([first, last]))
    return _Census((int(ends[0]), int(ends[1])), count, in_order)


def _from_one_place(
    path: str, origin: tuple[float, float, float], notes: tuple[Note, ...]
) -> LoadedLog:
    """All points as one scan."""
    parts: list[LasPoints] = list(read_las_points(path))
    points = np.concatenate([np.empty((0, 3)), *(part.points for part in parts)])
    pose = pose_at(np.array(origin))
    left_out = sum(part.left_out for part in parts)
    scan = Scan.from_points(pose, points - pose.translation)
    return LoadedLog(
        path=path,
        format=_FORMAT,
        sensor={},
        skipped=+Counter({"beam.withheld": left_out}),
        notes=notes,
        scans=(scan,),
    )


def _notes(facts: LasFacts) -> tuple[Note, ...]:
    if not facts.unit:
        return ()
    text = (
        f"its coordinates are in {facts.unit}, by its header: they are taken as they are, and "
        "lengths of the map and --resolution are in this unit, as those of the poses must be"
    )
    return (Note(text, code="cloud.unit", severity="warning"),)


def _check_coordinates(path: str, facts: LasFacts) -> None:
    if facts.geographic:
        raise InputError(
            f"{path}: its coordinates are degrees of longitude and latitude, by its header: "
            "project them to metres first (UTM)"
        )


def _check_place(path: str, facts: LasFacts, track: SensorTrack) -> None:
    """Refuse a trajectory in other coordinates than the points, by the box of the header."""
    lo, hi = track.places.min(axis=0), track.places.max(axis=0)
    gap = np.maximum(np.maximum(lo - np.array(facts.hi), np.array(facts.lo) - hi), 0.0)
    if not float(np.linalg.norm(gap)) <= _FARTHEST_M:
        box = [f"{a:.0f} to {b:.0f}" for a, b in zip(facts.lo, facts.hi, strict=True)]
        raise InputError(
            f"{path}: its points (x {box[0]}, y {box[1]}) are {np.linalg.norm(gap) / 1e3:.4g} km "
            f"from the poses of {track.path} (x {lo[0]:.0f} to {hi[0]:.0f}, y {lo[1]:.0f} to "
            f"{hi[1]:.0f}): give both in one coordinate system"
        )
