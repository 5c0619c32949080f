# SPDX-License-Identifier: Apache-2.0
"""The keys of an OctoMap, which end 32768 cells from its origin, and maps that are moved there.

A map in UTM coordinates lies millions of metres from the origin. Moved by whole cells it is the
same map, and what it was moved by has to be known to place it again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.errors import ConfigError, InputError

__all__ = ["HALF", "Shift", "check_keys", "shift_of"]

HALF = 1 << 15
"""The key of cell 0: an OctoMap has this many cells on each side of the origin."""

_STEPS = (10_000.0, 1000.0, 100.0, 10.0, 1.0)  # metres, of which shifts are multiples
_EXACT = 1e-6  # cells, by which a length may miss a whole number of them


@dataclass(frozen=True, slots=True, eq=False)
class Shift:
    """The cell of a map that becomes cell 0 of a file.

    Args:
        cells: its index, shape (3,), x first.
        resolution: side of a cell [m].
    """

    cells: IntArray
    resolution: float

    @property
    def metres(self) -> FloatArray:
        """The point of the map that becomes the origin [m], shape (3,)."""
        return np.asarray(self.cells * self.resolution, np.float64)

    def words(self) -> str:
        """What has to be done to get the map's coordinates back."""
        x, y, z = (_plain(n) for n in self.metres)
        return f"shifted: add {x} {y} {z} [m] to get the coordinates of the map"


def shift_of(metres: Sequence[float], resolution: float) -> Shift:
    """The shift by a point of the map [m], which has to be a corner of cells.

    Raises:
        ConfigError: it is not a whole number of cells away from the map's origin, or not finite.
    """
    cells = np.asarray(metres, np.float64) / resolution
    if not (np.abs(cells) < 2.0**45).all():
        raise ConfigError(f"--shift needs three lengths [m], got {_three(metres)}")
    whole = np.rint(cells)
    if (np.abs(cells - whole) > _EXACT * np.maximum(1.0, np.abs(whole) * 1e-6)).any():
        raise ConfigError(
            f"--shift {_three(metres)}: not a whole number of cells of {_plain(resolution)} m; the "
            f"nearest is --shift {_three(whole * resolution)}"
        )
    return Shift(whole.astype(np.int64), resolution)


def check_keys(
    path: Path,
    bounds: tuple[IntArray, IntArray] | None,
    resolution: float,
    shift: Shift | None = None,
) -> None:
    """Refuse cells outside OctoMap's keys, with what would bring them inside.

    Args:
        path: the file, for the message.
        bounds: the box of known cells, counted as the map does: first index and past the last.
        resolution: side of a cell [m].
        shift: by what they are to be shifted.

    Raises:
        InputError: some are outside.
    """
    if bounds is None:
        return
    before = np.zeros(3, np.int64) if shift is None else shift.cells
    lo, hi = bounds[0] - before, bounds[1] - before
    outside = (lo < -HALF) | (hi > HALF)
    if not outside.any():
        return
    crops = []
    for axis, name in enumerate("xyz"):
        edges = [(int(before[axis]) + end) * resolution for end in (-HALF, HALF)]
        if lo[axis] < -HALF:
            crops.append(f"{name} >= {edges[0]:.10g} m (index {-HALF}, got {lo[axis]})")
        if hi[axis] > HALF:
            crops.append(f"{name} < {edges[1]:.10g} m (index below {HALF}, got {hi[axis] - 1})")
    advice = []
    if ((lo < HALF) & (hi > -HALF)).all():  # something would be left
        advice.append(f"crop to {' and '.join(crops)}")
    found = _fitting(*bounds, resolution)
    if found is not None:
        advice.append(
            f"--shift {_three(found)} moves the map there, and is to be added to get its "
            "coordinates back"
        )
    if not advice:
        sides = " x ".join(str(n) for n in (hi - lo))
        advice.append(f"this map has {sides}: make it of a coarser resolution, or crop it")
    raise InputError(
        f"{path}: an OctoMap has {2 * HALF} cells along each axis, around the origin; "
        f"{', or '.join(advice)}"
    )


def _fitting(lo: IntArray, hi: IntArray, resolution: float) -> FloatArray | None:
    """A shift of round numbers near the middle of a map that does not fit without; None: none.

    Args:
        lo: the map's first cell, as it is without any shift.
        hi: past its last cell.
        resolution: side of a cell [m].
    """
    shift = np.zeros(3)
    for axis in range(3):
        first, past = int(lo[axis]), int(hi[axis])
        if first >= -HALF and past <= HALF:
            continue
        middle = (first + past) / 2
        steps = [round(step / resolution) for step in _STEPS if _is_whole(step / resolution)]
        steps += [1000, 1]  # cells, where no round length is a whole number of them
        for step in steps:
            cells = round(middle / step) * step
            if first - cells >= -HALF and past - cells <= HALF:
                shift[axis] = cells * resolution
                break
        else:
            return None
    return shift


def _is_whole(cells: float) -> bool:
    return cells >= 0.5 and math.isclose(cells, round(cells), rel_tol=1e-9)


def _plain(value: float) -> str:
    """A length with the digits that tell it from others, and no exponent."""
    return np.format_float_positional(float(f"{value:.12g}"), trim="-")


def _three(values: Sequence[float] | FloatArray) -> str:
    return " ".join(_plain(float(value)) for value in values)
