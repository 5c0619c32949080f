# SPDX-License-Identifier: Apache-2.0
"""How a log is read: the options beside its path, and what their values mean."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oddsmap.poses.pose import Pose3
    from oddsmap.readers.options import PointFrame
    from oddsmap.scans.depth_image import PinholeCamera
    from oddsmap.scans.log import Log

__all__ = ["LogOptions", "read_camera", "read_extrinsics"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LogOptions:
    """Arguments of `oddsmap.open_log`, described there, the same for each log of a command."""

    poses: Path | None = None
    times: Path | None = None
    tolerance: float | None = None
    extrinsics: Pose3 | None = None
    camera: PinholeCamera | None = None
    skip_bad: bool = False
    points_in: PointFrame | None = None
    origin: tuple[float, float, float] | None = None
    columns: str | None = None
    depth_scale: float | None = None
    scans: tuple[str, ...] = ()
    frame: str | None = None
    clock_offset: float = 0.0
    deskew: str = "auto"

    def files(self, *logs: Path) -> list[Path | None]:
        """The files that these options name, to be checked before any work is done.

        The poses of a recording may be a topic; where they are neither, opening it says so.
        """
        if self.poses is not None and not self.poses.exists():
            from oddsmap.readers.recorded import is_recording

            if any(is_recording(str(log)) for log in logs):
                return [self.times]
        return [self.poses, self.times]

    def open(self, path: Path) -> Log:
        """Open a log.

        Raises:
            OddsmapError: see `oddsmap.open_log`.
        """
        from oddsmap.readers import open_log

        return open_log(
            path,
            poses=self.poses,
            times=self.times,
            tolerance_s=self.tolerance,
            body_from_sensor=self.extrinsics,
            camera=self.camera,
            skip_bad=self.skip_bad,
            points_in=self.points_in,
            origin=self.origin,
            columns=self.columns,
            depth_scale=self.depth_scale,
            scans=self.scans,
            frame=self.frame,
            clock_offset_s=self.clock_offset,
            deskew={"on": True, "off": False}.get(self.deskew),
        )


def read_extrinsics(text: str | None) -> Pose3 | None:
    """What --body-from-sensor says: seven numbers, or a file.

    Raises:
        ConfigError: neither.
    """
    from oddsmap.poses.pose import Pose3

    if text is None:
        return None
    if text and Path(text).is_file():
        from oddsmap.readers.kitti_calib import read_extrinsics_file

        return read_extrinsics_file(text)
    numbers = _numbers("--body-from-sensor", text, "x y z qx qy qz qw")
    return Pose3.from_quaternion_xyzw(numbers[:3], numbers[3:])


def read_camera(text: str | None) -> PinholeCamera | None:
    """What --camera says.

    Raises:
        ConfigError: not six numbers.
    """
    from oddsmap.scans.depth_image import PinholeCamera

    if text is None:
        return None
    fx, fy, cx, cy, width, height = _numbers("--camera", text, "fx fy cx cy width height")
    return PinholeCamera(fx, fy, cx, cy, int(width), int(height))


def _numbers(option: str, text: str, names: str) -> list[float]:
    from oddsmap.errors import ConfigError

    try:
        numbers = [float(part) for part in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) != len(names.split()) or not all(map(math.isfinite, numbers)):
        raise ConfigError(f'{option} "{text}": needs the numbers {names}')
    return numbers
