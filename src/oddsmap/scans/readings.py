# SPDX-License-Identifier: Apache-2.0
"""Readings as people have them: lists, arrays of any numbers, masked arrays; checked."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError, shown

__all__ = ["angles_in", "check_unit", "metres", "numbers"]

# Of the square of a length. Vectors of float32, normalised, are off by some 2e-7.
_OFF_UNIT = 2e-6
# A sweep that counts on from turn to turn is not met; degrees are.
_MOST_RADIANS = 4 * np.pi


def numbers(given: npt.ArrayLike, name: str) -> FloatArray:
    """Numbers as float64; an array that is one is not copied, and what is masked becomes NaN.

    Raises:
        InputError: they are none, or form no array.
    """
    if isinstance(given, np.ma.MaskedArray):
        return np.where(np.ma.getmaskarray(given), np.nan, given.data.astype(np.float64))
    try:
        found = np.asarray(given)
        if found.dtype.kind in "biufO":
            return found.astype(np.float64, copy=False)
    except (TypeError, ValueError):
        pass
    raise InputError(f"{name}: an array of numbers is needed, got {shown(given)}")


def metres(given: npt.ArrayLike, name: str) -> FloatArray:
    """Lengths [m] as float64; errors as in `numbers`, and where they are unsigned integers."""
    if isinstance(given, np.ndarray) and given.dtype.kind == "u":
        raise InputError(
            f"{name} are metres, got {given.dtype}, as sensors write millimetres or steps: convert "
            f"them ({name} * 0.001)"
        )
    return numbers(given, name)


def angles_in(given: npt.ArrayLike) -> FloatArray:
    """Angles of beams [rad], shape (n,); one alone may be a number.

    Raises:
        InputError: another shape, not finite, or beyond two turns, as degrees are.
    """
    angles = np.atleast_1d(numbers(given, "angles"))
    if angles.ndim != 1:
        raise InputError(f"the angles of beams have shape (n,), got {angles.shape}")
    if not np.isfinite(angles).all():
        i = int(np.flatnonzero(~np.isfinite(angles))[0])
        raise InputError(f"the angle of beam {i} is {angles[i]}: every beam needs a direction")
    largest = float(np.abs(angles).max(initial=0.0))
    if largest > _MOST_RADIANS:
        raise InputError(
            f"angles are in radians, from the sensor's x axis; got up to {largest:g}: if they are "
            "degrees, give numpy.deg2rad(angles)"
        )
    return angles


def check_unit(directions: FloatArray, ranges: FloatArray) -> None:
    """Refuse directions that are no unit vectors, where the beam says something.

    Args:
        directions: shape (n, d).
        ranges: shape (n,).

    Raises:
        InputError: with the first that is none.
    """
    if not len(directions):
        return
    with np.errstate(invalid="ignore", over="ignore"):
        off: Any = directions[:, 0] * directions[:, 0]
        for k in range(1, directions.shape[1]):
            off += directions[:, k] * directions[:, k]
        off -= 1.0
        if off.min() >= -_OFF_UNIT and off.max() <= _OFF_UNIT:
            return
        wrong = ~(np.abs(off) <= _OFF_UNIT) & ~(np.isnan(ranges) | (ranges <= 0.0))
        wrong &= np.isfinite(directions).all(axis=1)  # the others are counted where they are used
    if wrong.any():
        i = int(np.flatnonzero(wrong)[0])
        length = float(np.sqrt((directions[i] ** 2).sum()))
        raise InputError(
            f"the direction of beam {i} has length {length:.6g}: directions are unit vectors; ends "
            "of beams are points, for Scan.from_points, and angles for Scan.from_angles"
        )
