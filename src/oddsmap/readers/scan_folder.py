# SPDX-License-Identifier: Apache-2.0
"""Folders of point clouds (`*.pcd`, `*.ply` or KITTI `*.bin`), and single clouds.

Files are taken in the order of the numbers in their names. Poses come from `poses=`, or from one
of `pose_match.POSE_NAMES` in the folder, with stamps from `times=` or `times.txt`. Where there is
no such file, a PCD's VIEWPOINT is the pose: for a single cloud also where it is the identity.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

import numpy as np

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.readers.compression import HEAD_SIZE, Source, open_source
from oddsmap.readers.kitti_bin import read_kitti_bin
from oddsmap.readers.options import ReadOptions
from oddsmap.readers.pcd import read_pcd, read_viewpoint, viewpoint_pose
from oddsmap.readers.ply import read_ply
from oddsmap.readers.point_cloud import Cloud
from oddsmap.readers.pose_association import (
    POSE_NAMES,
    TIMES_NAME,
    PoseMatch,
    find_poses,
    match_poses,
    sorted_by_name,
)
from oddsmap.scans.lazy_log import LazyLog
from oddsmap.scans.memory_log import LoadedLog
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan

__all__ = ["KINDS", "find_clouds", "open_scan_folder", "open_single_cloud"]

KINDS: Mapping[str, tuple[str, Callable[[Source], Cloud]]] = {
    ".pcd": ("PCD", read_pcd),
    ".ply": ("PLY", read_ply),
    ".bin": ("KITTI .bin", read_kitti_bin),
}


_NO_POSE = Note(
    "no pose: the frame of the sensor is taken for the map frame",
    code="pose.assumed",
    severity="warning",
)
_VIEWPOINT = Note(
    "VIEWPOINT is taken for the pose of the sensor, in whose frame the points are",
    code="pose.viewpoint",
    severity="warning",
)


def find_clouds(folder: Path) -> dict[str, list[Path]]:
    """The clouds in a folder by their suffix, in the order of the numbers in their names."""
    found: dict[str, list[Path]] = {}
    for path in folder.iterdir():
        suffix = path.suffix.lower()
        if suffix in KINDS and not path.name.startswith(".") and path.is_file():
            found.setdefault(suffix, []).append(path)
    for paths in found.values():
        order = sorted_by_name([path.name for path in paths])
        paths[:] = [folder / name for name in order]
    return found


def open_scan_folder(name: str, suffix: str, files: list[Path], options: ReadOptions) -> LazyLog:
    """Open a folder of clouds; each is read when it is asked for.

    Args:
        name: the folder, as the caller wrote it.
        suffix: which kind of `KINDS` the files are.
        files: the files in order.
        options: what the caller states about the log.

    Raises:
        InputError: no poses, or counts that do not fit.
    """
    options.refuse(name, "a folder of point clouds", "camera")
    kind, read_cloud = KINDS[suffix]
    folder = Path(name)
    match, notes = _match(name, folder, suffix, files, options)
    found = _FoundNotes(files)

    def read_scan(i: int) -> Scan:
        source = open_source(files[i])
        cloud = read_cloud(source)
        found.add(i, cloud.notes)
        if match is None:
            pose = viewpoint_pose(source.path, cloud.viewpoint) or _identity()
            return Scan.from_points(options.sensor_pose(pose), cloud.points)
        return Scan.from_points(match.map_from_sensor(i), cloud.points, match.stamp_ns(i))

    return LazyLog(
        path=name,
        format=f"folder of {kind} scans",
        scan_count=len(files),
        read_scan=read_scan,
        skip_bad=options.skip_bad,
        opening_notes=notes,
        found_notes=found.notes,
    )


class _FoundNotes:
    """What files say when they are read: each kind of note once, with its first file."""

    def __init__(self, files: list[Path]) -> None:
        self._files = files
        # By number, so that a file that is read again is not counted again.
        self._by_code: dict[str, dict[int, Note]] = {}

    def add(self, i: int, notes: tuple[Note, ...]) -> None:
        """Keep the notes on the file of a number."""
        for note in notes:
            self._by_code.setdefault(note.code, {})[i] = note

    def notes(self) -> tuple[Note, ...]:
        """One note for each kind so far."""
        return tuple(self._summary(of_files) for of_files in self._by_code.values())

    def _summary(self, of_files: dict[int, Note]) -> Note:
        i = min(of_files)
        first = of_files[i]
        count = f"{len(of_files)} files, the first " if len(of_files) > 1 else ""
        text = f"{count}{self._files[i]}: {first}"
        return Note(text, code=first.code, severity=first.severity)


def open_single_cloud(kind: str, read_cloud: Callable[[Source], Cloud]) -> Callable[..., LoadedLog]:
    """A reader of one cloud, for the registry."""

    def open_cloud(source: Source, options: ReadOptions) -> LoadedLog:
        options.refuse(source.path, f"a {kind} file", "camera")
        cloud = read_cloud(source)
        notes = [*source.initial_notes(), *cloud.notes]
        stamp_ns = None
        if options.poses is not None:
            names = [Path(source.path).name]
            match = match_poses(source.path, names, options.poses, options.times, options)
            pose, stamp_ns = match.map_from_sensor(0), match.stamp_ns(0)
            notes.extend(match.notes)
        else:
            options.refuse(source.path, f"a {kind} file without poses", "times")
            found = viewpoint_pose(source.path, cloud.viewpoint)
            notes.append(_NO_POSE if found is None else _VIEWPOINT)
            pose = options.sensor_pose(found or _identity())
        return LoadedLog(
            path=source.path,
            format=f"{kind} scan",
            sensor={},
            skipped=source.initial_skipped(),
            notes=tuple(notes),
            scans=(Scan.from_points(pose, cloud.points, stamp_ns),),
        )

    return open_cloud


def _match(
    name: str, folder: Path, suffix: str, files: list[Path], options: ReadOptions
) -> tuple[PoseMatch | None, tuple[Note, ...]]:
    """The poses of the files, or None where each VIEWPOINT is one; and what to say of it."""
    poses = options.poses if options.poses is not None else find_poses(folder)
    times = options.times
    if times is None and (folder / TIMES_NAME).is_file():
        times = folder / TIMES_NAME
    if poses is not None:
        names = [path.name for path in files]
        match = match_poses(name, names, poses, times, options)
        return match, match.notes
    if suffix == ".pcd" and _any_viewpoint(files):
        options.refuse(name, "a folder whose poses are each PCD's VIEWPOINT", "times")
        return None, (_VIEWPOINT,)
    no_viewpoint = ", and VIEWPOINT is the identity in all of them" if suffix == ".pcd" else ""
    raise InputError(
        f"{name}: {len(files)} scans without poses ({' or '.join(POSE_NAMES)} would be "
        f"read{no_viewpoint}): name the poses with --poses (poses=)"
    )


def _any_viewpoint(files: list[Path]) -> bool:
    """Whether one PCD has another VIEWPOINT than the identity; only the headers are read."""
    for path in files:
        try:
            with path.open("rb") as file:
                head = file.read(HEAD_SIZE)
            if head.startswith((b"\x1f\x8b", b"BZh")):
                head = open_source(path).content
            if viewpoint_pose(str(path), read_viewpoint(Source(str(path), head))) is not None:
                return True
        except (InputError, OSError):
            continue  # said when the scan itself is read
    return False


@cache
def _identity() -> Pose3:
    return Pose3(np.eye(3), np.zeros(3))
