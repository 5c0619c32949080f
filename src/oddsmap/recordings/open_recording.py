# SPDX-License-Identifier: Apache-2.0
"""From a recording and what the caller says to a log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import NoPoseError, Trajectory
from oddsmap.recordings.choice import choose_scans
from oddsmap.recordings.level import lies_flat
from oddsmap.recordings.pose_choice import PoseChoices, choose_poses
from oddsmap.recordings.poses import SensorPoses, TransformPoses
from oddsmap.recordings.recorded_log import RecordedLog
from oddsmap.recordings.recording import Recording
from oddsmap.recordings.survey import Glance, Survey, cameras_of, doubts_of_clocks, said_of, survey
from oddsmap.scans.beam_timing import choose_deskew
from oddsmap.scans.depth_image import PinholeCamera
from oddsmap.scans.note import Note

__all__ = ["Choices", "log_of"]

# The z axis of a body frame stays within 25 degrees of upright, the way a camera looks does not.
_UPRIGHT = 0.9


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
        camera: the intrinsics of depth images; by default those in the recording.
        units_per_metre: of depth images of whole numbers; by default they are millimetres.
        deskew: take beams at their own times; None: where times and poses allow it.
    """

    scans: Sequence[str] = ()
    poses: str | Trajectory | None = None
    frame: str | None = None
    body_from_sensor: Pose3 | None = None
    tolerance_ns: int = 100_000_000
    clock_offset_ns: int = 0
    skip_bad: bool = False
    camera: PinholeCamera | None = None
    units_per_metre: float | None = None
    deskew: bool | None = None


def log_of(recording: Recording, choices: Choices, found: Survey | None = None) -> RecordedLog:
    """The scans of a recording with their poses.

    Args:
        recording: where they are.
        choices: what the caller says.
        found: what has been seen of the recording, where it has been looked at already.

    Raises:
        InputError: there is no choice, or more than one; or no scan has a pose.
    """
    topics = choose_scans(recording, choices.scans)
    if found is None:
        found = survey(
            recording,
            topics,
            units_per_metre=choices.units_per_metre,
            skip_bad=choices.skip_bad,
            clock_offset_ns=choices.clock_offset_ns,
        )
    found = found.only(topics)
    if not found.glances:
        names = ", ".join(topic.name for topic in topics)
        why = next((f": {found.bad[t.name]}" for t in topics if t.name in found.bad), "")
        raise InputError(f"{recording.path}: no scan on {names}{why}")
    _check_kinds(recording.path, found, choices)
    cameras, notes = cameras_of(recording.path, found, choices.camera)
    for topic in topics:
        notes += [said_of(topic.name, note) for note in found.notes.get(topic.name, ())]
    glances = found.glances
    where: SensorPoses
    if choices.poses is None and choices.frame is None and _have_poses(glances):
        frame = glances[0].frame
        notes.append(Note(f"the scans have their poses in the frame {frame}", code="pose.own"))
        where = TransformPoses(found.tree, frame, choices.tolerance_ns)
    else:
        said = PoseChoices(
            choices.poses, choices.frame, choices.body_from_sensor, choices.tolerance_ns
        )
        where, of_poses = choose_poses(recording, found.tree, glances, said)
        notes += of_poses
    seen: list[tuple[Glance, Pose3]] = []
    missing: NoPoseError | None = None
    for glance in glances:
        try:
            pose = where.at(glance.frame, glance.stamp_ns + choices.clock_offset_ns)
            pose = pose @ glance.frame_from_sensor if glance.frame_from_sensor else pose
        except NoPoseError as error:
            missing = missing or error
        else:
            seen.append((glance, pose))
    if not seen:
        raise InputError(f"{recording.path}: no scan has a pose: {missing}")
    notes += [
        Note(text, code="transform.conflict", severity="warning") for text in found.tree.doubts()
    ]
    if isinstance(where, TransformPoses) and not choices.clock_offset_ns:
        notes += doubts_of_clocks(found)
    flat = all(lies_flat(glance.shape, pose) for glance, pose in seen)
    shapes = {glance.shape for glance in glances}
    if not flat and shapes <= {"fan", "cone"}:
        which = "laser leans" if "fan" in shapes else "sensor points up or down"
        notes.append(Note(f"the {which}: it is mapped in 3D", code="laser.leans"))
    _note_optical(seen, notes)
    spacing = max(where.spacing_ns(frame) for frame in {glance.frame for glance in glances})
    timings = list(found.timings.values())
    deskews, of_times = choose_deskew(recording.path, choices.deskew, timings, spacing)
    notes.extend(of_times)
    return RecordedLog(
        recording=recording,
        topics=topics,
        sensor_poses=where,
        ndim=2 if flat else 3,
        sensors=found.sensors,
        cameras=cameras,
        units_per_metre=choices.units_per_metre,
        opening_notes=tuple(notes),
        clock_offset_ns=choices.clock_offset_ns,
        skip_bad=choices.skip_bad,
        deskews=deskews,
        places=found.places,
    )


def _have_poses(glances: Sequence[Glance]) -> bool:
    """Whether each scan has a pose of its own in one frame, and these change: it is the map's."""
    own = [glance.frame_from_sensor for glance in glances]
    # At the origin it is the same as none.
    places = {(0.0, 0.0, 0.0) if pose is None else tuple(pose.translation) for pose in own}
    return len(places) > 1 and len({glance.frame for glance in glances}) == 1


def _check_kinds(path: str, found: Survey, choices: Choices) -> None:
    """Refuse what does not make one map, and what is stated of no use."""
    cones = [name for name, info in found.sensors.items() if "cone_deg" in info.settings]
    if cones and len(cones) < len(found.sensors):
        rays = next(name for name in found.sensors if name not in cones)
        raise InputError(
            f"{path}: {cones[0]} has wide beams, {rays} has not, and one map takes one kind: map "
            "them one by one (--scans TOPIC, scans=)"
        )
    for name, stated in (("camera", choices.camera), ("depth_scale", choices.units_per_metre)):
        if stated is not None and not found.images:
            raise InputError(
                f"{path}: what is mapped holds no depth images: leave `{name}` out for this log"
            )


def _note_optical(seen: Sequence[tuple[Glance, Pose3]], notes: list[Note]) -> None:
    """A doubt where images are in a frame that is not called optical."""
    for topic in dict.fromkeys(glance.topic for glance, _ in seen if glance.shape == "image"):
        own = [(glance.frame, pose) for glance, pose in seen if glance.topic == topic]
        frame = own[0][0]
        if "optical" in frame:
            continue
        text = f"{topic} is in the frame {frame}, which is not called optical: its z axis is taken "
        text += "as the way the camera looks"
        if all(pose.rotation[2, 2] > _UPRIGHT for _, pose in own):
            text += ", and it points up in the map: is that the frame of the camera's body?"
        notes.append(Note(text, code="camera.not_optical", severity="warning"))
