# SPDX-License-Identifier: Apache-2.0
"""The scans of a recording with their poses, read message by message."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.poses.at_times import PoseArray
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import NoPoseError
from oddsmap.recordings.beams import Beams
from oddsmap.recordings.level import LEANS, in_the_plane, lean_of
from oddsmap.recordings.poses import SensorPoses
from oddsmap.recordings.recording import START, TRUNCATED, Place, Recording, Topic
from oddsmap.recordings.scan_messages import beams_of
from oddsmap.recordings.scan_places import ScanPlaces
from oddsmap.recordings.survey import form_of, sensor_id
from oddsmap.scans.beam_timing import left_out_note
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.scans.deskew import deskew
from oddsmap.scans.found import Found
from oddsmap.scans.log import SensorInfo
from oddsmap.scans.log_items import ReadOnDemand
from oddsmap.scans.note import Note, bad_scans
from oddsmap.scans.scan import Scan

__all__ = ["RecordedLog"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class RecordedLog(ReadOnDemand):
    """Scans of some topics of a recording; satisfies the `Log` protocol.

    Args:
        recording: where they are.
        topics: the topics of scans.
        sensor_poses: where the sensor was.
        ndim: 2 for scans of the plane, else 3.
        sensors: what is stated about each sensor, by topic, and frame where several share it.
        cameras: the intrinsics of each topic of images.
        units_per_metre: of images of whole numbers; by default they are millimetres.
        opening_notes: what to know before anything is read.
        clock_offset_ns: added to the stamps of scans to get the time of poses [ns].
        skip_bad: skip scans that make no sense and count them, in place of raising.
        continues: another part says what is wrong with the recording.
        others: sensors on the same topics that are left out.
        silent: topics whose unreadable scans another part counts.
        deskews: take each beam at its own time.
        places: where the scans are; None where that is not known.
        found: what reading scans has shown so far.
    """

    recording: Recording
    topics: Sequence[Topic]
    sensor_poses: SensorPoses
    ndim: int
    sensors: Mapping[str, SensorInfo]
    cameras: Mapping[str, PinholeCamera] = field(default_factory=dict)
    units_per_metre: float | None = None
    opening_notes: tuple[Note, ...] = ()
    clock_offset_ns: int = 0
    skip_bad: bool = False
    continues: bool = False
    others: frozenset[str] = frozenset()
    silent: frozenset[str] = frozenset()
    deskews: bool = False
    places: ScanPlaces | None = None
    found: Found = field(default_factory=Found, init=False, repr=False)

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
        lost = 0 if self.continues else sum(each.messages or 1 for each in self.recording.damage)
        reasons = Counter(
            "scan.no_pose" if isinstance(error, NoPoseError) else "scan.unreadable"
            for error in self.found.bad.values()
        )
        left_out = sum(self.found.left_out.values())
        return reasons + Counter({"beam.no_pose": left_out, TRUNCATED: lost})

    @property
    def notes(self) -> tuple[Note, ...]:
        """What to know about this log."""
        found, notes = self.found, list(self.opening_notes)
        if not self.continues:
            notes += [
                Note(str(each), code=TRUNCATED, severity="warning")
                for each in self.recording.damage
            ]
        restated = Counter(found.restated[number] for number in sorted(found.restated))
        for sensor, count in restated.items():
            text = f"{count} scans of {sensor} state other limits than its first one, which count"
            notes.append(Note(text, code="sensor.restated", severity="warning"))
        if found.leaning:
            most = math.degrees(math.asin(min(1.0, max(found.leaning.values()))))
            text = f"{len(found.leaning)} scans lean by more than {math.degrees(LEANS):g} degrees, "
            text += f"up to {most:.3g}: they are mapped as if they were level"
            notes.append(Note(text, code="laser.leans_at_times", severity="warning"))
        if left_out := sum(found.left_out.values()):
            notes.append(left_out_note(left_out))
        if found.bad:
            notes.append(bad_scans(len(found.bad), found.bad[min(found.bad)]))
        return tuple(notes)

    def parts(self) -> list[RecordedLog]:
        """The log, or where its sensors state different things one for those that agree."""
        groups: dict[tuple[tuple[str, float], ...], set[str]] = {}
        for sensor, info in self.sensors.items():
            groups.setdefault(tuple(sorted(info.settings.items())), set()).add(sensor)
        if len(groups) == 1:
            return [self]
        parts: list[RecordedLog] = []
        counted: set[str] = set()
        for own in groups.values():
            # A sensor is called by its topic, and where it shares that by its frame as well.
            names = {
                topic.name
                for topic in self.topics
                if any(
                    sensor == topic.name or sensor.startswith(f"{topic.name} ") for sensor in own
                )
            }
            part = replace(
                self,
                topics=[topic for topic in self.topics if topic.name in names],
                sensors={sensor: self.sensors[sensor] for sensor in self.sensors if sensor in own},
                # What there is to know of the recording is said once.
                opening_notes=() if parts else self.opening_notes,
                continues=bool(parts),
                others=frozenset(self.sensors) - own,
                silent=frozenset(names & counted),
            )
            counted |= names
            parts.append(part)
        return parts

    def __len__(self) -> int:
        """`scan_count`.

        Raises:
            TypeError: it is not known.
        """
        if self.scan_count is None:
            raise TypeError(f"{self.path}: the number of scans is not known before they are read")
        return self.scan_count

    def __iter__(self) -> Iterator[Scan | Any]:
        """The scans in the order of the file; can be started again."""
        return self._scans(START, 0, 0, None)

    @property
    def by_number(self) -> bool:
        """Whether scans of some numbers can be read without those before them."""
        return self.places is not None and self.recording.has_places

    def between(self, first: int, past: int) -> Iterator[Scan | Any]:
        """The scans of some numbers; where `by_number`, little else is read.

        Args:
            first: the first number, 0 or above.
            past: the number after the last one; from `scan_count` on: all that come.
        """
        start, number = START, 0
        if self.places is not None and self.by_number:
            start, number = self.places.before((topic.name for topic in self.topics), first)
        count = self.scan_count
        return self._scans(start, number, first, None if count is None or past >= count else past)

    def _scans(
        self, start: Place, number: int, first: int, past: int | None
    ) -> Iterator[Scan | Any]:
        """The scans from one number on, up to another; `number` is the first one at `start`."""
        kinds = {topic.name: topic.type for topic in self.topics}
        # Messages are counted, the unreadable ones, too: what is skipped moves no number.
        messages = enumerate(self.recording.messages(kinds, start), number)
        for i, message in islice(messages, first - number, None if past is None else past - number):
            name = message.topic
            try:
                beams = beams_of(kinds[name], message.data, self.units_per_metre)
                sensor = sensor_id(name, beams)
                if sensor in self.others:
                    continue
                scan = self._moving(i, name, beams)
            except NoPoseError as error:
                self.found.bad[i] = NoPoseError(f"{name}: {error}")
                continue
            except InputError as error:
                if not self.skip_bad:
                    raise InputError(f"{self.path}: {name}: {error}") from None
                if name not in self.silent:
                    self.found.bad[i] = InputError(f"{name}: {error}")
                continue
            stated = self.sensors.get(sensor, SensorInfo()).settings
            if beams.settings != stated:
                self.found.restated[i] = sensor
            object.__setattr__(scan, "stated", stated)
            object.__setattr__(scan, "number", i)
            object.__setattr__(scan, "sensor_id", sensor)
            yield scan

    def _moving(self, number: int, topic: str, beams: Beams) -> Scan | DepthScan:
        """A scan, deskewed where that is asked for and its beams have times."""
        own, frame = beams.frame_from_sensor, beams.frame
        pose = self.sensor_poses.at(frame, beams.stamp_ns + self.clock_offset_ns)
        if own is not None:
            pose = pose @ own
        scan = self._scan(number, topic, beams, pose)
        if not self.deskews or frame == self.sensor_poses.frame or isinstance(scan, DepthScan):
            return scan  # points in the map are where they were

        def at_times(times_ns: IntArray) -> PoseArray:
            poses = self.sensor_poses.at_times(frame, times_ns)
            return poses if own is None else poses @ PoseArray.fixed(own, len(times_ns))

        scan, left_out = deskew(scan, pose, at_times)
        if left_out:
            self.found.left_out[number] = left_out
        return scan

    def _scan(self, number: int, topic: str, beams: Beams, pose: Pose3) -> Scan | DepthScan:
        stamp = beams.stamp_ns + self.clock_offset_ns
        times = None if beams.after_ns is None else beams.after_ns + stamp
        if beams.depth is not None:
            return DepthScan(pose, beams.depth, self.cameras[topic], stamp)
        if beams.points is not None:
            points = beams.points
            if beams.frame == self.sensor_poses.frame and beams.frame_from_sensor is None:
                points = pose.inverse().transform(points)
            scan = Scan.from_points(pose, points, stamp)
            object.__setattr__(scan, "beam_times_ns", times)
            return scan
        if self.ndim == 2:
            lean = lean_of(form_of(beams), pose)
            if lean > math.sin(LEANS):
                self.found.leaning[number] = lean
            flat, directions = in_the_plane(pose, beams.directions)
            return Scan(flat, directions, beams.ranges, stamp, beam_times_ns=times, trusted=True)
        return Scan(pose, beams.directions, beams.ranges, stamp, beam_times_ns=times, trusted=True)
