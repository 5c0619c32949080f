# SPDX-License-Identifier: Apache-2.0
"""What callers give where scans are wanted: a log, some scans, one; and what is none."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from typing import Any, TypeVar

from oddsmap.errors import InputError, shown
from oddsmap.scans.depth_image import DepthScan
from oddsmap.scans.grid_scan import GridScan
from oddsmap.scans.scan import Scan

__all__ = ["scans_alone", "scans_given"]

T = TypeVar("T")

_KINDS = (Scan, DepthScan, GridScan)


def scans_given(given: Any) -> Any:
    """A log or scans as they are; one scan as a list.

    A list is looked through at once, so that nothing is done where one of it is no scan; what comes
    from elsewhere goes through `scans_alone` when it is read.

    Raises:
        InputError: a path, an array or another thing that holds no scans.
    """
    if isinstance(given, _KINDS):
        return [given]
    if isinstance(given, str | os.PathLike):
        raise InputError(
            f"a log or scans are wanted, got the path {shown(os.fspath(given))}: open it with "
            "oddsmap.open_log(path), and see what the notes of the log say"
        )
    if not isinstance(given, Iterable):
        raise InputError(f"a log or scans are wanted, got {_what(given)}")
    if isinstance(given, list | tuple):
        for _ in scans_alone(given):
            pass
    return given


def scans_alone(scans: Iterable[T]) -> Iterator[T]:
    """The scans one by one.

    Raises:
        InputError: one is none.
    """
    for number, scan in enumerate(scans):
        if not isinstance(scan, _KINDS):
            raise InputError(
                f"scan {number} is {_what(scan)}, no scan: make one with Scan.from_angles(pose, "
                "angles, ranges), Scan.from_points(pose, points) or DepthScan.from_depth(pose, "
                "depth, camera)"
            )
        yield scan


def _what(given: object) -> str:
    name = type(given).__name__
    shape = getattr(given, "shape", None)
    if shape:
        return f"an array of shape {shape}"
    return f"the number {given:g}" if isinstance(given, int | float) else f"a {name}"
