# SPDX-License-Identifier: Apache-2.0
"""Faults put into real logs, and what the doctor says: `python -m tests.doctor.table [LOG...]`.

A line a log and fault: "yes" where it is named and nothing else is, else what is named in its
place, and "-" where there is no such fault. First comes the log as it is; what is said of it then
(stamps of CARMEN logs that are all the same, which is right) is left out of the rest.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import oddsmap
from oddsmap.errors import OddsmapError
from oddsmap.scans.depth_image import DepthScan
from oddsmap.scans.log import Log
from oddsmap.scans.scan import Scan
from tests.doctor.faults import (
    drifted,
    in_map,
    late,
    mirrored,
    optical,
    seeing_itself,
    turned,
    with_zeros,
    y_down,
)
from tests.plausibility.faults import (
    headings_in_degrees,
    in_units,
    inverted,
    ranges_in_units,
    spoilt,
    w_first,
)

DATA = Path(os.environ.get("ODDSMAP_DATA", Path(__file__).parents[3] / "shared/data"))
Spoil = Callable[[list[Scan]], Sequence[Scan]]


def each(change: Callable[[Scan], Scan]) -> Spoil:
    return lambda scans: spoilt(scans, change)


FAULTS: dict[str, tuple[Spoil, str]] = {
    "as it is": (list, ""),
    "inverted poses": (each(inverted), "pose.inverted"),
    "headings in degrees (2D)": (each(headings_in_degrees), "pose.headings_in_degrees"),
    "wxyz for xyzw (3D)": (each(w_first), "pose.quaternion_order"),
    "poses in millimetres": (each(in_units(1000)), "pose.unit"),
    "ranges in millimetres": (each(ranges_in_units(1000)), "range.unit"),
    "clock 0.2 s late": (partial(late, seconds=0.2), "clock.offset"),
    "clock 0.5 s early": (partial(late, seconds=-0.5), "clock.offset"),
    "yaw of 5 degrees": (each(partial(turned, degrees=5)), "extrinsics.yaw"),
    "yaw of 90 degrees": (each(partial(turned, degrees=90)), "extrinsics.yaw"),
    "beams in the other order": (each(mirrored), "extrinsics.mirrored"),
    "optical frame for body (3D)": (each(optical), "extrinsics.optical"),
    "y-down world (3D)": (each(y_down), "pose.vertical"),
    "points in the map": (each(in_map), "points.in_map"),
    "robot sees itself": (each(seeing_itself), "range.own_body"),
    "zeros": (each(with_zeros), "range.zero"),
    "each scan twice": (lambda scans: [s for s in scans for _ in (0, 1)], "stamp.repeated"),
    "a part again": (
        lambda scans: scans[: len(scans) // 2] + scans[len(scans) // 3 :],
        "stamp.backward",
    ),
    "odometry that drifts": (drifted, "pose.drift"),
}
ONLY = {"(2D)": 2, "(3D)": 3}


def opened(name: str, data: Path) -> Log:
    if (data / "lidar3d" / name).is_dir():
        folder = data / "lidar3d" / name
        return oddsmap.open_log(folder, poses=folder / "poses_kitti.txt")
    if name == "7scenes":
        return oddsmap.open_log(data / "rgbd" / name)
    return oddsmap.open_log(data / "laser2d" / f"{name}-corrected.log.gz")


def said(scans: Sequence[Scan], range_max: float | None) -> list[str]:
    found = oddsmap.diagnose(scans, range_max=range_max).findings
    return [finding.code for finding in found]


def row(name: str) -> None:
    log = opened(name, DATA)
    scans = [scan.to_scan() if isinstance(scan, DepthScan) else scan for scan in log]
    limit = log.sensor.get("range_max")
    d = scans[0].directions.shape[1]
    usual: list[str] = []
    for fault, (spoil, code) in FAULTS.items():
        answer = "-"
        if ONLY.get(fault[-4:], d) == d:
            try:
                bad = spoil(scans)
                codes = said(bad, limit * 1000 if "ranges in" in fault and limit else limit)
            except (OddsmapError, TypeError) as error:
                answer = f"cannot be made: {error}"
            else:
                if not code:
                    usual, answer = codes, ", ".join(codes) or "nothing"
                else:
                    rest = [said_now for said_now in codes if said_now not in usual]
                    named = code in codes and set(rest) <= {code}
                    answer = "yes" if named else ", ".join(rest) or "no"
        print(f"{name:14} {fault:28} {answer}", flush=True)  # noqa: T201


if __name__ == "__main__":
    for log_name in sys.argv[1:] or ["intel", "freiburg-079", "hall_os0", "hku1_avia", "7scenes"]:
        row(log_name)
