# SPDX-License-Identifier: Apache-2.0
"""Argoverse 2: the folder of a log, with sweeps of two LIDARs in one file each.

Points are in the frame of the car at the time of the sweep: what it moved meanwhile has been taken
out of them, but not out of where their rays start, which is the place of their own LIDAR at their
own time. `laser_number` says whose they are: 0 to 31 of `up_lidar`, from 32 on of `down_lidar`.

Source: Wilson et al., Argoverse 2 (NeurIPS Datasets and Benchmarks 2021);
https://argoverse.github.io/user-guide/datasets/sensor.html
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.decoding import decoding
from oddsmap.errors import InputError
from oddsmap.limits import check_content_size
from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import NoPoseError, Trajectory, format_seconds
from oddsmap.readers.extras import needs_extra
from oddsmap.readers.options import ReadOptions
from oddsmap.readers.sensor_track import SensorTrack
from oddsmap.scans.lazy_log import LazyLog
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan

__all__ = ["is_argoverse", "open_argoverse"]

_SWEEPS = "sensors/lidar"
_POSES = "city_SE3_egovehicle.feather"
_CALIBRATION = "calibration/egovehicle_SE3_sensor.feather"
_LIDARS = ("up_lidar", "down_lidar")
_LASERS = 32  # of each LIDAR

_QUATERNION, _PLACE = ("qx", "qy", "qz", "qw"), ("tx_m", "ty_m", "tz_m")
_MOTION = Note(
    "the points are in the frame of the car at the time of each sweep, without its motion; their "
    "rays start where the LIDAR was at the time of each point",
    code="cloud.compensated",
)


def is_argoverse(folder: Path) -> bool:
    """Whether a folder is that of a log of Argoverse 2."""
    return (folder / _POSES).is_file() or (
        (folder / _SWEEPS).is_dir()
        and any(path.suffix == ".feather" for path in (folder / _SWEEPS).iterdir())
    )


def open_argoverse(name: str, options: ReadOptions) -> LazyLog:
    """Open the folder of a log.

    Raises:
        InputError: poses, calibration or sweeps are missing, or cannot be read.
    """
    options.refuse(name, "an Argoverse 2 log", "poses", "times", "body_from_sensor", "camera")
    options.refuse(name, "an Argoverse 2 log", "points_in", "origin", "columns", "depth_scale")
    options.refuse(name, "an Argoverse 2 log", "deskew")
    folder = Path(name)
    for part in (_POSES, _CALIBRATION, _SWEEPS):
        if not (folder / part).exists():
            raise InputError(f"{name}: this Argoverse 2 log has no {part}: copy it, too")
    sweeps = (folder / _SWEEPS).glob("*.feather")
    files = sorted(sweeps, key=lambda path: (len(path.stem), path.stem))
    if not files:
        raise InputError(f"{name}: no sweeps (*.feather) in {_SWEEPS}")
    car = _read_poses(folder / _POSES)
    places = _read_calibration(folder / _CALIBRATION)
    tracks = [SensorTrack.of(car, place, options.tolerance_ns) for place in places]

    def read_scan(i: int) -> Scan:
        return _read_sweep(files[i], car, tracks, options)

    return LazyLog(
        path=name,
        format="Argoverse 2 sweeps",
        scan_count=len(files),
        read_scan=read_scan,
        skip_bad=options.skip_bad,
        opening_notes=(_MOTION,),
    )


def _read_sweep(
    path: Path, car: Trajectory, tracks: Sequence[SensorTrack], options: ReadOptions
) -> Scan:
    """The points of both LIDARs as one scan, in the frame of the car."""
    if not (path.stem.isdecimal() and len(path.stem) <= 18):
        raise InputError(
            f"{path}: a sweep is named by its time in nanoseconds, as 315966265259836000"
        )
    stamp = int(path.stem)
    table = _read_table(path, (*"xyz", "laser_number", "offset_ns"))
    points = np.stack([_numbers(path, table, axis) for axis in "xyz"], axis=1)
    lasers = _numbers(path, table, "laser_number")
    offsets = _numbers(path, table, "offset_ns")
    if not ((lasers >= 0) & (lasers < 2 * _LASERS)).all():
        raise InputError(f"{path}: laser_number beyond 0 to {2 * _LASERS - 1}")
    if not (np.abs(offsets) < 1e9).all():
        raise InputError(f"{path}: offset_ns of a second and more from the time of the sweep")
    times = stamp + offsets.astype(np.int64)
    pose = car.at(stamp, options.tolerance_ns)
    origins = np.full(points.shape, np.nan)
    for number, track in enumerate(tracks):
        mine = lasers // _LASERS == number
        places, known = track.at(times[mine])
        places[~known] = np.nan
        origins[mine] = (places - pose.translation) @ pose.rotation
    known = np.isfinite(origins).all(axis=1)
    if len(points) and not known.any():
        raise NoPoseError(
            f"{car.path}: no pose at the times of the sweep of {format_seconds(stamp)}: leave it "
            "out, or use --skip-bad (skip_bad=True)"
        )
    # A beam whose time has no pose says nothing.
    scan = Scan.from_points(pose, np.where(known[:, None], points - origins, np.nan), stamp)
    object.__setattr__(scan, "beam_times_ns", times)
    object.__setattr__(scan, "beam_origins", np.where(known[:, None], origins, 0.0))
    return scan


def _read_poses(path: Path) -> Trajectory:
    table = _read_table(path, ("timestamp_ns", *_QUATERNION, *_PLACE))
    stamps = _integers(path, table, "timestamp_ns")
    poses = _poses(path, table)
    if not poses:
        raise InputError(f"{path}: no poses")
    return Trajectory(
        positions=np.array([pose.translation for pose in poses]),
        rotations=np.array([pose.rotation for pose in poses]),
        stamps_ns=stamps,
        path=os.fspath(path),
    )


def _read_calibration(path: Path) -> list[Pose3]:
    """Where the LIDARs are on the car."""
    table = _read_table(path, ("sensor_name", *_QUATERNION, *_PLACE))
    with decoding(path, "the names of sensors cannot be read", "copy it again"):
        names = [str(name) for name in table["sensor_name"].to_pylist()]
    for name in _LIDARS:
        if names.count(name) != 1:
            raise InputError(f"{path}: {names.count(name)} sensors {name}, one is needed")
    poses = _poses(path, table)
    return [poses[names.index(name)] for name in _LIDARS]


def _poses(path: Path, table: Any) -> list[Pose3]:
    turns = np.stack([_numbers(path, table, name) for name in _QUATERNION], axis=1)
    places = np.stack([_numbers(path, table, name) for name in _PLACE], axis=1)
    poses = []
    for row, (place, turn) in enumerate(zip(places, turns, strict=True), start=1):
        if not (np.isfinite(place).all() and np.isfinite(turn).all()):
            raise InputError(f"{path}: row {row} is not finite: copy the file again")
        try:
            poses.append(Pose3.from_quaternion_xyzw(place, turn))
        except InputError as error:
            raise InputError(f"{path}: row {row}: {error}") from None
    return poses


def _read_table(path: Path, names: Sequence[str]) -> Any:
    """Columns of a Feather file, all of one length.

    Raises:
        InputError: it cannot be read, or one is missing.
    """
    with needs_extra(os.fspath(path), "av"):
        import pyarrow.feather
    try:
        check_content_size(path, path.stat().st_size, "the file")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    with decoding(path, "the Feather file cannot be read", "copy it again"):
        table = pyarrow.feather.read_table(path, memory_map=False, use_threads=False)
        there = table.column_names
        missing = [name for name in names if there.count(name) != 1]
    if missing:
        raise InputError(f"{path}: no column {', '.join(missing)}: is it of Argoverse 2?")
    with decoding(path, "the Feather file cannot be read", "copy it again"):
        table.validate(full=True)
    return table


def _numbers(path: Path, table: Any, name: str) -> FloatArray:
    """A column as doubles; what is null is NaN."""
    with decoding(path, f"column {name} cannot be read", "copy it again"):
        values = table[name].to_numpy()
        if values.dtype.kind not in "iuf":
            raise TypeError(f"it is of type {values.dtype}")
        return np.asarray(values, np.float64)


def _integers(path: Path, table: Any, name: str) -> IntArray:
    """A column of whole numbers of 64 bits."""
    with decoding(path, f"column {name} cannot be read", "copy it again"):
        values = table[name].to_numpy()
        if values.dtype != np.int64:
            raise TypeError(f"it is of type {values.dtype}, or has nulls")
        return np.asarray(values, np.int64)
