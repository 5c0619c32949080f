# SPDX-License-Identifier: Apache-2.0
"""Which pose belongs to which scan of a folder: by stamp where there are stamps, else by order.

Nothing is guessed: by order, the counts must be equal; by stamp, a pose must be within the
tolerance. In a folder, poses and times are looked for under the names below.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import Trajectory
from oddsmap.readers.options import FilePath, ReadOptions
from oddsmap.readers.pose_file import read_times, read_trajectory
from oddsmap.scans.note import Note

__all__ = ["POSE_NAMES", "TIMES_NAME", "PoseMatch", "find_poses", "match_poses", "natural_key"]

POSE_NAMES = ("poses.txt", "poses_kitti.txt", "poses_tum.txt", "groundtruth.txt")
TIMES_NAME = "times.txt"

StampArray = npt.NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class PoseMatch:
    """The pose of the sensor and the stamp for each scan, by number."""

    map_from_sensor: Callable[[int], Pose3]
    stamps_ns: StampArray | None
    notes: tuple[Note, ...] = ()

    def stamp_ns(self, i: int) -> int | None:
        """The stamp of a scan [ns]."""
        return None if self.stamps_ns is None else int(self.stamps_ns[i])


def find_poses(folder: Path) -> FilePath | None:
    """The file of poses in a folder.

    Raises:
        InputError: there are several.
    """
    found = [folder / name for name in POSE_NAMES if (folder / name).is_file()]
    if len(found) > 1:
        names = " and ".join(path.name for path in found)
        raise InputError(f"{folder}: poses in {names}: say which with --poses (poses=)")
    return found[0] if found else None


def match_poses(
    path: str,
    names: Sequence[str],
    poses: FilePath | Trajectory,
    times: FilePath | None,
    options: ReadOptions,
    *,
    stamps_ns: StampArray | None = None,
) -> PoseMatch:
    """Match poses to scans.

    Args:
        path: what messages start with.
        names: file name of each scan.
        poses: the poses, or their file.
        times: a file with the stamp of each scan, or of each pose.
        options: extrinsics and tolerance.
        stamps_ns: stamp of each scan [ns] where the log itself has them, shape (n,).

    Raises:
        InputError: counts that do not fit, or a file that cannot be read.
    """
    n = len(names)
    trajectory = poses if isinstance(poses, Trajectory) else read_trajectory(poses)
    stamps = stamps_from_names(names) if stamps_ns is None else stamps_ns
    if times is not None:
        read = read_times(times)
        if len(read) == n:
            stamps = read
        elif len(read) == len(trajectory) and trajectory.stamps_ns is None and stamps is not None:
            trajectory = trajectory.with_stamps(read)
        else:
            raise InputError(
                f"{path}: {os.fspath(times)} has {len(read)} times for {n} scans: "
                "give one time for each scan"
            )
    notes: list[Note] = []
    if trajectory.stamps_ns is not None and stamps is not None:
        by_stamp, scan_stamps = trajectory, stamps
        return PoseMatch(
            lambda i: options.sensor_pose(by_stamp.at(int(scan_stamps[i]), options.tolerance_ns)),
            stamps,
        )
    if len(trajectory) != n:
        hint = (
            "give one time for each scan with times="
            if trajectory.stamps_ns is not None
            else ("scans and poses without stamps match one to one")
        )
        raise InputError(
            f"{path}: {n} scans and {len(trajectory)} poses in {trajectory.path}: {hint}"
        )
    if trajectory.stamps_ns is not None:
        notes.append(
            Note(
                "the scans have no stamps: poses are taken in their order, one per scan",
                code="pose.by_order",
                severity="warning",
            )
        )
    by_order = trajectory
    return PoseMatch(
        lambda i: options.sensor_pose(by_order[i]),
        trajectory.stamps_ns if stamps is None else stamps,
        tuple(notes),
    )


def natural_key(name: str) -> tuple[object, ...]:
    """Sort key by which scan2 comes before scan10, and 9.5 before 9.25 does not."""
    seconds = _seconds(name)
    if seconds is not None:
        return (0, seconds, name)
    parts = re.split(r"(\d+)", name)
    return (1, tuple(int(p) if p.isdecimal() else p for p in parts), name)


def stamps_from_names(names: Sequence[str]) -> StampArray | None:
    """Stamps [ns] of files that are named by them: seconds with a decimal point, 12.345.pcd.

    Whole numbers are not taken for times: 000012.pcd is the scan of number 12.
    """
    seconds = [_seconds(name) for name in names]
    if any(second is None for second in seconds):
        return None
    stamps = [int(second * 10**9) for second in seconds if second is not None]
    if any(abs(stamp) >= 2**63 for stamp in stamps):
        return None
    return np.array(stamps, np.int64)


def _seconds(name: str) -> Decimal | None:
    stem = name.rsplit(".", 1)[0]
    if not re.fullmatch(r"\d+\.\d+", stem):
        return None
    try:
        return Decimal(stem)
    except InvalidOperation:  # pragma: no cover - the pattern allows numbers only
        return None
