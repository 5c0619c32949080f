# SPDX-License-Identifier: Apache-2.0
"""One pass over a recording before it is mapped: its transforms, its sensors, some of its scans."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.recordings.beams import Beams
from oddsmap.recordings.depth_messages import camera_of, intrinsics_topic
from oddsmap.recordings.poses import TF_TYPES, add_transforms
from oddsmap.recordings.recording import Message, Recording, Topic, stamp_of
from oddsmap.recordings.scan_messages import IMAGE, RANGE, beams_of
from oddsmap.recordings.scan_places import ScanPlaces
from oddsmap.recordings.transforms import TransformTree
from oddsmap.scans.beam_timing import BeamTiming
from oddsmap.scans.depth_image import PinholeCamera
from oddsmap.scans.log import SensorInfo
from oddsmap.scans.note import Note

__all__ = [
    "Glance",
    "Survey",
    "cameras_of",
    "doubts_of_clocks",
    "form_of",
    "said_of",
    "sensor_id",
    "survey",
]

# Scans of a topic looked at before mapping: whether the laser leans, whether there are poses.
_GLANCES = 50
# Scans take some tenths of a second from their stamp to the recorder, transforms none.
_CLOCKS_APART_S = 0.7
_INTRINSICS = "sensor_msgs/CameraInfo"


@dataclass(frozen=True, slots=True)
class Glance:
    """What is kept of a scan that was looked at.

    Args:
        topic: of the scan.
        sensor: which one it is, see `sensor_id`.
        frame: of its sensor.
        stamp_ns: its time [ns].
        shape: "fan" of a laser, "cone" of a single beam, "cloud" or "image".
        frame_from_sensor: where the sensor is in the frame, where the message says so itself.
    """

    topic: str
    sensor: str
    frame: str
    stamp_ns: int
    shape: str
    frame_from_sensor: Pose3 | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """What one pass over a recording has shown.

    Args:
        tree: all transforms.
        glances: some scans of each topic.
        sensors: what is stated of each sensor, by `sensor_id`.
        images: of each topic of images the frame, the width and the height.
        intrinsics: the first message of each topic of intrinsics.
        notes: what to know, by topic.
        late_ns: how long after the stamps of their headers scans were written [ns], by topic.
        moves_late_ns: the same of transforms, by link; those that never change have no time.
        timings: when the beams of each topic were taken.
        bad: the first scan of each topic that makes no sense, and why.
        places: where all scans are.
    """

    tree: TransformTree
    glances: list[Glance] = field(default_factory=list)
    sensors: dict[str, SensorInfo] = field(default_factory=dict)
    images: dict[str, tuple[str, int, int]] = field(default_factory=dict)
    intrinsics: dict[str, Message] = field(default_factory=dict)
    notes: dict[str, list[Note]] = field(default_factory=dict)
    late_ns: dict[str, list[int]] = field(default_factory=dict)
    moves_late_ns: dict[tuple[str, str], list[int]] = field(default_factory=dict)
    timings: dict[str, BeamTiming] = field(default_factory=dict)
    bad: dict[str, str] = field(default_factory=dict)
    places: ScanPlaces = field(default_factory=ScanPlaces)

    def only(self, topics: Sequence[Topic]) -> Survey:
        """What it has shown of some topics of scans."""
        names = {topic.name for topic in topics}
        return replace(
            self,
            glances=[glance for glance in self.glances if glance.topic in names],
            sensors={
                glance.sensor: self.sensors[glance.sensor]
                for glance in self.glances
                if glance.topic in names
            },
            images={name: image for name, image in self.images.items() if name in names},
            timings={name: timing for name, timing in self.timings.items() if name in names},
        )


def sensor_id(topic: str, beams: Beams) -> str:
    """What a log calls the sensor of a scan: by its topic, and its frame where several share it."""
    return f"{topic} {beams.part}" if beams.part else topic


def survey(
    recording: Recording,
    topics: Sequence[Topic],
    *,
    units_per_metre: float | None = None,
    skip_bad: bool = False,
    clock_offset_ns: int = 0,
) -> Survey:
    """Read all transforms, look at some scans, and learn what these state.

    Args:
        recording: where to look.
        topics: the topics of scans.
        units_per_metre: of images of whole numbers; by default they are millimetres.
        skip_bad: scans that make no sense are left for later, when they are counted.
        clock_offset_ns: what is added to the stamps of scans [ns].

    Raises:
        InputError: one makes no sense.
    """
    found, seen = Survey(TransformTree(recording.path)), Counter[str]()
    kinds = {topic.name: topic.type for topic in topics}
    # Of rangers all, for many share a topic.
    every = {
        topic.name: 1 if topic.type == RANGE else max(1, (topic.count or 0) // _GLANCES)
        for topic in topics
    }
    others = {
        topic.name: topic.type
        for topic in recording.topics.values()
        if topic.type in TF_TYPES or (IMAGE in kinds.values() and topic.type == _INTRINSICS)
    }
    for message in recording.messages([*kinds, *others]):
        name = message.topic
        if others.get(name) == _INTRINSICS:
            found.intrinsics.setdefault(name, message)
        elif name in others:
            add_transforms(found.tree, message)
            for each in message.data.transforms:
                link = (each.header.frame_id.lstrip("/"), each.child_frame_id.lstrip("/"))
                late = message.log_ns - stamp_of(each.header)
                found.moves_late_ns.setdefault(link, []).append(late)
        else:
            found.places.add(name, message.place)
            if seen[name] % every[name] == 0:
                try:
                    beams = beams_of(kinds[name], message.data, units_per_metre)
                except InputError as error:
                    if not skip_bad:
                        raise InputError(f"{recording.path}: {name}: {error}") from None
                    found.bad.setdefault(name, str(error))
                else:
                    _take(found, name, beams, message.log_ns)
                    timing = found.timings.setdefault(name, BeamTiming(clock_offset_ns))
                    timing.add(seen[name], beams.stamp_ns, beams.after_ns, message.log_ns)
            seen[name] += 1
    return found


def doubts_of_clocks(found: Survey) -> list[Note]:
    """Whether scans and transforms were stamped by clocks that differ, by when they were written.

    Localisers date a transform ahead by up to a second: of the links the middle one counts.
    """
    moves = [
        float(np.median(late))
        for link, late in found.moves_late_ns.items()
        if link in found.tree.links and found.tree.moves(*link)
    ]
    notes = []
    for topic, late in found.late_ns.items():
        apart = (float(np.median(late)) - float(np.median(moves))) / 1e9 if moves else 0.0
        if abs(apart) > _CLOCKS_APART_S:
            way = "behind" if apart > 0.0 else "ahead of"
            text = (
                f"{topic}: its stamps are {abs(apart):.3g} s {way} those of the transforms, by "
                f"when both were written: of two clocks? If so, --clock-offset {apart:.3g}"
            )
            notes.append(Note(text, code="clock.header", severity="warning"))
    return notes


def _take(found: Survey, topic: str, beams: Beams, log_ns: int) -> None:
    """Keep what a scan shows."""
    sensor = sensor_id(topic, beams)
    found.sensors.setdefault(sensor, SensorInfo(beams.settings))
    found.glances.append(
        Glance(topic, sensor, beams.frame, beams.stamp_ns, form_of(beams), beams.frame_from_sensor)
    )
    found.late_ns.setdefault(topic, []).append(log_ns - beams.stamp_ns)
    known = found.notes.setdefault(topic, [])
    said = {note.code for note in known}
    known += [note for note in beams.notes if note.code not in said]
    if beams.depth is not None:
        height, width = beams.depth.shape
        found.images.setdefault(topic, (beams.frame, width, height))


def form_of(beams: Beams) -> str:
    """The shape of a scan, see `Glance`."""
    if beams.depth is not None:
        return "image"
    if beams.points is not None:
        return "cloud"
    return "cone" if beams.part else "fan"


def cameras_of(
    path: str, found: Survey, stated: PinholeCamera | None
) -> tuple[dict[str, PinholeCamera], list[Note]]:
    """The camera of each topic of images, and doubts about it.

    By the intrinsics beside the images, else by the only ones of their frame and size.

    Args:
        path: of the recording.
        found: what has been seen of it.
        stated: the camera, where the caller states it.

    Raises:
        InputError: there are no intrinsics, or they make no sense.
    """
    cameras, notes = {}, []
    for topic, (frame, width, height) in found.images.items():
        if stated is not None:
            cameras[topic] = stated
            continue
        beside = intrinsics_topic(topic)
        fitting = [
            name
            for name, message in found.intrinsics.items()
            if message.data.header.frame_id.lstrip("/") == frame
            and (message.data.width, message.data.height) == (width, height)
        ]
        if beside not in found.intrinsics and len(fitting) != 1:
            raise InputError(
                f"{path}: no intrinsics for {topic}: {beside} is not there; state them with "
                "--camera 'FX FY CX CY WIDTH HEIGHT' (camera=)"
            )
        chosen = beside if beside in found.intrinsics else fitting[0]
        try:
            cameras[topic], doubts = camera_of(found.intrinsics[chosen].data, topic)
        except InputError as error:
            raise InputError(f"{path}: {chosen}: {error}") from None
        notes += [said_of(topic, note) for note in doubts]
    return cameras, notes


def said_of(topic: str, note: Note) -> Note:
    """A note that says which topic it is about."""
    return Note(f"{topic}: {note}", code=note.code, severity=note.severity)
