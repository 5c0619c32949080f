# SPDX-License-Identifier: Apache-2.0
"""NPZ beam logs: one array of beams in the map frame, written by simulators and conversions.

| key | |
|---|---|
| `beams` | 2D, (n, 4): sensor x, y [m], heading of the beam [rad], range [m]; 3D, (n, 7): sensor x, y, z [m], direction of the beam x, y, z (a unit vector), range [m] |
| `scan` | (n,) integers, optional: beams of equal number are one scan; without it, consecutive beams of equal position and stamp are |
| `stamp_ns` | (n,) whole numbers, optional: time of each beam [ns]; those of one scan are equal |
| `range_max` | [m], optional: a range at or above it is "nothing seen" |
| `cone_deg` | full opening angle [deg], optional: absent or up to 1 degree is a narrow beam |
| `p_random`, `p_dropout` | rates of random readings and of dropouts, optional |

Other keys (`truth`, `resolution`, ...) are ignored.
"""  # noqa: E501 - a table

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.readers.compression import Source
from oddsmap.readers.npz_arrays import load_arrays
from oddsmap.scans.memory_log import LoadedLog
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan

__all__ = ["matches", "open_npz_beams"]

_Array = npt.NDArray[Any]
_FloatArray = npt.NDArray[np.float64]
_IntArray = npt.NDArray[np.intp]

# Scalars and the interval each has to lie in, ends included.
_INTERVALS = {
    "range_max": (np.finfo(np.float64).tiny, np.finfo(np.float64).max),
    "cone_deg": (0.0, 180.0),
    "p_random": (0.0, 1.0),
    "p_dropout": (0.0, 1.0),
}
_NARROW_DEG = 1.0
# How far the length of a direction may be from 1: rounding, and no more.
_UNIT_TOLERANCE = 1e-3
# Five turns: a robot that adds up its turns may get there, headings in degrees do at once [rad].
_MANY_TURNS = 10 * math.pi
_LAYOUTS = "beams (n, 4) = x, y, heading, range or (n, 7) = x, y, z, dx, dy, dz, range"


def matches(head: bytes) -> bool:
    """Whether a file that starts like this is an NPZ: a zip whose first member is an array."""
    name_length = int.from_bytes(head[26:28], "little")
    return head.startswith(b"PK\x03\x04") and head[30 : 30 + name_length].endswith(b".npy")


def open_npz_beams(source: Source) -> LoadedLog:
    """Read an NPZ beam log.

    Beams without a finite position count as `scan.nan_pose`, those without a finite heading or
    direction as `beam.nan_heading`, one for each beam.

    Args:
        source: the decompressed content.

    Returns:
        One scan for each position or scan number, with the beams' directions in the map frame:
        every sensor pose is without rotation. Scans have stamps where the file has. Ranges at or
        above `range_max` are +Inf. `sensor` holds `range_max`, `p_random` and `p_dropout` where
        the file does, and `cone_deg` where beams are wider than 1 degree.

    Raises:
        InputError: a corrupt file, a missing or misshapen array, a direction that is not a unit
            vector, a scan at two positions or of two stamps, or no usable beam.
    """
    path = source.path
    arrays = load_arrays(
        source, ("beams", "scan", "stamp_ns", *_INTERVALS), "beams", f"write {_LAYOUTS}"
    )
    beams = _check_beams(path, arrays)
    scan_ids = _check_whole_numbers(path, arrays, "scan", len(beams))
    stamps = _check_whole_numbers(path, arrays, "stamp_ns", len(beams))
    scalars = {key: _read_scalar(path, key, arrays[key]) for key in _INTERVALS if key in arrays}
    if scalars.get("cone_deg", 0.0) <= _NARROW_DEG:
        scalars.pop("cone_deg", None)

    skipped = source.initial_skipped()
    notes = source.initial_notes()
    d = 2 if beams.shape[1] == 4 else 3
    usable = _find_usable(beams, d, skipped)
    if not usable.any():
        raise InputError(
            f"{path}: no usable scan, none of {len(beams)} beams has a finite position and "
            "heading: check what wrote the file"
        )
    rows, beams = np.flatnonzero(usable), beams[usable]
    ranges = _read_ranges(beams[:, -1], arrays.get("range_max"), notes)
    directions = _directions(path, beams, rows)
    _doubt_headings(beams, notes)
    stamps = None if stamps is None else stamps[usable].astype(np.int64)
    if scan_ids is None:
        groups = _group_in_turn(beams[:, :d], stamps)
    else:
        groups = _group_by_id(path, beams[:, :d], stamps, scan_ids[usable])
    positions = beams[:, :d].astype(np.float64)
    return LoadedLog(
        path=path,
        format="NPZ beam log",
        sensor=scalars,
        skipped=skipped,
        notes=tuple(notes),
        scans=tuple(
            _to_scan(
                positions[group[0]],
                directions[group],
                ranges[group],
                None if stamps is None else int(stamps[group[0]]),
            )
            for group in groups
        ),
    )


def _check_beams(path: str, arrays: Mapping[str, _Array]) -> _Array:
    beams = arrays["beams"]
    if beams.ndim != 2 or beams.shape[1] not in (4, 7) or len(beams) == 0:
        raise InputError(
            f"{path}: `beams` has shape {beams.shape}: it must be {_LAYOUTS}, with n > 0"
        )
    if beams.dtype.kind not in "iuf":
        raise InputError(f"{path}: `beams` holds {beams.dtype}: it must hold real numbers")
    return beams if beams.dtype.kind == "f" else beams.astype(np.float64)


def _check_whole_numbers(
    path: str, arrays: Mapping[str, _Array], key: str, beam_count: int
) -> _Array | None:
    if key not in arrays:
        return None
    numbers: _Array = arrays[key]
    if numbers.shape != (beam_count,) or numbers.dtype.kind not in "iu":
        raise InputError(
            f"{path}: `{key}` holds {numbers.dtype} of shape {numbers.shape}: "
            f"it must hold one integer for each of the {beam_count} beams"
        )
    return numbers


def _read_scalar(path: str, key: str, array: _Array) -> float:
    low, high = _INTERVALS[key]
    if array.size != 1 or array.dtype.kind not in "iuf":
        raise InputError(
            f"{path}: `{key}` holds {array.dtype} of shape {array.shape}: it must be one number"
        )
    # By way of its text: 0.03 stored as float32 means 0.03, not 0.029999999329447746.
    value = float(str(array.ravel()[0]))
    if not (math.isfinite(value) and low <= value <= high):
        limits = "positive" if key == "range_max" else f"from {low:g} to {high:g}"
        raise InputError(f"{path}: `{key}` is {value:g}: it must be {limits} and finite")
    return value


def _find_usable(beams: _Array, d: int, skipped: Counter[str]) -> npt.NDArray[np.bool_]:
    at_position = np.isfinite(beams[:, :d]).all(axis=1)
    headed = np.isfinite(beams[:, d:-1]).all(axis=1)
    for reason, bad in (
        ("scan.nan_pose", ~at_position),
        ("beam.nan_heading", at_position & ~headed),
    ):
        if bad.any():
            skipped[reason] += int(np.count_nonzero(bad))
    return np.asarray(at_position & headed)


def _directions(path: str, beams: _Array, rows: _IntArray) -> _FloatArray:
    """Unit vectors, shape (n, d); `rows` are the beams' places in the file, for messages."""
    if beams.shape[1] == 4:
        headings = beams[:, 2].astype(np.float64)
        return np.stack([np.cos(headings), np.sin(headings)], axis=1)
    directions: _FloatArray = beams[:, 3:6].astype(np.float64)
    lengths = np.linalg.norm(directions, axis=1)
    off = np.abs(lengths - 1.0) > _UNIT_TOLERANCE
    if off.any():
        worst = int(np.flatnonzero(off)[0])
        raise InputError(
            f"{path}: the direction of beam {rows[worst]} has length {lengths[worst]:g}: "
            "dx, dy, dz must be a unit vector"
        )
    directions /= lengths[:, None]
    return directions


def _doubt_headings(beams: _Array, notes: list[Note]) -> None:
    """Note headings of 2D beams that look like degrees: as directions none looks odd any more."""
    largest = float(np.abs(beams[:, 2]).max()) if beams.shape[1] == 4 else 0.0
    if largest > _MANY_TURNS:
        text = (
            f"are these headings in degrees? They reach {largest:.4g} and are read as radians: if "
            "so, multiply them by pi / 180"
        )
        notes.append(Note(text, code="pose.headings_in_degrees", severity="warning"))


def _read_ranges(ranges: _Array, range_max: _Array | None, notes: list[Note]) -> _FloatArray:
    """Ranges [m] in which what is at or above range_max has become +Inf."""
    result: _FloatArray = ranges.astype(np.float64)
    if range_max is None:
        notes.append(
            Note(
                "no `range_max` in the file: every finite range is read as a return",
                code="range_max.unknown",
                severity="warning",
            )
        )
        return result
    # In the coarser of the two precisions: 4.1 as float32 is less than 4.1 as float64.
    limit = range_max.ravel()[0]
    coarse = min(ranges.dtype, limit.dtype) if limit.dtype.kind == "f" else ranges.dtype
    far = ranges.astype(coarse) >= limit.astype(coarse)
    result[far] = np.inf
    notes.append(
        Note(
            f"{np.count_nonzero(far)} of {len(ranges)} ranges are at or above range_max "
            f"{limit:g} m: read as 'nothing seen'",
            code="range_max.read_as_nothing_seen",
        )
    )
    return result


def _group_in_turn(positions: _Array, stamps: _Array | None) -> list[_IntArray]:
    """Rows of each scan: consecutive beams of one position and, where there are stamps, of one."""
    moved = (positions[1:] != positions[:-1]).any(axis=1)
    if stamps is not None:
        moved |= stamps[1:] != stamps[:-1]
    return list(np.split(np.arange(len(positions)), np.flatnonzero(moved) + 1))


def _group_by_id(
    path: str, positions: _Array, stamps: _Array | None, ids: _Array
) -> list[_IntArray]:
    """Rows of each scan, scans in the order in which they first occur."""
    _, first, inverse = np.unique(ids, return_index=True, return_inverse=True)
    begin = first[inverse]
    elsewhere = (positions != positions[begin]).any(axis=1)
    if elsewhere.any():
        row = int(np.flatnonzero(elsewhere)[0])
        here, there = positions[row], positions[begin[row]]
        raise InputError(
            f"{path}: scan {ids[row]} has beams at two positions, {_point(there)} and "
            f"{_point(here)}: give beams from different positions different numbers"
        )
    later = np.zeros(len(ids), np.bool_) if stamps is None else stamps != stamps[begin]
    if stamps is not None and later.any():
        row = int(np.flatnonzero(later)[0])
        raise InputError(
            f"{path}: scan {ids[row]} has beams of two stamps, {stamps[begin[row]]} and "
            f"{stamps[row]} ns: give beams of different times different numbers"
        )
    rows = np.argsort(inverse, kind="stable")
    groups = np.split(rows, np.cumsum(np.bincount(inverse))[:-1])
    return [groups[i] for i in np.argsort(first)]


def _point(position: _Array) -> str:
    return f"({', '.join(f'{x:g}' for x in position)})"


def _to_scan(
    position: _FloatArray, directions: _FloatArray, ranges: _FloatArray, stamp_ns: int | None
) -> Scan:
    if len(position) == 3:
        return Scan(Pose3(position, np.eye(3)), directions, ranges, stamp_ns, trusted=True)
    pose = Pose2(float(position[0]), float(position[1]), 0.0)
    return Scan(pose, directions, ranges, stamp_ns, trusted=True)
