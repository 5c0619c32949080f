# SPDX-License-Identifier: Apache-2.0
"""The scans of a recording with their poses, read message by message."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.poses.trajectory import NoPoseError
from oddsmap.recordings.beams import Beams, beams_of
from oddsmap.recordings.poses import SensorPoses
from oddsmap.recordings.recording import Recording, Topic
from oddsmap.scans.beam_timing import left_out_note
from oddsmap.scans.deskew import deskew
from oddsmap.scans.log import SensorInfo
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan

__all__ = ["RecordedLog", "lies_flat"]

# A laser whose plane leans by more than this sees other walls than a map of the plane has.
_FLAT = math.cos(math.radians(3.0))


def lies_flat(map_from_sensor: Pose3) -> bool:
    """Whether a laser scans the plane of the map, upright or overhead."""
    return bool(abs(map_from_sensor.rotation[2, 2]) >= _FLAT)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RecordedLog:
    """Scans of some topics of a recording; satisfies the `Log` protocol.

    Args:
        recording: where they are.
        topics: the topics of scans.
        poses: where the sensor was.
        ndim: 2 for scans of the plane, else 3.
        sensors: what is stated about each sensor, by topic.
        opening_notes: what to know before anything is read.
        clock_offset_ns: added to the stamps of scans to get the time of poses [ns].
        skip_bad: skip scans that make no sense and count them, in place of raising.
        deskews: take each beam at its own time.
    """

    recording: Recording
    topics: Sequence[Topic]
    poses: SensorPoses
    ndim: int
    sensors: Mapping[str, SensorInfo]
    opening_notes: tuple[Note, ...] = ()
    clock_offset_ns: int = 0
    skip_bad: bool = False
    deskews: bool = False
    _skipped: Counter[str] = field(default_factory=Counter, init=False, repr=False)
    _first: list[str] = field(default_factory=list, init=False, repr=False)

    @property
    def path(self) -> str:
        """Where the log was read from."""
        return self.recording.path

    @property
    def format(self) -> str:
        """Name of the format, for people."""
        return self.recording.format

    @property
    def sensor(self) -> Mapping[str, float]:
        """What is stated of the sensors; of several ranges the widest."""
        merged: dict[str, float] = {}
        for info in self.sensors.values():
            for name, value in info.settings.items():
                widest = min if name == "range_min" else max
                merged[name] = widest(merged.get(name, value), value)
        return merged

    @property
    def scan_count(self) -> int | None:
        """How many scans there are, those without a pose among them."""
        counts = [topic.count for topic in self.topics]
        return None if None in counts else sum(count or 0 for count in counts)

    @property
    def skipped(self) -> Counter[str]:
        """Scans that could not be used, by reason, as far as the log has been read."""
        return Counter(self._skipped)

    @property
    def notes(self) -> tuple[Note, ...]:
        """What to know about this log."""
        notes = self.opening_notes
        if left_out := self._skipped["beam.no_pose"]:
            notes = (*notes, left_out_note(left_out))
        if not self._first:
            return notes
        count = self._skipped.total() - left_out
        text = f"{count} scans were skipped, the first: {self._first[0]}"
        return (*notes, Note(text, code="log.bad_scans", severity="warning"))

    def __len__(self) -> int:
        """`scan_count`.

        Raises:
            TypeError: it is not known.
        """
        if self.scan_count is None:
            raise TypeError(f"{self.path}: the number of scans is not known before they are read")
        return self.scan_count

    def __iter__(self) -> Iterator[Scan]:
        """The scans in the order of the file; can be started again."""
        self._skipped.clear()
        self._first.clear()
        kinds = {topic.name: topic.type for topic in self.topics}
        stated = self.sensor
        for message in self.recording.messages(kinds):
            try:
                scan = self._moving(beams_of(kinds[message.topic], message.data))
            except NoPoseError as error:
                self._skip("scan.no_pose", message.topic, error)
                continue
            except InputError as error:
                if not self.skip_bad:
                    raise InputError(f"{self.path}: {message.topic}: {error}") from None
                self._skip("scan.unreadable", message.topic, error)
                continue
            object.__setattr__(scan, "stated", stated)
            object.__setattr__(scan, "sensor_id", message.topic)
            yield scan

    def _skip(self, reason: str, topic: str, error: InputError) -> None:
        self._skipped[reason] += 1
        if not self._first:
            self._first.append(f"{topic}: {error}")

    def _moving(self, beams: Beams) -> Scan:
        """A scan, deskewed where that is asked for and its beams have times."""
        pose = self.poses.at(beams.frame, beams.stamp_ns + self.clock_offset_ns)
        scan = self._scan(beams, pose)
        if not self.deskews or beams.frame == self.poses.frame:
            return scan  # points in the map are where they were
        scan, left_out = deskew(scan, pose, lambda times: self.poses.at_times(beams.frame, times))
        if left_out:
            self._skipped["beam.no_pose"] += left_out
        return scan

    def _scan(self, beams: Beams, pose: Pose3) -> Scan:
        stamp = beams.stamp_ns + self.clock_offset_ns
        times = None if beams.after_ns is None else beams.after_ns + stamp
        if beams.points is not None:
            points = beams.points
            if beams.frame == self.poses.frame:
                points = pose.inverse().transform(points)
            scan = Scan.from_points(pose, points, stamp)
            object.__setattr__(scan, "beam_times_ns", times)
            return scan
        if self.ndim == 2:
            flat, directions = _in_the_plane(pose, beams.directions)
            return Scan(flat, directions, beams.ranges, stamp, beam_times_ns=times)
        return Scan(pose, beams.directions, beams.ranges, stamp, beam_times_ns=times)


def _in_the_plane(pose: Pose3, directions: FloatArray) -> tuple[Pose2, FloatArray]:
    """A level scan seen from above; that of a laser that hangs upside down runs the other way."""
    x, y, _ = pose.translation.tolist()
    yaw = math.atan2(pose.rotation[1, 0], pose.rotation[0, 0])
    flat = directions[:, :2]
    if pose.rotation[2, 2] < 0.0:
        flat = flat * np.array([1.0, -1.0])
    return Pose2(x, y, yaw), flat
