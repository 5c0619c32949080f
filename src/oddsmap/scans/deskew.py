# SPDX-License-Identifier: Apache-2.0
"""Scans taken on the move: each beam starts where the sensor was at its own time.

A scan keeps its pose, that of its stamp, and stays one measurement. Its beams are told in the frame
of the sensor at the stamp: turned, and with an origin each.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from oddsmap.array_types import BoolArray, FloatArray, IntArray
from oddsmap.poses.at_times import PoseArray
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.poses.product import inverse, product
from oddsmap.poses.trajectory import NoPoseError, format_seconds
from oddsmap.scans.scan import Scan

__all__ = ["deskew"]


def deskew(
    scan: Scan, at_stamp: Pose3, poses_at: Callable[[IntArray], PoseArray]
) -> tuple[Scan, int]:
    """Take each beam from where the sensor was at its own time.

    A beam is taken as it is where the pose at its time is that at the stamp, bit by bit, and a scan
    in which all are is given back itself: deskewing changes nothing where a robot stands still.

    Args:
        scan: with a stamp, `beam_times_ns`, and no origins of beams yet. In 2D the poses are looked
            at from above.
        at_stamp: map_from_sensor at the stamp of the scan.
        poses_at: map_from_sensor at some times [ns].

    Returns:
        The scan, its beams in the order of their times, and how many beams were left out since
        there is no pose at their times.

    Raises:
        NoPoseError: at none of its times there is a pose.
    """
    times, stamp = scan.beam_times_ns, scan.stamp_ns
    if times is None or stamp is None or scan.size == 0:
        return scan, 0
    order = _order_of(times)
    in_order = times if order is None else times[order]
    first = np.append(True, in_order[1:] != in_order[:-1])
    poses = poses_at(np.append(in_order[first], stamp))
    known, still = poses.known[:-1], _same_as_at_stamp(poses, at_stamp)
    if not known.any():
        raise NoPoseError(
            f"no pose at the times of the beams, {format_seconds(int(in_order[0]))} to "
            f"{format_seconds(int(in_order[-1]))} s"
        )
    if still.all() and known.all():
        return scan, 0
    whose = np.cumsum(first) - 1
    turns, places = _in_frame_of_stamp(scan.map_from_sensor, at_stamp, poses, still)
    if order is None:
        order = np.arange(scan.size)
    if not known.all():
        kept = known[whose]
        order, whose = order[kept], whose[kept]
    own = scan.directions if scan.measured_points is None else scan.measured_points
    moved = Scan(
        scan.map_from_sensor,
        _turned(turns, whose, order, scan.directions),
        scan.ranges[order],
        stamp,
        sensor_id=scan.sensor_id,
        beam_times_ns=times[order],
        beam_origins=places.take(whose, axis=0),
        trusted=True,
    )
    object.__setattr__(moved, "own_vectors", own.take(order, axis=0))
    if scan.measured_points is not None:
        points = _turned(turns, whose, order, scan.measured_points)
        object.__setattr__(moved, "measured_points", points)
    return moved, scan.size - moved.size


def _order_of(times: IntArray) -> IntArray | None:
    """Beams by their times; None where they are in order.

    Beams taken at one time follow each other then, and are one bundle for the kernels, also those
    of a spinning LIDAR that lists its rings one by one.
    """
    if (times[1:] >= times[:-1]).all():
        return None
    return np.argsort(times, kind="stable")


def _same_as_at_stamp(poses: PoseArray, at_stamp: Pose3) -> BoolArray:
    """At which times, of which the last is the stamp, the sensor is where it was at the stamp."""
    turn, place = at_stamp.rotation, at_stamp.translation
    if poses.known[-1]:
        # As found among many: the same to the last bit, which it may not be when found alone.
        turn, place = poses.rotations[-1], poses.positions[-1]
    same = (poses.rotations == turn).all(axis=(1, 2)) & (poses.positions == place).all(axis=1)
    return np.asarray(same & poses.known)[:-1]


def _in_frame_of_stamp(
    scan_pose: Pose2 | Pose3, at_stamp: Pose3, poses: PoseArray, still: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """stamp_from_sensor at each time: rotations (n, d, d) and places [m], (n, d)."""
    turns, places = poses.rotations[:-1], poses.positions[:-1]
    if isinstance(scan_pose, Pose2):
        turns, places = _seen_from_above(turns), places[:, :2]
    # The inverse itself: matrices written with few digits are no exact rotations, and a beam shall
    # come out in the map as its own pose has it.
    back = scan_pose.rotation.T if isinstance(scan_pose, Pose2) else inverse(at_stamp.rotation)
    if back is None:
        back = scan_pose.rotation.T
    d = len(back)
    with np.errstate(invalid="ignore", over="ignore"):
        turned = back[:, :1] * turns[:, :1]
        for k in range(1, d):
            turned = turned + back[:, k : k + 1] * turns[:, k : k + 1]
        moved = product(places - scan_pose.translation, back.T)
    turned[still], moved[still] = np.eye(d), 0.0
    return turned, moved


def _seen_from_above(turns: FloatArray) -> FloatArray:
    """Headings of poses in space as rotations of the plane, shape (n, 2, 2)."""
    with np.errstate(invalid="ignore", divide="ignore"):
        x, y = turns[:, 0, 0], turns[:, 1, 0]
        length = np.sqrt(x * x + y * y)
        c, s = x / length, y / length
    return np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1)


def _turned(turns: FloatArray, whose: IntArray, order: IntArray, vectors: FloatArray) -> FloatArray:
    from oddsmap.kernels.beam_poses import turn_vectors

    turned = np.empty((len(order), vectors.shape[1]))
    turn_vectors(
        np.ascontiguousarray(turns), whose, order, np.ascontiguousarray(vectors, np.float64), turned
    )
    return turned
