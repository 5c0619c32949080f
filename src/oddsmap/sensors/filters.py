# SPDX-License-Identifier: Apache-2.0
"""Settings that keep readings from marking, or from counting at all: where they apply, and how."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from oddsmap.array_types import BoolArray, FloatArray
from oddsmap.errors import ConfigError
from oddsmap.scans.scan import Scan
from oddsmap.scans.scan_part import part_of

__all__ = [
    "NO_BODY",
    "AngleWindow",
    "beams_within",
    "body_box",
    "check_body",
    "check_filters",
    "within_window",
]

AngleWindow = tuple[float, float] | None
"""Lowest and highest azimuth of a beam that counts [rad]; None: all count."""

NO_BODY = np.array([[math.inf] * 3, [-math.inf] * 3])
"""Corners of a box in which no point lies."""

Corner = tuple[float, ...] | None

# A beam at a limit of the window is within: its azimuth is known to a few roundings [rad].
_AT_LIMIT = 1e-9


def check_body(low: Corner, high: Corner) -> None:
    """Check the corners of a body's box.

    Raises:
        ConfigError: one is missing, they have no two or three numbers each, or are out of order.
    """
    if (low is None) != (high is None):
        raise ConfigError("sensor.body_min and body_max make a box: set both or none")
    if low is None or high is None:
        return
    if len(low) != len(high) or len(low) not in (2, 3):
        wrong = True
    else:
        corners = np.array([low, high], np.float64)
        wrong = not (np.isfinite(corners) & (corners[0] < corners[1])).all()
    if wrong:
        raise ConfigError(
            "sensor.body_min and body_max are two lengths each in 2D and three in 3D, min below "
            f"max, got {low} and {high}"
        )


def body_box(low: Corner, high: Corner) -> FloatArray:
    """Corners of the body's box in the sensor frame [m], shape (2, 3); in 2D of any height."""
    if low is None or high is None:
        return NO_BODY
    heights = [] if len(low) == 3 else [math.inf]
    return np.array([[*low, *(-z for z in heights)], [*high, *heights]], np.float64)


def check_filters(
    d: int, heights: tuple[float, float], body: FloatArray, window: AngleWindow = None
) -> None:
    """Refuse filters that do not go with scans of d dimensions.

    Raises:
        ConfigError: heights in 2D, angles in 3D, or a body's box of another dimension.
    """
    if d == 2 and heights != (-math.inf, math.inf):
        raise ConfigError("sensor.mark_z_min and mark_z_max are for 3D scans: these are 2D")
    if d == 3 and window is not None:
        raise ConfigError(
            "sensor.angle_min and angle_max are for 2D scans: these are 3D, where "
            "sensor.body_min and body_max keep a part of the robot from marking"
        )
    if (body[0] > body[1]).any():
        return
    has = 3 if np.isfinite(body[:, 2]).all() else 2
    if has != d:
        wanted = "two numbers, x and y" if d == 2 else "three numbers, x, y and z"
        raise ConfigError(
            f"sensor.body_min and body_max have {has} numbers each, and these scans are {d}D: "
            f"give {wanted}"
        )


def beams_within(scans: Sequence[Scan], window: AngleWindow) -> tuple[list[Scan], dict[int, int]]:
    """The scans with the beams whose azimuth lies in a window alone.

    A beam outside says nothing: it neither marks nor clears. One whose direction is no number
    stays, to be counted as such.

    Args:
        scans: of beams.
        window: which azimuths count, in the sensor frame at the time of the beam.

    Returns:
        The scans, and how many beams each has lost, by the `id` of the new scan.
    """
    if window is None:
        return list(scans), {}
    # Scans of one sensor share their directions, and must go on to: that saves most of the time.
    known: dict[tuple[int, int], tuple[BoolArray, FloatArray]] = {}
    kept, lost = [], {}
    for scan in scans:
        key = id(scan.directions), id(scan.own_vectors)
        if key not in known:
            within = within_window(scan, window)
            known[key] = within, scan.directions[within]
        within, directions = known[key]
        part = part_of(scan, within, directions)
        kept.append(part)
        lost[id(part)] = scan.size - part.size
    return kept, lost


def within_window(scan: Scan, window: tuple[float, float]) -> BoolArray:
    """Whether the azimuth of each beam lies in a window, shape (n,)."""
    low, high = window
    directions = scan.directions if scan.own_vectors is None else scan.own_vectors
    azimuth = np.arctan2(directions[:, 1], directions[:, 0])
    # By whole turns from the lower limit: a window may lie across the back.
    after = np.mod(azimuth - low + _AT_LIMIT, 2 * math.pi)
    return np.asarray(~(after > high - low + 2 * _AT_LIMIT))
