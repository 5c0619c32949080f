# SPDX-License-Identifier: Apache-2.0
"""NPZ beam logs: one array of beams in the map frame, written by simulators and conversions.

| key | |
|---|---|
| `beams` | (n, 4): sensor x [m], y [m], heading of the beam [rad], range [m] |
| `scan` | (n,) integers, optional: beams of equal number are one scan; without it, consecutive beams of equal position are |
| `range_max` | [m], optional: a range at or above it is "nothing seen" |
| `cone_deg` | full opening angle [deg], optional: absent or up to 1 degree is a narrow beam |
| `p_random`, `p_dropout` | rates of random readings and of dropouts, optional |

Other keys (`truth`, `resolution`, ...) are ignored.
"""  # noqa: E501 - a table

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.poses import Pose2
from oddsmap.readers.container import Source
from oddsmap.readers.loaded import LoadedLog
from oddsmap.scan import Scan

__all__ = ["matches", "open_npz_beams"]

_Array = npt.NDArray[Any]
_FloatArray = npt.NDArray[np.float64]
_IntArray = npt.NDArray[np.intp]

# Scalars and the interval each has to lie in, ends included.
_INTERVALS = {
    "range_max": (np.finfo(np.float64).tiny, np.finfo(np.float64).max),
    "cone_deg": (0.0, 360.0),
    "p_random": (0.0, 1.0),
    "p_dropout": (0.0, 1.0),
}
_NARROW_DEG = 1.0


def matches(head: bytes) -> bool:
    """Whether a file that starts like this is an NPZ: a zip whose first member is an array."""
    name_length = int.from_bytes(head[26:28], "little")
    return head.startswith(b"PK\x03\x04") and head[30 : 30 + name_length].endswith(b".npy")


def open_npz_beams(source: Source) -> LoadedLog:
    """Read an NPZ beam log.

    Beams without a finite position count as `scan.nan_pose`, those without a finite heading as
    `beam.nan_heading`, one for each beam.

    Args:
        source: the decompressed content.

    Returns:
        One scan for each position or scan number, with the headings as directions: every sensor
        pose has heading 0. Ranges at or above `range_max` are +Inf. `sensor` holds `range_max`,
        `p_random` and `p_dropout` where the file does.

    Raises:
        InputError: a corrupt file, a missing or misshapen array, a scan at two positions, a cone
            wider than 1 degree, or no usable beam.
    """
    path = source.path
    arrays = _load_arrays(source)
    beams = _check_beams(path, arrays)
    scan_ids = _check_scan_ids(path, arrays, len(beams))
    scalars = {key: _read_scalar(path, key, arrays[key]) for key in _INTERVALS if key in arrays}
    _refuse_wide_cone(path, scalars.pop("cone_deg", 0.0))

    skipped = source.initial_skipped()
    notes = source.initial_notes()
    usable = _find_usable(beams, skipped)
    if not usable.any():
        raise InputError(
            f"{path}: no usable scan, none of {len(beams)} beams has a finite position and "
            "heading: check what wrote the file"
        )
    beams = beams[usable]
    ranges = _read_ranges(beams[:, 3], arrays.get("range_max"), notes)
    if scan_ids is None:
        groups = _group_by_position(beams[:, :2])
    else:
        groups = _group_by_id(path, beams[:, :2], scan_ids[usable])
    return LoadedLog(
        path=path,
        format="NPZ beam log",
        sensor=scalars,
        skipped=skipped,
        notes=tuple(notes),
        scans=tuple(_to_scan(beams[rows].astype(np.float64), ranges[rows]) for rows in groups),
    )


def _load_arrays(source: Source) -> Mapping[str, _Array]:
    """The arrays this reader knows; the others are not even decompressed."""
    try:
        with np.load(io.BytesIO(source.content), allow_pickle=False) as file:
            found = sorted(file.files)
            wanted = [key for key in ("beams", "scan", *_INTERVALS) if key in found]
            arrays = {key: np.asarray(file[key]) for key in wanted}
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, KeyError, NotImplementedError) as e:
        raise InputError(
            f"{source.path}: corrupt or truncated NPZ file ({e}): copy or write it again"
        ) from None
    except ValueError as e:  # NumPy's word for both a pickle and a damaged array header
        raise InputError(
            f"{source.path}: an array in the NPZ file cannot be read ({e}): "
            "write plain arrays of numbers"
        ) from None
    if "beams" not in arrays:
        raise InputError(
            f"{source.path}: no array `beams` in the NPZ file, found {', '.join(found)}: "
            "write beams (n, 4) = x, y, heading, range"
        )
    return arrays


def _check_beams(path: str, arrays: Mapping[str, _Array]) -> _Array:
    beams = arrays["beams"]
    if beams.ndim != 2 or beams.shape[1] != 4 or len(beams) == 0:
        raise InputError(
            f"{path}: `beams` has shape {beams.shape}: "
            "it must be (n, 4) = x, y, heading, range with n > 0"
        )
    if beams.dtype.kind not in "iuf":
        raise InputError(f"{path}: `beams` holds {beams.dtype}: it must hold real numbers")
    return beams if beams.dtype.kind == "f" else beams.astype(np.float64)


def _check_scan_ids(path: str, arrays: Mapping[str, _Array], beam_count: int) -> _Array | None:
    if "scan" not in arrays:
        return None
    ids = arrays["scan"]
    if ids.shape != (beam_count,) or ids.dtype.kind not in "iu":
        raise InputError(
            f"{path}: `scan` holds {ids.dtype} of shape {ids.shape}: "
            f"it must hold one integer for each of the {beam_count} beams"
        )
    return ids


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


def _refuse_wide_cone(path: str, cone_deg: float) -> None:
    if cone_deg > _NARROW_DEG:
        raise InputError(
            f"{path}: `cone_deg` is {cone_deg:g}: cones are not supported yet, "
            f"only narrow beams (up to {_NARROW_DEG:g} degree)"
        )


def _find_usable(beams: _Array, skipped: Counter[str]) -> npt.NDArray[np.bool_]:
    at_position = np.isfinite(beams[:, :2]).all(axis=1)
    headed = np.isfinite(beams[:, 2])
    for reason, bad in (
        ("scan.nan_pose", ~at_position),
        ("beam.nan_heading", at_position & ~headed),
    ):
        if bad.any():
            skipped[reason] += int(np.count_nonzero(bad))
    return np.asarray(at_position & headed)


def _read_ranges(ranges: _Array, range_max: _Array | None, notes: list[str]) -> _FloatArray:
    """Ranges [m] in which what is at or above range_max has become +Inf."""
    result: _FloatArray = ranges.astype(np.float64)
    if range_max is None:
        notes.append("no `range_max` in the file: every finite range is read as a return")
        return result
    # In the coarser of the two precisions: 4.1 as float32 is less than 4.1 as float64.
    limit = range_max.ravel()[0]
    coarse = min(ranges.dtype, limit.dtype) if limit.dtype.kind == "f" else ranges.dtype
    far = ranges.astype(coarse) >= limit.astype(coarse)
    result[far] = np.inf
    notes.append(
        f"{np.count_nonzero(far)} of {len(ranges)} ranges are at or above range_max "
        f"{limit:g} m: read as 'nothing seen'"
    )
    return result


def _group_by_position(positions: _Array) -> list[_IntArray]:
    moved = (positions[1:] != positions[:-1]).any(axis=1)
    return list(np.split(np.arange(len(positions)), np.flatnonzero(moved) + 1))


def _group_by_id(path: str, positions: _Array, ids: _Array) -> list[_IntArray]:
    """Rows of each scan, scans in the order in which they first occur."""
    _, first, inverse = np.unique(ids, return_index=True, return_inverse=True)
    elsewhere = (positions != positions[first[inverse]]).any(axis=1)
    if elsewhere.any():
        row = int(np.flatnonzero(elsewhere)[0])
        here, there = positions[row], positions[first[inverse[row]]]
        raise InputError(
            f"{path}: scan {ids[row]} has beams at two positions, ({there[0]:g}, {there[1]:g}) and "
            f"({here[0]:g}, {here[1]:g}): give beams from different positions different numbers"
        )
    rows = np.argsort(inverse, kind="stable")
    groups = np.split(rows, np.cumsum(np.bincount(inverse))[:-1])
    return [groups[i] for i in np.argsort(first)]


def _to_scan(beams: _FloatArray, ranges: _FloatArray) -> Scan:
    headings = beams[:, 2]
    directions = np.stack([np.cos(headings), np.sin(headings)], axis=1)
    return Scan(Pose2(float(beams[0, 0]), float(beams[0, 1]), 0.0), directions, ranges)
