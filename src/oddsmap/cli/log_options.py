# SPDX-License-Identifier: Apache-2.0
"""How a log is read: the options beside its path, and what their values mean."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oddsmap.cli.options import (
    BodyFromSensor,
    Camera,
    ClockOffset,
    Columns,
    DepthScale,
    Deskew,
    Frame,
    Origin,
    PointsIn,
    Poses,
    Scans,
    SkipBad,
    Times,
    Tolerance,
)

if TYPE_CHECKING:
    from oddsmap.poses.pose import Pose3
    from oddsmap.readers.options import PointFrame
    from oddsmap.scans.depth_image import PinholeCamera
    from oddsmap.scans.log import Log

__all__ = ["LogOptions", "read_camera", "read_extrinsics", "takes_log_options"]


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
    words: tuple[str, ...] = field(default=(), compare=False)
    """The options as they are typed, for commands that others are told of: files by their names."""

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

        return open_log(path, **self.arguments())

    def arguments(self) -> dict[str, Any]:
        """The same as arguments of `oddsmap.open_log`."""
        return {
            "poses": self.poses,
            "times": self.times,
            "tolerance_s": self.tolerance,
            "body_from_sensor": self.extrinsics,
            "camera": self.camera,
            "skip_bad": self.skip_bad,
            "points_in": self.points_in,
            "origin": self.origin,
            "columns": self.columns,
            "depth_scale": self.depth_scale,
            "scans": self.scans,
            "frame": self.frame,
            "clock_offset_s": self.clock_offset,
            "deskew": {"on": True, "off": False}.get(self.deskew),
        }


def _read(
    *,
    poses: Poses = None,
    times: Times = None,
    tolerance: Tolerance = None,
    scans: Scans = None,
    frame: Frame = None,
    clock_offset: ClockOffset = 0.0,
    deskew: Deskew = "auto",
    extrinsics: BodyFromSensor = None,
    camera: Camera = None,
    points_in: PointsIn = None,
    origin: Origin = None,
    columns: Columns = None,
    depth_scale: DepthScale = None,
    skip_bad: SkipBad = False,
) -> LogOptions:
    """What the command line says; errors as in `read_extrinsics` and `read_camera`."""
    return LogOptions(
        poses=poses,
        times=times,
        tolerance=tolerance,
        scans=tuple(scans or ()),
        frame=frame,
        clock_offset=clock_offset,
        deskew=deskew,
        extrinsics=read_extrinsics(extrinsics),
        camera=read_camera(camera),
        points_in=points_in,
        origin=origin,
        columns=columns,
        depth_scale=depth_scale,
        skip_bad=skip_bad,
    )


def takes_log_options(command: Callable[..., None]) -> Callable[..., None]:
    """Let a command take every option of `_read` where it says `log_options: LogOptions`.

    Typer goes by signatures, so the command, whose arguments are keywords, gets one of all of them.
    """
    own = inspect.signature(command, eval_str=True)
    options = inspect.signature(_read, eval_str=True).parameters
    expanded: list[inspect.Parameter] = []
    for parameter in own.parameters.values():
        if parameter.name == "log_options":
            expanded += options.values()
        else:
            expanded.append(parameter)

    @wraps(command)
    def with_options(**given: Any) -> None:
        values = {name: given.pop(name) for name in options}
        log_options = replace(_read(**values), words=_typed(options, values))
        command(log_options=log_options, **given)

    with_options.__signature__ = own.replace(parameters=expanded)  # type: ignore[attr-defined]
    with_options.__annotations__ = {part.name: part.annotation for part in expanded}
    return with_options


def _typed(options: Mapping[str, inspect.Parameter], values: Mapping[str, Any]) -> tuple[str, ...]:
    """The words that say these values, as far as they are not the defaults."""
    words: list[str] = []
    for name, parameter in options.items():
        value = values[name]
        if value is None or value == parameter.default or value == []:
            continue
        (declared,) = parameter.annotation.__metadata__
        # Of an annotation Typer keeps the first name as the default.
        option = next(w for w in (declared.default, *declared.param_decls) if w.startswith("--"))
        for each in value if isinstance(value, list) else [value]:
            said = [] if each is True else each if isinstance(each, tuple) else [each]
            # Where the files lie is nobody else's business.
            paths = [Path(str(word)) for word in said]
            words += [option, *(p.name if p.exists() else str(p) for p in paths)]
    return tuple(words)


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
