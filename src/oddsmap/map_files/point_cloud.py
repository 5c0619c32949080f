# SPDX-License-Identifier: Apache-2.0
"""Points, some at a time, as a PLY, PCD, LAS or LAZ file: for CloudCompare, Open3D, PCL, PDAL."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.atomic_write import atomic_output, check_output
from oddsmap.errors import ConfigError, InputError
from oddsmap.map_files.front import put_in_front

__all__ = ["CLOUDS", "LabelledPoints", "save_points"]

CLOUDS = (".ply", ".pcd", ".las", ".laz")
"""The suffixes of files that `save_points` writes."""

LabelledPoints = tuple[FloatArray, BoolArray]
"""Points [m], shape (n, 3) or (n, 2), and a label of each, shape (n,)."""

# Single precision, the only one that PCL reads, is off by 1 mm from here on [m].
_FAR = 2.0**24 * 1e-3
# LAS counts tenths of a millimetre, as an int32.
_STEP, _LARGEST = 1e-4, (1 << 31) - 1


def save_points(
    parts: Iterable[LabelledPoints], path: str | Path, *, labels: bool = False, force: bool = False
) -> int:
    """Write points as they come; in 2D at z = 0.

    PLY has them in double precision, PCD in single precision, LAS in tenths of a millimetre around
    the first point. A label is 0 or 1: PLY `label` (uchar), PCD `label` (unsigned, 4 bytes), LAS
    `user_data`.

    Args:
        parts: points in the map frame with their labels.
        path: the file to write, named `.ply`, `.pcd`, `.las` or `.laz`.
        labels: True: write the labels, too.
        force: True where an existing file may be replaced.

    Returns:
        How many points were written.

    Raises:
        ConfigError: another suffix, or laspy (for LAZ lazrs, too) is not installed.
        InputError: points too far from the origin for PCD, or from each other for LAS.
        OutputError: the file exists already or cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in CLOUDS:
        raise ConfigError(f"{path}: points are named {', '.join(CLOUDS)}")
    check_output(path, force=force)
    in_space = ((_in_space(points), label) for points, label in parts)
    if suffix in (".las", ".laz"):
        return _save_las(in_space, path, labels, force)
    is_ply = suffix == ".ply"
    columns = [(axis, "<f8" if is_ply else "<f4") for axis in "xyz"]
    columns += [("label", "u1" if is_ply else "<u4")] if labels else []
    count = 0
    with atomic_output(path, force=force) as part, part.open("w+b") as file:
        for points, label in in_space:
            if not is_ply and np.abs(points).max(initial=0.0) >= _FAR:
                raise InputError(
                    f"{path}: PCD has single precision, which is off by 1 mm or more at the "
                    f"{np.abs(points).max():.0f} m of these points: write a .ply or .las"
                )
            rows = np.zeros(len(points), np.dtype(columns))
            for axis, name in enumerate("xyz"):
                rows[name] = points[:, axis]
            if labels:
                rows["label"] = label
            file.write(rows.tobytes())
            count += len(rows)
        front = _ply_header(count, labels) if is_ply else _pcd_header(count, labels)
        put_in_front(file, front.encode("ascii"))
    return count


def _in_space(points: FloatArray) -> FloatArray:
    return points if points.shape[1] == 3 else np.pad(points, ((0, 0), (0, 1)))


def _ply_header(count: int, labels: bool) -> str:
    label = "property uchar label\n" if labels else ""
    return (
        "ply\nformat binary_little_endian 1.0\ncomment points of a log, by oddsmap\n"
        f"element vertex {count}\nproperty double x\nproperty double y\nproperty double z\n"
        f"{label}end_header\n"
    )


def _pcd_header(count: int, labels: bool) -> str:
    more = (" label", " 4", " U", " 1") if labels else ("", "", "", "")
    return (
        "# .PCD v0.7 - points of a log, by oddsmap\nVERSION 0.7\n"
        f"FIELDS x y z{more[0]}\nSIZE 4 4 4{more[1]}\nTYPE F F F{more[2]}\nCOUNT 1 1 1{more[3]}\n"
        f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n"
    )


def _save_las(parts: Iterable[LabelledPoints], path: Path, labels: bool, force: bool) -> int:
    from oddsmap.map_files.las import errors_of_laz, laspy_module

    laspy = laspy_module()
    compressed = path.suffix.lower() == ".laz"
    faults = errors_of_laz() if compressed else ()
    header: Any = laspy.LasHeader(point_format=6, version="1.4")
    header.generating_software = "oddsmap"
    header.scales = np.full(3, _STEP)
    count, writer = 0, None
    with atomic_output(path, force=force) as part, part.open("w+b") as file:
        try:
            for points, label in parts:
                if writer is None:
                    # Whole metres near the first points, so that an int32 reaches 200 km from it.
                    header.offsets = np.rint(points[0]) if len(points) else np.zeros(3)
                    if not len(points):
                        continue
                    writer = laspy.open(
                        file, "w", header=header, do_compress=compressed, closefd=False
                    )
                writer.write_points(_record(laspy, header, points, label if labels else None, path))
                count += len(points)
            if writer is None:
                writer = laspy.open(file, "w", header=header, closefd=False)
            writer.close()
        except faults as error:  # the disk is full
            raise OSError(str(error)) from None
    return count


def _record(
    laspy: Any, header: Any, points: FloatArray, label: BoolArray | None, path: Path
) -> Any:
    steps = np.rint((points - header.offsets) / _STEP)
    if np.abs(steps).max(initial=0.0) > _LARGEST:
        raise InputError(f"{path}: a LAS holds points up to 200 km from the first: write a .ply")
    record = laspy.ScaleAwarePointRecord.zeros(len(points), header=header)
    for axis, name in enumerate("XYZ"):
        record[name] = steps[:, axis].astype(np.int32)
    record["return_number"] = record["number_of_returns"] = np.ones(len(record), np.uint8)
    if label is not None:
        record["user_data"] = label.astype(np.uint8)
    return record
