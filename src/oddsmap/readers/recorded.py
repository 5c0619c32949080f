# SPDX-License-Identifier: Apache-2.0
"""Recordings as logs: bags of ROS 1, SQLite and MCAP files, folders of ROS 2."""

from __future__ import annotations

import os
from pathlib import Path

from oddsmap.errors import InputError
from oddsmap.poses.trajectory import Trajectory
from oddsmap.readers.options import ReadOptions
from oddsmap.readers.pose_file import read_pose_file
from oddsmap.recordings.open_recording import Choices, log_of
from oddsmap.recordings.recorded_log import RecordedLog
from oddsmap.recordings.recording import Recording
from oddsmap.recordings.recording_files import is_recording_folder
from oddsmap.recordings.ros_recording import is_ros_recording, open_ros_recording

__all__ = ["is_recording", "open_recorded"]

_TOLERANCE_S = 0.1
"""Transforms and odometry often come at 10 to 50 Hz."""


def is_recording(name: str) -> bool:
    """Whether a file or a folder is a recording, by how it starts, or what is in it."""
    path = Path(name)
    try:
        if path.is_dir():
            return is_recording_folder(path)
        with path.open("rb") as file:
            return is_ros_recording(file.read(16))
    except OSError:
        return False  # said by whoever reads it


def open_recorded(name: str, options: ReadOptions) -> RecordedLog:
    """Open a recording as a log.

    Raises:
        InputError: it cannot be read, or what is to be mapped is not clear.
    """
    options.refuse(name, "a recording", "times", "points_in", "origin", "columns")
    recording = open_ros_recording(name, skip_bad=options.skip_bad)
    tolerance = _TOLERANCE_S if options.tolerance_s is None else options.tolerance_s
    choices = Choices(
        scans=options.scans,
        poses=_poses(recording, options),
        frame=options.frame,
        body_from_sensor=options.body_from_sensor,
        tolerance_ns=round(tolerance * 1e9),
        clock_offset_ns=round(options.clock_offset_s * 1e9),
        skip_bad=options.skip_bad,
        camera=options.camera,
        units_per_metre=options.depth_scale,
        deskew=options.deskew,
    )
    return log_of(recording, choices)


def _poses(recording: Recording, options: ReadOptions) -> str | Trajectory | None:
    """A topic, transforms, or the poses of a file."""
    stated = options.poses
    if stated is None or isinstance(stated, Trajectory):
        return stated
    name = os.fspath(stated)
    if name == "tf" or name in recording.topics:
        return name
    if not Path(name).exists():
        topics = ", ".join(recording.topics)[:200]
        raise InputError(
            f"{recording.path}: {name} is neither a file of poses nor a topic: it has {topics}"
        )
    return read_pose_file(name).trajectory
