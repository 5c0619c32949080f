# SPDX-License-Identifier: Apache-2.0
"""Where the poses of a recording come from: the caller's word, transforms, or a topic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3, quaternion_xyzw
from oddsmap.poses.trajectory import Trajectory
from oddsmap.recordings.choice import body_frame, choose_frame, pose_topics
from oddsmap.recordings.poses import BodyPoses, SensorPoses, TransformPoses, read_pose_topic
from oddsmap.recordings.recording import Recording
from oddsmap.recordings.survey import Glance
from oddsmap.recordings.transforms import TransformTree
from oddsmap.scans.note import Note

__all__ = ["PoseChoices", "choose_poses"]


@dataclass(frozen=True, slots=True)
class PoseChoices:
    """What the caller says of poses, see `Choices`."""

    poses: str | Trajectory | None
    frame: str | None
    body_from_sensor: Pose3 | None
    tolerance_ns: int


def choose_poses(
    recording: Recording, tree: TransformTree, glances: Sequence[Glance], choices: PoseChoices
) -> tuple[SensorPoses, list[Note]]:
    """Where the sensors were, as the caller says, or by what there is; and what to know of it.

    Args:
        recording: where topics of poses are.
        tree: its transforms.
        glances: at the scans to map.
        choices: what the caller says.

    Raises:
        InputError: there are no poses, or it is not clear which.
    """
    stated, mounted, tolerance = choices.poses, choices.body_from_sensor, choices.tolerance_ns
    notes: list[Note] = []
    sensors = {glance.frame: glance.shape for glance in glances}
    sensor = glances[0].frame
    if mounted is not None and len(sensors) > 1:
        raise InputError(
            f"{recording.path}: one `body_from_sensor`, and scans in the frames "
            f"{' and '.join(sorted(sensors)[:4])}: map them one by one (--scans, scans=)"
        )
    if choices.frame is not None and stated not in (None, "tf"):
        raise InputError(
            f"{recording.path}: the poses are given, and in one frame: leave `frame` out, or say "
            "--poses tf (poses=)"
        )
    if isinstance(stated, Trajectory):
        return _poses_of_file(stated, tree, sensors, choices, notes), notes
    if stated in (None, "tf") and not (in_map := [name for name in sensors if _is_of_map(name)]):
        frame = choose_frame(tree, sensor, choices.frame)
        if frame is not None:
            if mounted is not None:
                raise InputError(
                    f"{recording.path}: the transforms say where {sensor!r} sits: leave "
                    "`body_from_sensor` out, or give the poses of its body with --poses (poses=)"
                )
            if frame.rsplit("/", 1)[-1].startswith("odom"):
                text = f"the map is in the frame {frame}: poses are odometry, which drifts"
                notes.append(Note(text, code="pose.odometry", severity="warning"))
            return TransformPoses(tree, frame, tolerance), notes
        if stated == "tf":
            raise InputError(
                f"{recording.path}: no transform that moves leads to {sensor!r}"
                f"{_nearly(tree, sensor)}: give poses with --poses TOPIC or FILE (poses=)"
            )
    elif stated == "tf":
        raise InputError(
            f"{recording.path}: the scans are in the frame {in_map[0]}, that of a map, and "
            "transforms do not say which frame their rays start in: give the poses of the sensor "
            "with --poses TOPIC or FILE (poses=)"
        )
    topic = _only_pose_topic(recording, tree, sensor, stated)
    trajectory, frame, body = read_pose_topic(recording, topic)
    notes.append(Note(f"poses are those of {topic}", code="pose.topic"))
    for name, shape in sensors.items():
        if name == frame:
            notes.append(_in_the_map(name, shape))
        elif _is_of_map(name):
            raise InputError(
                f"{recording.path}: the scans are in the frame {name}, that of a map, and the "
                f"poses of {topic} are in {frame}: give poses in {name} with --poses (poses=)"
            )
        elif mounted is None and name not in tree.reachable(body or ""):
            text = f"nothing says where {name!r} sits on the robot: it is taken to be at its "
            text += "origin; --body-from-sensor says where"
            if (known := _fixed_on_body(tree, name)) is not None:
                text += (
                    f" ({known[1]!r}, as transforms put it, if the poses are those of {known[0]})"
                )
            notes.append(Note(text, code="extrinsics.missing", severity="warning"))
    return BodyPoses(trajectory, tree, body, mounted, tolerance, frame), notes


def _poses_of_file(
    stated: Trajectory,
    tree: TransformTree,
    sensors: Mapping[str, str],
    choices: PoseChoices,
    notes: list[Note],
) -> BodyPoses:
    """Poses that do not say which frames they take into which: the sensor's own into the map's."""
    mounted = choices.body_from_sensor
    if len(sensors) > 1:
        body = body_frame(tree, next(iter(sensors)))
        if body is None or not tree.reachable(body).issuperset(sensors):
            raise InputError(
                f"{tree.path}: scans in the frames {' and '.join(sorted(sensors)[:4])}, poses of "
                "one, and no transforms between them: map them one by one, each with its "
                "--body-from-sensor (body_from_sensor=)"
            )
        notes.append(Note(f"the poses are taken as those of {body}", code="pose.body"))
        return BodyPoses(stated, tree, body, None, choices.tolerance_ns)
    frame = next((name for name in sensors if _is_of_map(name)), None)
    for name, shape in sensors.items():
        if name == frame:
            notes.append(_in_the_map(name, shape))
        elif mounted is None and (known := _fixed_on_body(tree, name)) is not None:
            text = f"the poses are taken as those of {name}; if they are those of {known[0]}, say "
            text += f"--body-from-sensor {known[1]!r}, which is where transforms put it"
            notes.append(Note(text, code="extrinsics.unused", severity="warning"))
    return BodyPoses(stated, tree, None, mounted, choices.tolerance_ns, frame)


def _fixed_on_body(tree: TransformTree, sensor: str) -> tuple[str, str] | None:
    """The frame of the body and where transforms put a sensor on it, as the command line takes it.

    None where they do not say, where it moves, or where it is the same place.
    """
    body = body_frame(tree, sensor)
    if body is None or tree.moves_between(body, sensor):
        return None
    pose = TransformPoses(tree, body, 0).at(sensor, 0)
    if (pose.translation == 0.0).all() and (pose.rotation == np.eye(3)).all():
        return None
    numbers = [*pose.translation, *quaternion_xyzw(pose.rotation)]
    return body, " ".join(f"{0.0 + round(float(number), 6):g}" for number in numbers)


def _is_of_map(frame: str) -> bool:
    """Whether a frame is one that maps are in, not sensors."""
    return frame in ("map", "world", "odom")


def _in_the_map(frame: str, shape: str) -> Note:
    if shape == "cloud":
        text = f"the points are in the frame of the map, {frame}: rays start at the poses"
        return Note(text, code="cloud.in_map", severity="warning")
    text = f"the scans say that they are in {frame}, the frame of the map, which cannot be: they "
    text += "are taken from the poses, as if the sensor were at the body's origin"
    return Note(text, code="laser.in_map", severity="warning")


def _nearly(tree: TransformTree, sensor: str) -> str:
    """A remark where transforms know the body of a camera, and not its optical frame."""
    words = sensor.split("_optical")[0]
    frames = sorted({frame for link in tree.links for frame in link})
    close = [frame for frame in frames if frame in (words, f"{words}_frame", f"{words}_link")]
    if "_optical" not in sensor or sensor in frames or not close:
        return ""
    return (
        f" (only to {close[0]!r}, which is not the optical frame; the recording lacks the "
        "transform between the two)"
    )


def _only_pose_topic(
    recording: Recording, tree: TransformTree, sensor: str, stated: str | None
) -> str:
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
            f"{recording.path}: no transforms lead to {sensor!r}{_nearly(tree, sensor)}, "
            f"and {there}: give poses with --poses TOPIC or FILE (poses=)"
        )
    return names[0]
