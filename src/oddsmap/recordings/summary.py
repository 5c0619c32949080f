# SPDX-License-Identifier: Apache-2.0
"""What is in a recording, in words, and the command that would map it."""

from __future__ import annotations

import shlex
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from oddsmap.recordings.beams import SCAN_TYPES, beams_of
from oddsmap.recordings.choice import map_frames, pose_topics, scan_topics
from oddsmap.recordings.poses import TF_TYPES, add_transforms
from oddsmap.recordings.recording import Recording, shape_of
from oddsmap.recordings.transforms import TransformTree

__all__ = ["describe"]

# Kinds of messages that hold readings which are not read from here, and what to do.
_NOT_READ = {
    "sensor_msgs/PointCloud": "convert it to PointCloud2",
    "sensor_msgs/CompressedImage": "it has no depth",
    "draco_point_cloud_transport_msgs/CompressedPointCloud2": "decompress it to PointCloud2",
    "point_cloud_interfaces/CompressedPointCloud2": "decompress it to PointCloud2",
    "ouster_ros/PacketMsg": "raw packets: convert them to PointCloud2 with the vendor's driver",
    "velodyne_msgs/VelodyneScan": "raw packets: convert them to PointCloud2 with the driver",
}


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
    tree, frames = _frames_of(recording)
    if recording.damage:  # known when it has been read
        facts["damage"] = [str(each) for each in recording.damage]
    scans = scan_topics(recording)
    facts["scans"] = {
        topic.name: _where(tree, frames[topic.name]) for topic in scans if topic.name in frames
    }
    facts["poses"] = _poses(recording, tree, frames)
    if not_read := {
        topic.name: topic.problem or _NOT_READ[topic.type]
        for topic in recording.topics.values()
        if topic.problem or topic.type in _NOT_READ
    }:
        facts["not read"] = not_read
    if facts["scans"]:
        facts["map it"] = [_command(recording, tree, frames)]
    return facts


def _frames_of(recording: Recording) -> tuple[TransformTree, dict[str, str]]:
    """The transforms, and the frame of each topic of scans or poses."""
    tree = TransformTree(recording.path)
    kinds = {topic.name: topic.type for topic in recording.topics.values()}
    wanted = [topic.name for topic in (*scan_topics(recording), *pose_topics(recording))]
    moves = [name for name, kind in kinds.items() if kind in TF_TYPES]
    frames: dict[str, str] = {}
    for message in recording.messages([*wanted, *moves]):
        name = message.topic
        if kinds[name] in TF_TYPES:
            add_transforms(tree, message)
        elif name in frames:
            continue
        elif kinds[name] in SCAN_TYPES:
            frames[name] = beams_of(kinds[name], message.data).frame
        else:
            with shape_of(kinds[name]):
                frames[name] = message.data.header.frame_id.lstrip("/")
    return tree, frames


def _where(tree: TransformTree, sensor: str) -> str:
    """The frame of a sensor, and where transforms put it on what carries it."""
    fixed = [
        frame
        for frame in sorted(tree.reachable(sensor) - {sensor})
        if not tree.moves_between(frame, sensor) and frame.rsplit("/", 1)[-1].startswith("base")
    ]
    if not fixed:
        return f"in the frame {sensor}"
    x = y = z = 0.0
    pose = None
    for step in tree.path_between(fixed[0], sensor):
        found = tree.transform(step, 0, 0)
        pose = found if pose is None else pose @ found
    if pose is not None:
        x, y, z = pose.translation.tolist()
    return f"in the frame {sensor}, at ({x:.3g}, {y:.3g}, {z:.3g}) m in {fixed[0]}"


def _poses(recording: Recording, tree: TransformTree, frames: dict[str, str]) -> list[str]:
    """Where the poses could come from."""
    sensors = [frames[topic.name] for topic in scan_topics(recording) if topic.name in frames]
    candidates = dict.fromkeys(name for sensor in sensors for name in map_frames(tree, sensor))
    found = [f"transforms from {frame} (--frame {frame})" for frame in candidates]
    found += [
        f"{topic.name}, in the frame {frames[topic.name]} (--poses {topic.name})"
        for topic in pose_topics(recording)
        if topic.name in frames
    ]
    return found or ["none: give a file of them (--poses FILE)"]


def _command(recording: Recording, tree: TransformTree, frames: dict[str, str]) -> str:
    """The command line that maps the first sensor."""
    topics = [topic for topic in scan_topics(recording) if topic.name in frames]
    stem = Path(recording.path).stem
    words = ["oddsmap", "build", recording.path]
    if len(topics) > 1:
        words += ["--scans", topics[0].name]
    candidates = map_frames(tree, frames[topics[0].name])
    names = [topic.name for topic in pose_topics(recording)]
    if len(candidates) > 1:
        best = next((name for name in ("map", "world", "odom") if name in candidates), None)
        words += ["--frame", best or candidates[0]]
    elif not candidates:
        words += ["--poses", names[0]] if len(names) > 1 else [] if names else ["--poses", "FILE"]
    if recording.damage:
        words.append("--skip-bad")
    return shlex.join([*words, "--resolution", "0.05", "-o", f"{stem}.zarr"])
