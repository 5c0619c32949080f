# SPDX-License-Identifier: Apache-2.0
"""Whether scans and poses use one clock: poses are tried at other times than those of the scans."""

from __future__ import annotations

import math

import numpy as np

from oddsmap.doctor.examined import Examined
from oddsmap.doctor.prediction import Placed
from oddsmap.doctor.trial import Alternative, Court, Verdict
from oddsmap.plausibility.sample import Glance
from oddsmap.poses.pose import Pose, Pose2, Pose3
from oddsmap.poses.trajectory import Trajectory

__all__ = ["find_clock_offset", "in_plane", "in_space"]

# Offsets that are tried first, in both directions [s].
_OFFSETS = (0.03, 0.1, 0.2, 0.4, 0.8, 1.6)
# Poses must come so often for a path between them [s].
_SPACING = 1.5
# Steps around the best of them, in its own size.
_STEPS = (0.3, 0.15, 0.08, 0.04)


def find_clock_offset(seen: Examined, court: Court) -> Verdict | None:
    """The offset that is to be added to the stamps of scans, if one fits clearly better."""
    track = _track(seen)
    if track is None or track.stamps_ns is None:
        return None
    span = int(track.stamps_ns[0]), int(track.stamps_ns[-1])

    few = court.few()
    now = few.try_out(court.current).now

    def gained(offset: float) -> float:
        return few.try_out(_shifted(track, span, offset, seen.ndim)).then

    found = {offset: gained(offset) for size in _OFFSETS for offset in (-size, size)}
    best = max(found, key=lambda offset: found[offset])
    if found[best] <= now:
        return None
    for step in _STEPS:
        for offset in (best * (1.0 - step), best * (1.0 + step)):
            found[offset] = gained(offset)
        best = max(found, key=lambda offset: found[offset])
    verdict = court.try_out(_shifted(track, span, best, seen.ndim))
    return verdict if verdict.is_sure else None


def _track(seen: Examined) -> Trajectory | None:
    """All poses over time; None where they have no time, or are too rare."""
    rows = {
        stamp: pose
        for stamp, pose in zip(seen.stamps, seen.poses, strict=True)
        if stamp is not None and pose.is_finite
    }
    stamps = np.array(sorted(rows), np.int64)
    if len(stamps) < 10 or float(np.median(np.diff(stamps))) > _SPACING * 1e9:
        return None
    poses = [in_space(rows[stamp]) for stamp in stamps.tolist()]
    return Trajectory(
        np.array([pose.translation for pose in poses]),
        np.array([pose.rotation for pose in poses]),
        stamps,
    )


def _shifted(track: Trajectory, span: tuple[int, int], offset: float, d: int) -> Alternative:
    first, last = span

    def place(glance: Glance) -> Placed:
        if glance.stamp_ns is None:
            return Placed(glance.pose, glance.points)
        then = min(max(glance.stamp_ns + round(offset * 1e9), first), last)
        pose = track.at(then, last - first)
        return Placed(in_plane(pose) if d == 2 else pose, glance.points)

    return Alternative(
        code="clock.offset",
        suspicion=f"stamps of scans {abs(offset):.3g} s "
        f"{'behind' if offset > 0 else 'ahead of'} those of poses",
        remedy=f"--clock-offset {offset:.3g} for a recording; else add {offset:.3g} s to the "
        "stamps of scans",
        place=place,
    )


def in_space(pose: Pose) -> Pose3:
    """A pose of the plane as one in space, at height 0."""
    if isinstance(pose, Pose3):
        return pose
    c, s = math.cos(pose.theta), math.sin(pose.theta)
    return Pose3(
        np.array([pose.x, pose.y, 0.0]), np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    )


def in_plane(pose: Pose3) -> Pose2:
    """A level pose seen from above."""
    x, y, _ = pose.translation.tolist()
    return Pose2(x, y, math.atan2(pose.rotation[1, 0], pose.rotation[0, 0]))
