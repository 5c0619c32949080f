# SPDX-License-Identifier: Apache-2.0
"""Folders of point clouds (`*.pcd`, `*.ply` or KITTI `*.bin`), and single clouds.

Files are taken in the order of the numbers in their names. Poses come from `poses=`, or from one
of `POSE_NAMES` in the folder, with stamps from `times=` or `times.txt`. Where there is no such
file, a PCD's VIEWPOINT is the pose: for a single cloud also where it is the identity.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from pathlib import Path

import numpy as np

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import Trajectory
from oddsmap.readers.bin_columns import find_bin_columns
from oddsmap.readers.bin_points import KITTI_COLUMNS, read_bin_points
from oddsmap.readers.compression import Source, open_source
from oddsmap.readers.kitti_calib import read_kitti_poses
from oddsmap.readers.moving_clouds import MovingClouds
from oddsmap.readers.options import FilePath, ReadOptions
from oddsmap.readers.pcd import read_pcd, viewpoint_pose
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
from oddsmap.readers.pose_file import PoseFile
from oddsmap.readers.sensor_track import pose_at
from oddsmap.readers.viewpoints import any_viewpoint, frame_note, in_sensor_frame
from oddsmap.scans.found import Found
from oddsmap.scans.lazy_log import LazyLog
from oddsmap.scans.memory_log import LoadedLog
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan

__all__ = ["KINDS", "find_clouds", "open_scan_folder", "open_single_cloud"]

KINDS: Mapping[str, tuple[str, Callable[[Source], Cloud]]] = {
    ".pcd": ("PCD", read_pcd),
    ".ply": ("PLY", read_ply),
    ".bin": ("KITTI .bin", read_bin_points),
}


_ONE_PLACE = "a cloud seen from the place of --origin"

_NO_POSE = Note(
    "no pose: the frame of the sensor is taken for the map frame",
    code="pose.assumed",
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
    options.refuse(name, "a folder of point clouds", "camera", "depth_scale")
    kind, read_cloud = KINDS[suffix]
    folder = Path(name)
    opening: tuple[Note, ...] = ()
    if suffix == ".bin":
        columns = options.columns
        if columns is None:
            columns, opening = find_bin_columns(name, files)
        if len(columns) != len(KITTI_COLUMNS):
            kind = f".bin ({' '.join(columns)})"
        read_cloud = partial(read_bin_points, columns=columns)
    else:
        options.refuse(name, f"a folder of {kind} files", "columns")
    match, notes = _match(name, folder, suffix, files, options)
    found = Found()
    moving = MovingClouds(
        name, len(files), lambda i: read_cloud(open_source(files[i])), match, options, found
    )

    def read_scan(i: int) -> Scan:
        source = open_source(files[i])
        cloud = read_cloud(source)
        for note in cloud.notes:
            found.notes.setdefault(note.code, {})[i] = note
        if options.origin is not None:
            pose, stamp_ns = pose_at(np.array(options.origin)), None
        elif match is None:
            body = viewpoint_pose(source.path, cloud.viewpoint) or _identity()
            pose, stamp_ns = options.sensor_pose(body), None
        else:
            pose, stamp_ns = match.map_from_sensor(i), match.stamp_ns(i)
        points = in_sensor_frame(cloud.points, pose, options)
        return moving.moved(i, Scan.from_points(pose, points, stamp_ns), cloud)

    return LazyLog(
        path=name,
        format=f"folder of {kind} scans",
        scan_count=len(files),
        read_scan=read_scan,
        skip_bad=options.skip_bad,
        opening_notes=(*opening, *notes, *moving.notes),
        found_notes=lambda: (*_notes_on(files, found), *moving.found_notes),
        found_skipped=lambda: moving.skipped,
        found=found,
    )


def _notes_on(files: list[Path], found: Found) -> Iterator[Note]:
    """What files say when they are read: each kind of note once, with its first file."""
    for of_files in found.notes.values():
        i = min(of_files)
        first = of_files[i]
        count = f"{len(of_files)} files, the first " if len(of_files) > 1 else ""
        yield Note(f"{count}{files[i]}: {first}", code=first.code, severity=first.severity)


def open_single_cloud(kind: str, read_cloud: Callable[[Source], Cloud]) -> Callable[..., LoadedLog]:
    """A reader of one cloud, for the registry."""

    def open_cloud(source: Source, options: ReadOptions) -> LoadedLog:
        options.refuse(source.path, f"a {kind} file", "camera", "columns", "depth_scale", "deskew")
        cloud = read_cloud(source)
        notes = [*source.initial_notes(), *cloud.notes]
        stamp_ns = None
        if options.origin is not None:
            options.refuse(source.path, _ONE_PLACE, "body_from_sensor", "times")
            pose = pose_at(np.array(options.origin))
        elif options.poses is not None:
            names = [Path(source.path).name]
            match = match_poses(source.path, names, options.poses, options.times, options)
            pose, stamp_ns = match.map_from_sensor(0), match.stamp_ns(0)
            notes.extend(match.notes)
        else:
            options.refuse(source.path, f"a {kind} file without poses", "times")
            found = viewpoint_pose(source.path, cloud.viewpoint)
            if found is None:
                options.refuse(source.path, f"a {kind} file without a pose", "points_in")
            notes.append(_NO_POSE if found is None else frame_note(source.path, options))
            pose = options.sensor_pose(found or _identity())
        return LoadedLog(
            path=source.path,
            format=f"{kind} scan",
            sensor={},
            skipped=source.initial_skipped(),
            notes=tuple(notes),
            scans=(Scan.from_points(pose, in_sensor_frame(cloud.points, pose, options), stamp_ns),),
        )

    return open_cloud


def _match(
    name: str, folder: Path, suffix: str, files: list[Path], options: ReadOptions
) -> tuple[PoseMatch | None, tuple[Note, ...]]:
    """The poses of the files, None for VIEWPOINTs or one stated place; and what to say of it."""
    if options.origin is not None:
        options.refuse(name, _ONE_PLACE, "body_from_sensor", "times")
        return None, ()
    poses = options.poses if options.poses is not None else find_poses(folder)
    times = options.times
    if times is None and (folder / TIMES_NAME).is_file():
        times = folder / TIMES_NAME
    if poses is not None:
        names = [path.name for path in files]
        file: FilePath | Trajectory | PoseFile = poses
        may_be_camera = suffix == ".bin" and options.body_from_sensor is None
        if may_be_camera and not isinstance(poses, Trajectory):
            file = read_kitti_poses(folder, poses, positions_do=options.points_in == "map")
        match = match_poses(name, names, file, times, options)
        return match, match.notes
    if suffix == ".pcd" and any_viewpoint(files):
        options.refuse(name, "a folder whose poses are each PCD's VIEWPOINT", "times")
        return None, (frame_note(name, options, files),)
    no_viewpoint = ", and VIEWPOINT is the identity in all of them" if suffix == ".pcd" else ""
    raise InputError(
        f"{name}: {len(files)} scans without poses ({' or '.join(POSE_NAMES)} would be "
        f"read{no_viewpoint}): name the poses with --poses (poses=)"
    )


@cache
def _identity() -> Pose3:
    return Pose3(np.zeros(3), np.eye(3))
