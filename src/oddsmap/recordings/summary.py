# SPDX-License-Identifier: Apache-2.0
"""What is in a recording, in words, and the command that would map it."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.recordings.choice import body_frame, map_frames, pose_topics, scan_topics
from oddsmap.recordings.open_recording import Choices, log_of
from oddsmap.recordings.recording import Recording, Topic, shape_of
from oddsmap.recordings.scan_messages import RANGE
from oddsmap.recordings.survey import Survey, survey
from oddsmap.recordings.transforms import TransformTree

__all__ = ["describe"]

# Kinds of messages that hold readings which are not read from here, and what to do.
_PACKETS = "raw packets: convert them to PointCloud2 with the vendor's driver"
_NOT_READ = {
    "sensor_msgs/PointCloud": "convert it to PointCloud2",
    "sensor_msgs/CompressedImage": "colour, unless it is compressedDepth",
    "draco_point_cloud_transport_msgs/CompressedPointCloud2": "decompress it to PointCloud2",
    "point_cloud_interfaces/CompressedPointCloud2": "decompress it to PointCloud2 "
    "(point_cloud_transport republish)",
    "ouster_ros/PacketMsg": _PACKETS,
    "ouster_sensor_msgs/PacketMsg": _PACKETS,
    "velodyne_msgs/VelodyneScan": _PACKETS,
    "hesai_ros_driver/UdpFrame": _PACKETS,
    "rslidar_msg/RslidarPacket": _PACKETS,
    "nebula_msgs/NebulaPackets": _PACKETS,
}
_COMPRESSED_DEPTH = "compressed: republish it as raw images (image_transport republish)"


def describe(recording: Recording) -> dict[str, Any]:
    """Facts about a recording, for people and for JSON.

    Raises:
        InputError: it is damaged.
    """
    facts: dict[str, Any] = {"recording": recording.path, "format": recording.format}
    seconds = 0.0
    if recording.span_ns is not None:
        first, last = recording.span_ns
        seconds = (last - first) / 1e9
        start = datetime.fromtimestamp(first / 1e9, UTC).isoformat(sep=" ", timespec="seconds")
        facts |= {"starts": start.removesuffix("+00:00") + " UTC", "seconds": round(seconds, 3)}
    facts["topics"] = {
        topic.name: {"type": topic.type, "count": topic.count}
        | ({"hz": round(topic.count / seconds, 2)} if topic.count and seconds > 0 else {})
        for topic in recording.topics.values()
    }
    scans = scan_topics(recording)
    found = survey(recording, scans, skip_bad=True)
    if recording.damage:  # known when it has been read
        facts["damage"] = [str(each) for each in recording.damage]
    frames = _frames(recording, found)
    for topic, of_topic in frames.items():
        facts["topics"][topic]["frames"] = of_topic
    facts["scans"] = {
        topic.name: _where(found, topic.name, frames[topic.name])
        for topic in scans
        if topic.name in frames
    }
    facts["poses"] = _poses(recording, found, frames)
    if late := {name: _late(found.late_ns[name]) for name in facts["scans"]}:
        facts["clock"] = late
    if not_read := _not_read(recording):
        facts["not read"] = not_read
    if doubts := _doubts(found):
        facts["doubts"] = doubts
    if facts["scans"]:
        facts["map it"] = [_command(recording, found, scans)]
    return facts


def _frames(recording: Recording, found: Survey) -> dict[str, list[str]]:
    """The frames of each topic of scans, and of the first message of each topic of poses."""
    frames: dict[str, list[str]] = {}
    for glance in found.glances:
        known = frames.setdefault(glance.topic, [])
        if glance.frame not in known:
            known.append(glance.frame)
    for topic in pose_topics(recording):
        first = next(iter(recording.messages([topic.name])), None)
        if first is not None:
            with shape_of(topic.type):
                frames[topic.name] = [first.data.header.frame_id.lstrip("/")]
    return frames


def _where(found: Survey, topic: str, frames: Sequence[str]) -> str:
    """The frame of a sensor, where it sits on what carries it, and what it states."""
    first = next(glance for glance in found.glances if glance.topic == topic)
    stated = [f"{name} {value:g}" for name, value in found.sensors[first.sensor].settings.items()]
    places = [_place(found.tree, frame) for frame in frames[:4]]
    if len(frames) > 4:
        places.append(f"in {len(frames) - 4} more frames")
    return "; ".join([*places, *([", ".join(stated)] if stated else [])])


def _place(tree: TransformTree, sensor: str) -> str:
    base = body_frame(tree, sensor)
    if base is None:
        return f"in the frame {sensor}"
    if tree.moves_between(base, sensor):
        return f"in the frame {sensor}, which moves against {base}"
    pose = Pose3(np.zeros(3), np.eye(3))
    for step in tree.path_between(base, sensor):
        pose = pose @ tree.transform(step, 0, 0)
    x, y, z = (0.0 + round(value, 3) for value in pose.translation.tolist())
    r = pose.rotation
    turned = (
        math.atan2(r[2, 1], r[2, 2]),
        math.asin(min(1.0, max(-1.0, -r[2, 0]))),
        math.atan2(r[1, 0], r[0, 0]),
    )
    angles = [0.0 + round(math.degrees(angle), 1) for angle in turned]
    way = ""
    if any(angles):
        way = f", roll {angles[0]:g}, pitch {angles[1]:g}, yaw {angles[2]:g} degrees"
    return f"in the frame {sensor}, at ({x:g}, {y:g}, {z:g}) m{way} in {base}"


def _poses(recording: Recording, found: Survey, frames: dict[str, list[str]]) -> list[str]:
    """Where the poses could come from."""
    said = [f"transforms from {frame} (--frame {frame})" for frame in _map_frames(found)]
    said += [
        f"{topic.name}, in the frame {frames[topic.name][0]} (--poses {topic.name})"
        for topic in pose_topics(recording)
        if topic.name in frames
    ]
    return said or ["none: give a file of them (--poses FILE)"]


def _map_frames(found: Survey) -> list[str]:
    """Frames that a map could be in, the likeliest first."""
    sensors = dict.fromkeys(glance.frame for glance in found.glances)
    names = dict.fromkeys(name for sensor in sensors for name in map_frames(found.tree, sensor))

    def rank(name: str) -> tuple[bool, bool]:
        # Odometry drifts, and of the others those of the bare name come first.
        return name.startswith("odom"), name not in ("map", "world")

    return sorted(names, key=rank)


def _late(late_ns: Sequence[int]) -> str:
    """How long after their stamps scans were written, at the median."""
    seconds = float(np.median(late_ns)) / 1e9
    if seconds < 0:
        return f"its stamps are {-seconds:.3f} s ahead of the time of writing"
    return f"written {seconds:.3f} s after its stamps"


def _not_read(recording: Recording) -> dict[str, str]:
    """Topics of readings that are not read from here, and what to do."""
    said = {}
    for topic in recording.topics.values():
        if topic.problem:
            said[topic.name] = topic.problem
        elif topic.name.endswith("/compressedDepth"):
            said[topic.name] = _COMPRESSED_DEPTH
        elif topic.type in _NOT_READ:
            said[topic.name] = _NOT_READ[topic.type]
    return said


def _doubts(found: Survey) -> list[str]:
    """What looks wrong."""
    said = [f"{topic}: {note}" for topic, notes in found.notes.items() for note in notes]
    said += [f"{topic}: {why}" for topic, why in found.bad.items()]
    return said + found.tree.doubts()


def _command(recording: Recording, found: Survey, topics: Sequence[Topic]) -> str:
    """A command line that maps: the first of several sensors, all of several rangers."""
    seen = {glance.topic for glance in found.glances}
    topics = [topic for topic in topics if topic.name in seen]
    rangers = [topic for topic in topics if topic.type == RANGE]
    groups = [[topic] for topic in topics if topic.type != RANGE] + ([rangers] if rangers else [])
    words = ["oddsmap", "build", recording.path]
    name = f"{Path(recording.path).stem}.zarr"
    for group in groups:
        scans = [topic.name for topic in group] if len(topics) > 1 else []
        for said, choices in _ways(recording, found, scans):
            try:
                log = log_of(recording, choices, found)
            except InputError:
                continue
            cells = "0.05" if log.ndim == 2 and "cone_deg" not in log.sensor else "0.1"
            words += [word for scan in scans for word in ("--scans", scan)]
            bad = recording.damage or any(topic.name in found.bad for topic in group)
            words += ["--skip-bad"] if bad else []
            return shlex.join([*words, *said, "--resolution", cells, "-o", name])
    words += ["--scans", topics[0].name] if len(topics) > 1 else []
    return shlex.join([*words, "--poses", "FILE", "--resolution", "0.05", "-o", name])


def _ways(
    recording: Recording, found: Survey, scans: Sequence[str]
) -> Iterator[tuple[list[str], Choices]]:
    """Options that could map, those that say least first, and the choices they stand for."""
    yield [], Choices(scans=scans, skip_bad=True)
    for frame in _map_frames(found):
        yield ["--frame", frame], Choices(scans=scans, frame=frame, skip_bad=True)
    for topic in pose_topics(recording):
        words = ["--poses", topic.name]
        yield words, Choices(scans=scans, poses=topic.name, skip_bad=True)
