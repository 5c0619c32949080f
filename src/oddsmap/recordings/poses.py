# SPDX-License-Identifier: Apache-2.0
"""Where the sensor of a recording was: by its transforms, by a topic of poses, or by a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from oddsmap.errors import InputError
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


@dataclass(frozen=True, slots=True, eq=False)
class TransformPoses:
    """By the transforms from a frame to that of the sensor."""

    tree: TransformTree
    frame: str
    tolerance_ns: int

    def at(self, frame: str, stamp_ns: int) -> Pose3:
        """map_from_sensor at a time."""
        pose = Pose3(np.eye(3), np.zeros(3))
        for step in self.tree.path_between(self.frame, frame):
            pose = pose @ self.tree.transform(step, stamp_ns, self.tolerance_ns)
        return pose


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
        # What is in the frame of the map itself was seen from the body.
        if self.body is None or frame == self.frame or frame not in self.tree.reachable(self.body):
            return pose
        return pose @ TransformPoses(self.tree, self.body, self.tolerance_ns).at(frame, stamp_ns)


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
