# SPDX-License-Identifier: Apache-2.0
"""Which reader reads a file or a folder: chosen by its content, never by its suffix.

The files *in* a folder are told apart by their suffixes: nothing in a KITTI `.bin` says what it is.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from oddsmap.errors import InputError
from oddsmap.limits import memory_for
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import Trajectory
from oddsmap.readers import (
    argoverse,
    carmen,
    e57,
    g2o,
    las,
    npz_beams,
    npz_grids,
    octomap_graph,
    pcd,
    ply,
    ptx,
    rawlog,
    recorded,
    rgbd_folder,
    scan_folder,
)
from oddsmap.readers.compression import Source, open_source
from oddsmap.readers.npz_arrays import array_names
from oddsmap.readers.options import FilePath, PointFrame, ReadOptions
from oddsmap.readers.plain_text import refuse_utf16, without_bom
from oddsmap.scans.depth_image import PinholeCamera
from oddsmap.scans.log import Log
from oddsmap.scans.log_items import ReadOnDemand

__all__ = ["READERS", "Reader", "known_formats", "open_log"]


@dataclass(frozen=True, slots=True)
class Reader:
    """One format.

    Args:
        name: name of the format in the plural, for people.
        matches: whether the first 64 KiB of decompressed content are of this format.
        open: reads the whole content, with the caller's options; raises InputError where no
            usable scan is in it.
    """

    name: str
    matches: Callable[[bytes], bool]
    open: Callable[[Source, ReadOptions], Log]


def _alone(
    name: str, open_source_alone: Callable[[Source], Log]
) -> Callable[[Source, ReadOptions], Log]:
    """A reader of 2D logs, which need no options: they state everything themselves."""

    def open_alone(source: Source, options: ReadOptions) -> Log:
        options.refuse(source.path, name, "poses", "times", "body_from_sensor", "camera")
        options.refuse(source.path, name, "points_in", "origin", "columns", "depth_scale", "deskew")
        return open_source_alone(source)

    return open_alone


def _open_npz(source: Source, options: ReadOptions) -> Log:
    names = array_names(source)
    if "grids" in names and "beams" not in names:
        return _alone("an NPZ grid log", npz_grids.open_npz_grids)(source, options)
    return _alone("an NPZ beam log", npz_beams.open_npz_beams)(source, options)


# Tried in this order: formats with magic bytes first, texts after them.
READERS: tuple[Reader, ...] = (
    Reader("NPZ beam and grid logs", npz_beams.matches, _open_npz),
    Reader("PCD scans", pcd.matches, scan_folder.open_single_cloud("PCD", pcd.read_pcd)),
    Reader("PLY scans", ply.matches, scan_folder.open_single_cloud("PLY", ply.read_ply)),
    Reader("OctoMap scan graphs", octomap_graph.matches, octomap_graph.open_octomap_graph),
    Reader("g2o graphs", g2o.matches, _alone("a g2o graph", g2o.open_g2o)),
    Reader("MRPT rawlogs", rawlog.matches, rawlog.open_rawlog),
    Reader("PTX scans", ptx.matches, ptx.open_ptx),
    Reader("CARMEN logs", carmen.matches, _alone("a CARMEN log", carmen.open_carmen)),
)


@dataclass(frozen=True, slots=True)
class SurveyFile:
    """A format of which files may be larger than memory, which its reader opens itself.

    Args:
        name: name of the format, for people.
        matches: whether a file that starts like this is of this format.
        open: opens the file of a path, with the caller's options.
    """

    name: str
    matches: Callable[[bytes], bool]
    open: Callable[[str, ReadOptions], Log]


SURVEY_FILES: tuple[SurveyFile, ...] = (
    SurveyFile("LAS", las.matches, las.open_las),
    SurveyFile("E57", e57.matches, e57.open_e57),
)


def open_log(
    path: FilePath,
    *,
    poses: FilePath | Trajectory | None = None,
    times: FilePath | None = None,
    body_from_sensor: Pose3 | None = None,
    camera: PinholeCamera | None = None,
    skip_bad: bool = False,
    tolerance_s: float | None = None,
    points_in: PointFrame | None = None,
    origin: Sequence[float] | None = None,
    columns: Sequence[str] | None = None,
    depth_scale: float | None = None,
    scans: Sequence[str] = (),
    frame: str | None = None,
    clock_offset_s: float = 0.0,
    deskew: bool | None = None,
) -> Log:
    """Open a log of range readings with poses: a file, or a folder of scans.

    The format is recognized by its content, also under gzip or bzip2. A bad line or reading is
    always skipped and counted in the log's `skipped`. The scans of a folder are read one by one
    during iteration and are not kept.

    Args:
        path: the file, or a folder of point clouds or depth images.
        poses: the poses of clouds and depth images, KITTI or TUM, or a trajectory; by default the
            file of poses in the folder. Of a recording also "tf" or a topic; by default its
            transforms, and its topic of poses where no transforms lead to the sensor.
        skip_bad: skip files of a folder that cannot be read and count them (`scan.unreadable`),
            and images without a pose (`scan.no_pose`). Of a truncated or corrupt gzip or bzip2
            file, scan graph or recording, use the readable part and count `container.truncated`.
        times: the stamp of each scan, one number of seconds per line; by default `times.txt` in a
            folder of point clouds.
        body_from_sensor: pose of the sensor in the frame whose poses are given.
        camera: the intrinsics of depth images; by default those in the folder.
        tolerance_s: how far the nearest pose may be from a stamp [s]; by default 0.02, and 0.1 in
            recordings.
        points_in: "sensor" or "map": the frame in which the points of clouds are. By default the
            sensor's, but where PCD's VIEWPOINT is the pose, it must be said.
        origin: where the sensor stood in the map [m], three numbers, for clouds in the map's frame
            that do not say it.
        columns: what the float32 columns of `.bin` files are, as ("x", "y", "z", "intensity") or
            "x,y,z,intensity"; by default found by what stands in them.
        depth_scale: how many units of a depth image make a metre, 1000 where they are
            millimetres; by default what its layout is known for, 1000 or 5000.
        scans: topics of a recording that are scans; by default the only one.
        frame: the frame of the map in a recording; by default map, world or odom.
        clock_offset_s: what is added to the stamps of a recording's scans to get the time of its
            poses [s].
        deskew: take each beam from where the sensor was at its own time, where the log has one for
            each; False: the whole scan at its stamp. By default where the times are plausible and
            poses come at least ten times a second; a note says so.

    Returns:
        The scans in file order, and what had to be skipped to get them.

    Raises:
        InputError: the file cannot be read, is of no known format, or holds no usable scan; poses
            are missing, or do not fit the scans; or an argument states what the log states itself.
    """
    options = ReadOptions(
        poses=poses,
        times=times,
        body_from_sensor=body_from_sensor,
        camera=camera,
        skip_bad=skip_bad,
        tolerance_s=tolerance_s,
        points_in=points_in,
        origin=None if origin is None else _three(origin),
        columns=_names(columns),
        depth_scale=depth_scale,
        scans=(scans,) if isinstance(scans, str) else tuple(scans),
        frame=frame,
        clock_offset_s=clock_offset_s,
        deskew=deskew,
    )
    return _open(os.fspath(path), options)


def _open(name: str, options: ReadOptions) -> Log:
    log = _open_by_content(name, options)
    if isinstance(log, ReadOnDemand):
        log.opened_by(_open, name, options)
    return log


def _open_by_content(name: str, options: ReadOptions) -> Log:
    with memory_for(f"the log {name}", "split it, or read it on a machine with more memory"):
        if recorded.is_recording(name):
            return recorded.open_recorded(name, options)
        head = _first_bytes(name)
        for survey_file in SURVEY_FILES:
            if survey_file.matches(head):
                return survey_file.open(name, options)
        options.refuse(name, "this log", "scans", "frame", "clock_offset_s")
        return _open_folder(name, options) if Path(name).is_dir() else _open_file(name, options)


def _first_bytes(name: str) -> bytes:
    try:
        with Path(name).open("rb") as file:
            return file.read(64)
    except (OSError, ValueError):
        return b""  # a folder, or said by whoever reads it


def _open_file(path: str, options: ReadOptions) -> Log:
    source = open_source(path, skip_bad=options.skip_bad)
    for reader in READERS:
        if reader.matches(without_bom(source).head):
            return reader.open(without_bom(source), options)
    refuse_utf16(source.path, source.head)
    raise InputError(
        f"{source.path}: unknown file type (it starts with {source.content[:16]!r}): "
        f"oddsmap reads {known_formats()}"
    )


def known_formats() -> str:
    """What is read, for people."""
    *names, last = (reader.name for reader in READERS)
    return (
        f"{', '.join(names)} and {last}, plain or compressed with gzip or bzip2; KITTI .bin scans "
        "and depth images as a folder; ROS bags, MCAP, Argoverse 2, "
        + ", ".join(file.name for file in SURVEY_FILES)
    )


def _three(origin: Sequence[float]) -> tuple[float, float, float]:
    """A place as numbers; their count is checked with the other options."""
    return tuple(float(value) for value in origin)  # type: ignore[return-value]


def _names(columns: Sequence[str] | None) -> tuple[str, ...] | None:
    """Names of columns, also where they are one text."""
    if isinstance(columns, str):
        return tuple(columns.replace(",", " ").split())
    return None if columns is None else tuple(columns)


def _open_folder(name: str, options: ReadOptions) -> Log:
    folder = Path(name)
    try:
        kinds: list[tuple[str, Callable[[], Log]]] = []
        if rgbd_folder.is_seven_scenes(folder):
            kinds.append(("*.depth.png", lambda: rgbd_folder.open_seven_scenes(name, options)))
        if rgbd_folder.is_tum_rgbd(folder):
            kinds.append(("depth.txt", lambda: rgbd_folder.open_tum_rgbd(name, options)))
        if argoverse.is_argoverse(folder):
            kinds.append((".feather", lambda: argoverse.open_argoverse(name, options)))
        for suffix, files in scan_folder.find_clouds(folder).items():
            kinds.append((f"*{suffix}", _folder_opener(name, suffix, files, options)))
        entries = sorted(path.name for path in folder.iterdir())
    except OSError as error:
        raise InputError(f"{name}: the folder cannot be read ({error.strerror})") from None
    if not kinds:
        found = ", ".join(entries[:5]) + (", ..." if len(entries) > 5 else "")
        raise InputError(
            f"{name}: no scans in this folder, found {found or 'nothing'}: give a folder of *.pcd, "
            "*.ply, *.bin or *.depth.png, a TUM RGB-D folder (depth.txt) or an Argoverse 2 "
            "log, or one log file"
        )
    if len(kinds) > 1:
        names = " and ".join(kind for kind, _ in kinds)
        raise InputError(f"{name}: {names} in one folder: leave one kind of scans in it")
    return kinds[0][1]()


def _folder_opener(
    name: str, suffix: str, files: list[Path], options: ReadOptions
) -> Callable[[], Log]:
    return lambda: scan_folder.open_scan_folder(name, suffix, files, options)
