# SPDX-License-Identifier: Apache-2.0
"""NPZ grid logs: what a sensor saw of the cells around it, pose by pose.

| key | |
|---|---|
| `grids` | (n, h, w): rows = y (left) of the sensor ascending, columns = x (forward). bool or whole numbers: 0 free, 1 occupied, 255 not seen. Real numbers: p(occupied) at prior 1/2, NaN not seen |
| `poses` | (n, 3): x [m], y [m], heading [rad] of the sensor in the map frame |
| `pixel` | side of a pixel [m] |
| `corner` | (2,), optional: lower left corner of pixel (0, 0) in the sensor frame [m]; without it, the grid is centred on the sensor |
| `stamp_ns` | (n,) whole numbers, optional: time of each grid [ns] |

Other keys are ignored.
"""  # noqa: E501 - a table

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose2
from oddsmap.readers.compression import Source
from oddsmap.readers.npz_arrays import load_arrays
from oddsmap.scans.grid_scan import GridScan
from oddsmap.scans.log import SensorInfo
from oddsmap.scans.log_items import LogItems
from oddsmap.scans.note import Note

__all__ = ["GridLog", "open_npz_grids"]

_Array = npt.NDArray[Any]

_NOT_SEEN = 255
_KEYS = ("grids", "poses", "pixel", "corner", "stamp_ns")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class GridLog(LogItems):
    """Grids in memory as they are in the file: scans are made of them while one iterates.

    Satisfies the `Log` protocol. A label takes 1 byte here and 8 in a `GridScan`.

    Args:
        path: where the log was read from, as the caller wrote it.
        grids: labels or probabilities, shape (n, h, w).
        pose_rows: x [m], y [m] and heading [rad], shape (n, 3).
        pixel: side of a pixel [m].
        corner: lower left corner of pixel (0, 0) in the sensor frame [m].
        stamps_ns: time of each grid [ns], shape (n,), or None.
        skipped: what could not be read, by reason.
        notes: what a person should know of this log, one sentence each.
    """

    path: str
    grids: _Array
    pose_rows: npt.NDArray[np.float64]
    pixel: float
    corner: tuple[float, float]
    stamps_ns: npt.NDArray[np.int64] | None
    skipped: Counter[str]
    notes: tuple[Note, ...]
    format: str = "NPZ grid log"
    sensor: Mapping[str, float] = field(default_factory=dict)

    @property
    def sensors(self) -> Mapping[str, SensorInfo]:
        """The one sensor, as far as the log describes it."""
        return {"": SensorInfo(self.sensor)}

    @property
    def scan_count(self) -> int:
        """How many grids there are."""
        return len(self.grids)

    def __len__(self) -> int:
        """How many grids there are."""
        return len(self.grids)

    def __iter__(self) -> Iterator[GridScan]:
        """The grids in file order; can be started again."""
        for i, (grid, pose) in enumerate(zip(self.grids, self.pose_rows.tolist(), strict=True)):
            seen = grid.astype(np.float64)
            if grid.dtype.kind in "iu":
                seen[grid == _NOT_SEEN] = np.nan
            stamp_ns = None if self.stamps_ns is None else int(self.stamps_ns[i])
            yield GridScan(Pose2(*pose), seen, self.pixel, self.corner, stamp_ns, number=i)


def open_npz_grids(source: Source) -> GridLog:
    """Read an NPZ grid log.

    Args:
        source: the decompressed content.

    Returns:
        One scan for each grid. Those of a pose that is not finite are among them: the sensor model
        skips and counts them.

    Raises:
        InputError: a corrupt file, a missing or misshapen array, labels other than 0, 1 and 255,
            probabilities outside [0, 1], or no grid with a finite pose in which anything is seen.
    """
    path = source.path
    arrays = load_arrays(source, _KEYS, "grids", "write grids (n, h, w) and poses (n, 3)")
    grids = _check_grids(path, arrays["grids"])
    poses = _numbers(path, arrays, "poses", (len(grids), 3), "x, y, heading of each grid")
    poses = poses.astype(np.float64)
    # By way of its text: 0.05 stored as float32 means 0.05, not 0.05000000074505806.
    pixel = float(str(_numbers(path, arrays, "pixel", None, "the side of a pixel in metres")[0]))
    if not 0.0 < pixel < math.inf:
        raise InputError(f"{path}: `pixel` is {pixel:g}: it must be positive and finite, in metres")
    _, height, width = grids.shape
    left, low = -width * pixel / 2, -height * pixel / 2
    if "corner" in arrays:
        what = "x, y of the lower left corner of pixel (0, 0)"
        left, low = _numbers(path, arrays, "corner", (2,), what).astype(np.float64).tolist()
        if not (math.isfinite(left) and math.isfinite(low)):
            raise InputError(f"{path}: `corner` is {left:g}, {low:g}: it must be finite, in metres")
    placed = np.isfinite(poses).all(axis=1)
    if not any(_is_seen(grid).any() for grid in grids[placed]):
        raise InputError(
            f"{path}: no usable scan, none of {len(grids)} grids has a finite pose and a pixel "
            "that was seen: check what wrote the file"
        )
    return GridLog(
        path=path,
        grids=grids,
        pose_rows=poses,
        pixel=pixel,
        corner=(left, low),
        stamps_ns=_check_stamps(path, arrays, len(grids)),
        skipped=source.initial_skipped(),
        notes=(
            *source.initial_notes(),
            Note(
                f"grids of {height} x {width} {_what_is_in(grids)}, pixels of {pixel:g} m",
                code="grid.size",
            ),
        ),
    )


def _check_grids(path: str, grids: _Array) -> _Array:
    if grids.ndim != 3 or grids.size == 0:
        raise InputError(
            f"{path}: `grids` has shape {grids.shape}: it must be (n, h, w), none of them 0"
        )
    if grids.dtype.kind not in "biuf":
        raise InputError(f"{path}: `grids` holds {grids.dtype}: it must hold labels or numbers")
    for i, grid in enumerate(grids):  # one by one: temporary arrays of all would take too much
        fine = (grid >= 0) & (grid <= 1) | ~_is_seen(grid)
        if not fine.all():
            row, column = (int(at) for at in np.argwhere(~fine)[0])
            wanted = (
                "probabilities are 0 to 1, NaN where not seen"
                if grids.dtype.kind == "f"
                else "labels are 0 free, 1 occupied, 255 not seen"
            )
            raise InputError(
                f"{path}: `grids` holds {grid[row, column]:g} in grid {i}, row {row}, column "
                f"{column}: {wanted}"
            )
    return grids


def _is_seen(grid: _Array) -> npt.NDArray[np.bool_]:
    return ~np.isnan(grid) if grid.dtype.kind == "f" else np.asarray(grid != _NOT_SEEN)


def _what_is_in(grids: _Array) -> str:
    return "probabilities" if grids.dtype.kind == "f" else "labels"


def _numbers(
    path: str, arrays: Mapping[str, _Array], key: str, shape: tuple[int, ...] | None, what: str
) -> _Array:
    """An array of real numbers of a shape; None: one number, whatever shape it is in."""
    if key not in arrays:
        raise InputError(f"{path}: no array `{key}` in the NPZ file: write {what}")
    array = arrays[key]
    fits = array.size == 1 if shape is None else array.shape == shape
    if not fits or array.dtype.kind not in "iuf":
        form = "one number" if shape is None else f"real numbers of shape {shape}"
        raise InputError(
            f"{path}: `{key}` holds {array.dtype} of shape {array.shape}: it must be {form}, {what}"
        )
    return array.ravel() if shape is None else array


def _check_stamps(
    path: str, arrays: Mapping[str, _Array], count: int
) -> npt.NDArray[np.int64] | None:
    if "stamp_ns" not in arrays:
        return None
    stamps = arrays["stamp_ns"]
    if stamps.shape != (count,) or stamps.dtype.kind not in "iu":
        raise InputError(
            f"{path}: `stamp_ns` holds {stamps.dtype} of shape {stamps.shape}: "
            f"it must hold one whole number of nanoseconds for each of the {count} grids"
        )
    return stamps.astype(np.int64)
