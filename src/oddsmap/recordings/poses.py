# SPDX-License-Identifier: Apache-2.0
"""Where the sensor of a recording was: by its transforms, by a topic of poses, or by a file."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from oddsmap.array_types import IntArray
from oddsmap.errors import InputError
from oddsmap.poses.at_times import PoseArray, PoseTrack
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import NoPoseError, Trajectory, format_seconds
from oddsmap.recordings.recording import Message, Recording, shape_of, stamp_of
from oddsmap.recordings.transforms import TransformTree

__all__ = [
    "POSE_TYPES",
    "TF_TYPES",
    "BodyPoses",
    "SensorPoses",
    "TransformPoses",
    "add_transforms",
    "read_pose_topic",
]

TF_TYPES = ("tf/tfMessage", "tf2_msgs/TFMessage")
POSE_TYPES = (
    "nav_msgs/Odometry",
    "geometry_msgs/PoseStamped",
    "geometry_msgs/PoseWithCovarianceStamped",
)


class SensorPoses(Protocol):
    """Where a sensor was."""

    @property
    def frame(self) -> str | None:
        """The frame of the map, where it has a name."""

    def at(self, frame: str, stamp_ns: int) -> Pose3:
        """map_from_sensor at a time.

        Raises:
            NoPoseError: it is not known.
        """

    def at_times(self, frame: str, times_ns: IntArray) -> PoseArray:
        """map_from_sensor at the times of beams [ns], shape (n,), where it is known."""

    def spacing_ns(self, frame: str) -> float:
        """The time from one pose to the next [ns]; 0 where the sensor never moves."""


# A beam may be this far from the nearest pose also where a scan may not [ns]: poses that come ten
# times a second, one for each scan, are the rarest that a scan is deskewed by.
_BEAM_TOLERANCE_NS = 100_000_000


@dataclass(frozen=True, slots=True, eq=False)
class TransformPoses:
    """By the transforms from a frame to that of the sensor."""

    tree: TransformTree
    frame: str
    tolerance_ns: int

    def at(self, frame: str, stamp_ns: int) -> Pose3:
        """map_from_sensor at a time."""
        pose = Pose3(np.zeros(3), np.eye(3))
        for step in self.tree.path_between(self.frame, frame):
            pose = pose @ self.tree.transform(step, stamp_ns, self.tolerance_ns)
        return pose

    def at_times(self, frame: str, times_ns: IntArray) -> PoseArray:
        """map_from_sensor at the times of beams."""
        poses = PoseArray.fixed(Pose3(np.zeros(3), np.eye(3)), len(times_ns))
        tolerance = max(self.tolerance_ns, _BEAM_TOLERANCE_NS)
        for step in self.tree.path_between(self.frame, frame):
            poses = poses @ self.tree.transforms(step, times_ns, tolerance)
        return poses

    def spacing_ns(self, frame: str) -> float:
        """The time between the rarest of the transforms [ns]."""
        return self.tree.spacing_ns(self.frame, frame)


@dataclass(frozen=True, slots=True, eq=False)
class BodyPoses:
    """By poses of the body that carries the sensor.

    Args:
        trajectory: map_from_body.
        tree: transforms from the body to the sensor, where there are any.
        body: the frame of the body; None where it is not stated.
        body_from_sensor: where the sensor sits, where the caller says so.
        frame: the frame that the poses are in; None where it is not stated.
    """

    trajectory: Trajectory
    tree: TransformTree
    body: str | None
    body_from_sensor: Pose3 | None
    tolerance_ns: int
    frame: str | None = None
    _track: PoseTrack | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.trajectory.stamps_ns is not None:
            object.__setattr__(self, "_track", PoseTrack(self.trajectory))

    def at(self, frame: str, stamp_ns: int) -> Pose3:
        """map_from_sensor at a time."""
        stamps = self.trajectory.stamps_ns
        if stamps is None:
            raise InputError(
                f"{self.trajectory.path}: the poses of a recording are found by their stamps, and "
                "these have none: give them in TUM's format"
            )
        first, last = int(stamps.min()), int(stamps.max())
        if not first <= stamp_ns <= last:
            raise NoPoseError(
                f"{self.trajectory.path}: no pose at {format_seconds(stamp_ns)} s, only from "
                f"{format_seconds(first)} to {format_seconds(last)} s"
            )
        pose = self.trajectory.at(stamp_ns, self.tolerance_ns)
        if self.body_from_sensor is not None:
            return pose @ self.body_from_sensor
        mounted = self._mounted(frame)
        return pose if mounted is None else pose @ mounted.at(frame, stamp_ns)

    def at_times(self, frame: str, times_ns: IntArray) -> PoseArray:
        """map_from_sensor at the times of beams."""
        if self._track is None:
            return PoseArray(np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros(0, np.bool_))
        poses = self._track.at(times_ns, max(self.tolerance_ns, _BEAM_TOLERANCE_NS))
        if self.body_from_sensor is not None:
            return poses @ PoseArray.fixed(self.body_from_sensor, len(times_ns))
        mounted = self._mounted(frame)
        return poses if mounted is None else poses @ mounted.at_times(frame, times_ns)

    def spacing_ns(self, frame: str) -> float:
        """The time from one pose to the next, or between transforms on the body [ns]."""
        mounted = None if self.body_from_sensor is not None else self._mounted(frame)
        own = np.inf if self._track is None else self._track.spacing_ns
        return own if mounted is None else max(own, mounted.spacing_ns(frame))

    def _mounted(self, frame: str) -> TransformPoses | None:
        """Where transforms put the sensor on the body; None where there are none."""
        # What is in the frame of the map itself was seen from the body.
        if self.body is None or frame == self.frame or frame not in self.tree.reachable(self.body):
            return None
        return TransformPoses(self.tree, self.body, self.tolerance_ns)


def add_transforms(tree: TransformTree, message: Message) -> None:
    """Take what a message of transforms says.

    Raises:
        InputError: it makes no sense.
    """
    try:
        with shape_of("message of transforms"):
            _add_transforms(tree, message)
    except InputError as error:
        raise InputError(f"{tree.path}: {message.topic}: {error}") from None


def _add_transforms(tree: TransformTree, message: Message) -> None:
    fixed = message.topic.rsplit("/", 1)[-1] == "tf_static"
    for each in message.data.transforms:
        move, turn = each.transform.translation, each.transform.rotation
        tree.add(
            each.header.frame_id,
            each.child_frame_id,
            stamp_of(each.header),
            (float(move.x), float(move.y), float(move.z)),
            (float(turn.x), float(turn.y), float(turn.z), float(turn.w)),
            fixed=fixed,
        )


def read_pose_topic(recording: Recording, topic: str) -> tuple[Trajectory, str | None, str | None]:
    """The poses of a topic, the frame that they are in, and that of the body, where it is stated.

    Raises:
        InputError: there are none.
    """
    stamps, poses, frame, body = [], [], None, None
    for message in recording.messages([topic]):
        try:
            with shape_of("pose"):
                frame = message.data.header.frame_id.lstrip("/") or frame
                body = getattr(message.data, "child_frame_id", "").lstrip("/") or body
                stamps.append(stamp_of(message.data.header))
                poses.append(_pose_of(message))
        except InputError as error:
            raise InputError(f"{recording.path}: {message.topic}: {error}") from None
    if not poses:
        raise InputError(f"{recording.path}: {topic} has no poses")
    trajectory = Trajectory(
        np.array([pose.translation for pose in poses]),
        np.array([pose.rotation for pose in poses]),
        np.array(stamps, np.int64),
        path=f"{recording.path}: {topic}",
    )
    return trajectory, frame, body


def _pose_of(message: Message) -> Pose3:
    pose: Any = message.data.pose
    pose = getattr(pose, "pose", pose)  # with its covariance around it
    p, q = pose.position, pose.orientation
    return Pose3.from_quaternion_xyzw((p.x, p.y, p.z), (q.x, q.y, q.z, q.w))
