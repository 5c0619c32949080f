# SPDX-License-Identifier: Apache-2.0
"""From a recording and what the caller says to a log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import NoPoseError, Trajectory
from oddsmap.recordings.beams import Beams, beams_of
from oddsmap.recordings.choice import choose_frame, choose_scans, pose_topics
from oddsmap.recordings.poses import (
    TF_TYPES,
    BodyPoses,
    SensorPoses,
    TransformPoses,
    add_transforms,
    read_pose_topic,
)
from oddsmap.recordings.recorded_log import RecordedLog, lies_flat
from oddsmap.recordings.recording import Recording, Topic
from oddsmap.recordings.transforms import TransformTree
from oddsmap.scans.beam_timing import BeamTiming, choose_deskew
from oddsmap.scans.log import SensorInfo
from oddsmap.scans.note import Note

__all__ = ["Choices", "log_of"]

# Scans looked at before mapping: whether the laser leans, whether there are poses.
_GLANCES = 50


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Choices:
    """What the caller says of a recording.

    Args:
        scans: topics of scans; by default the only one there is.
        poses: "tf", a topic of poses, or poses of the body that carries the sensor; by default
            the transforms where they move, else the only topic of poses.
        frame: the frame of the map, for transforms.
        body_from_sensor: where the sensor sits on the body; by default as transforms say.
        tolerance_ns: how far the nearest pose or transform may be from a scan [ns].
        clock_offset_ns: added to the stamps of scans to get the time of poses [ns].
        skip_bad: count scans that make no sense, in place of raising.
        deskew: take beams at their own times; None: where times and poses allow it.
    """

    scans: Sequence[str] = ()
    poses: str | Trajectory | None = None
    frame: str | None = None
    body_from_sensor: Pose3 | None = None
    tolerance_ns: int = 100_000_000
    clock_offset_ns: int = 0
    skip_bad: bool = False
    deskew: bool | None = None


def log_of(recording: Recording, choices: Choices) -> RecordedLog:
    """The scans of a recording with their poses.

    Raises:
        InputError: there is no choice, or more than one; or no scan has a pose.
    """
    topics = choose_scans(recording, choices.scans)
    offset = choices.clock_offset_ns
    timings: dict[str, BeamTiming] = {topic.name: BeamTiming(offset) for topic in topics}
    tree, glances, sensors = _survey(recording, topics, timings)
    notes: list[Note] = []
    where = _poses(recording, tree, glances[0].frame, choices, notes)
    seen: list[Pose3] = []
    missing: NoPoseError | None = None
    for beams in glances:
        try:
            seen.append(where.at(beams.frame, beams.stamp_ns + choices.clock_offset_ns))
        except NoPoseError as error:
            missing = missing or error
    if not seen:
        raise InputError(f"{recording.path}: no scan has a pose: {missing}")
    _note_conflicts(tree, notes)
    lasers = all(beams.points is None for beams in glances)
    flat = lasers and all(lies_flat(pose) for pose in seen)
    if lasers and not flat:
        notes.append(Note("the laser leans: it is mapped in 3D", code="laser.leans"))
    spacing = max(where.spacing_ns(frame) for frame in {beams.frame for beams in glances})
    deskews, said = choose_deskew(recording.path, choices.deskew, list(timings.values()), spacing)
    notes.extend(said)
    return RecordedLog(
        recording=recording,
        topics=topics,
        poses=where,
        ndim=2 if flat else 3,
        sensors=sensors,
        opening_notes=tuple(notes),
        clock_offset_ns=choices.clock_offset_ns,
        skip_bad=choices.skip_bad,
        deskews=deskews,
    )


def _survey(
    recording: Recording, topics: Sequence[Topic], timings: Mapping[str, BeamTiming]
) -> tuple[TransformTree, list[Beams], dict[str, SensorInfo]]:
    """One pass over a recording: all transforms, some scans, and what these state.

    Raises:
        InputError: there is no scan.
    """
    tree, seen = TransformTree(recording.path), Counter[str]()
    kinds = {topic.name: topic.type for topic in topics}
    every = {topic.name: max(1, (topic.count or 0) // _GLANCES) for topic in topics}
    others = [topic.name for topic in recording.topics.values() if topic.type in TF_TYPES]
    found: list[Beams] = []
    sensors: dict[str, SensorInfo] = {}
    for message in recording.messages([*kinds, *others]):
        name = message.topic
        if name not in kinds:
            add_transforms(tree, message)
            continue
        if seen[name] % every[name] == 0:
            beams = beams_of(kinds[name], message.data)
            sensors.setdefault(name, SensorInfo(beams.settings))
            found.append(beams)
            timings[name].add(seen[name], beams.stamp_ns, beams.after_ns, message.log_ns)
        seen[name] += 1
    if not found:
        raise InputError(f"{recording.path}: no scan on {', '.join(kinds)}")
    return tree, found, sensors


def _poses(
    recording: Recording, tree: TransformTree, sensor: str, choices: Choices, notes: list[Note]
) -> SensorPoses:
    """Where the sensor was, as the caller says, or by what there is."""
    stated, mounted, tolerance = choices.poses, choices.body_from_sensor, choices.tolerance_ns
    if isinstance(stated, Trajectory):
        return BodyPoses(stated, tree, None, mounted, tolerance)
    if stated in (None, "tf"):
        frame = choose_frame(tree, sensor, choices.frame)
        if frame is not None:
            if frame == "odom":
                text = "the map is in the frame odom: poses are odometry, which drifts"
                notes.append(Note(text, code="pose.odometry", severity="warning"))
            return TransformPoses(tree, frame, tolerance)
        if stated == "tf":
            raise InputError(
                f"{recording.path}: no transform that moves leads to {sensor!r}: give poses with "
                "--poses TOPIC or FILE (poses=)"
            )
    topic = _only_pose_topic(recording, sensor, stated)
    trajectory, frame, body = read_pose_topic(recording, topic)
    notes.append(Note(f"poses are those of {topic}", code="pose.topic"))
    if sensor == frame:
        text = f"the points are in the frame of the map, {frame}: rays start at the poses"
        notes.append(Note(text, code="cloud.in_map", severity="warning"))
    elif mounted is None and sensor not in tree.reachable(body or ""):
        text = f"nothing says where {sensor!r} sits on the robot: it is taken to be at its origin; "
        text += "--body-from-sensor says where"
        notes.append(Note(text, code="extrinsics.missing", severity="warning"))
    return BodyPoses(trajectory, tree, body, mounted, tolerance, frame)


def _only_pose_topic(recording: Recording, sensor: str, stated: str | None) -> str:
    names = [topic.name for topic in pose_topics(recording)]
    if stated is not None:
        if stated not in names:
            raise InputError(
                f"{recording.path}: {stated} is no topic of poses: "
                f"it has {', '.join(names) or 'none'}"
            )
        return stated
    if len(names) != 1:
        there = f"several topics have poses, {', '.join(names)}" if names else "no topic has poses"
        raise InputError(
            f"{recording.path}: no transforms lead to {sensor!r}, and {there}: "
            "give poses with --poses TOPIC or FILE (poses=)"
        )
    return names[0]


def _note_conflicts(tree: TransformTree, notes: list[Note]) -> None:
    for (parent, child), count in tree.conflicts.items():
        if count:
            text = f"{count} transforms {parent} to {child} differ from another of the same stamp: "
            text += "the first of each counts"
            notes.append(Note(text, code="transform.conflict", severity="warning"))
