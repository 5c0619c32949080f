# SPDX-License-Identifier: Apache-2.0
"""MRPT rawlogs of observations: laser scans, from where odometry or a trajectory puts the robot."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.poses.trajectory import NoPoseError, Trajectory
from oddsmap.readers.compression import TRUNCATED, Source
from oddsmap.readers.options import ReadOptions
from oddsmap.readers.pose_association import stated_poses
from oddsmap.readers.rawlog_objects import (
    LaserScan2D,
    Odometry,
    TruncatedObjectError,
    matches,
    read_objects,
)
from oddsmap.scans.memory_log import LoadedLog
from oddsmap.scans.note import Note, bad_scans
from oddsmap.scans.scan import Scan

__all__ = ["matches", "open_rawlog"]

# Odometry often comes at 10 Hz.
_TOLERANCE_S = 0.1
# A laser whose plane leans by more than this sees other walls than a map of the plane has.
_FLAT = math.cos(math.radians(3.0))


def open_rawlog(source: Source, options: ReadOptions) -> LoadedLog:
    """Read a rawlog.

    Raises:
        InputError: an object in it is not known, or there is no scan or no pose.
    """
    path = source.path
    options.refuse(path, "a rawlog", "times", "body_from_sensor", "camera", "points_in", "origin")
    options.refuse(path, "a rawlog", "columns", "depth_scale", "deskew")
    skipped, notes = source.initial_skipped(), source.initial_notes()
    lasers, steps = _sort(source, options, skipped, notes)
    if not lasers:
        raise InputError(f"{path}: no laser scan (CObservation2DRangeScan) in this rawlog")
    body = _body(path, steps, options, notes)
    flat = all(_lies_flat(laser.body_from_sensor) for laser in lasers)
    tolerance_s = _TOLERANCE_S if options.tolerance_s is None else options.tolerance_s
    scans, first = [], ""
    for laser in lasers:
        try:
            scans.append(_scan(laser, body, round(tolerance_s * 1e9), flat))
        except NoPoseError as error:
            skipped["scan.no_pose"] += 1
            first = first or str(error)
    if not scans:
        raise InputError(f"{path}: no scan has a pose: {first}")
    if first:
        notes.append(bad_scans(skipped["scan.no_pose"], first))
    if not flat:
        notes.append(Note("the laser leans: it is mapped in 3D", code="laser.leans"))
    return LoadedLog(
        path=path,
        format="MRPT rawlog",
        sensor={"range_max": max(laser.range_max for laser in lasers)},
        skipped=skipped,
        notes=tuple(notes),
        scans=tuple(scans),
    )


def _sort(
    source: Source, options: ReadOptions, skipped: Counter[str], notes: list[Note]
) -> tuple[list[LaserScan2D], list[Odometry]]:
    """Scans and odometry, of a damaged file those before the damage."""
    lasers: list[LaserScan2D] = []
    steps: list[Odometry] = []
    try:
        for found in read_objects(source.path, source.content):
            if isinstance(found, LaserScan2D):
                lasers.append(found)
            else:
                steps.append(found)
    except TruncatedObjectError as error:
        if not options.skip_bad:
            raise
        if not skipped[TRUNCATED]:
            skipped[TRUNCATED] += 1
            notes.append(Note(str(error), code=TRUNCATED, severity="warning"))
    return lasers, steps


def _body(
    path: str, steps: Sequence[Odometry], options: ReadOptions, notes: list[Note]
) -> Trajectory:
    """Where the robot was: as the caller says, or by its odometry."""
    if options.poses is not None:
        file = stated_poses(options.poses, options)
        notes.extend(file.notes)
        return file.trajectory
    stamped = [step for step in steps if step.stamp_ns is not None]
    if not stamped:
        raise InputError(
            f"{path}: no odometry with a time in this rawlog: give poses with --poses FILE (poses=)"
        )
    text = "poses are odometry, which drifts: walls may be doubled; --poses FILE gives others"
    notes.append(Note(text, code="pose.odometry", severity="warning"))
    turns = np.zeros((len(stamped), 3, 3))
    headings = np.array([step.theta for step in stamped])
    turns[:, 0, 0] = turns[:, 1, 1] = np.cos(headings)
    turns[:, 1, 0] = np.sin(headings)
    turns[:, 0, 1] = -turns[:, 1, 0]
    turns[:, 2, 2] = 1.0
    places = np.array([[step.x, step.y, 0.0] for step in stamped])
    stamps = np.array([step.stamp_ns for step in stamped], np.int64)
    return Trajectory(places, turns, stamps, path=f"{path} (odometry)")


def _lies_flat(pose: Pose3) -> bool:
    return bool(abs(pose.rotation[2, 2]) >= _FLAT)


def _scan(laser: LaserScan2D, body: Trajectory, tolerance_ns: int, flat: bool) -> Scan:
    """A laser's scan from where it was: in the plane, upside down too, or in space."""
    if laser.stamp_ns is None:
        raise NoPoseError("a scan has no time")
    pose = body.at(laser.stamp_ns, tolerance_ns) @ laser.body_from_sensor
    c, s = np.cos(laser.angles), np.sin(laser.angles)
    if not flat:
        directions = np.stack([c, s, np.zeros(len(c))], axis=1)
        return Scan(pose, directions, laser.ranges, laser.stamp_ns, trusted=True)
    x, y, _ = pose.translation.tolist()
    heading = math.atan2(pose.rotation[1, 0], pose.rotation[0, 0])
    upright = 1.0 if pose.rotation[2, 2] > 0.0 else -1.0
    directions = np.stack([c, upright * s], axis=1)
    return Scan(Pose2(x, y, heading), directions, laser.ranges, laser.stamp_ns, trusted=True)
