# SPDX-License-Identifier: Apache-2.0
"""Names of sensors: what --sensor may be, and what the sensor of a log is called."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oddsmap.config.config import Config
    from oddsmap.scans.log import Log

__all__ = [
    "check_name",
    "check_width",
    "complete_sensor",
    "may_be_called",
    "sensor_name",
    "sensor_names",
]


def sensor_names() -> dict[str, str]:
    """What --sensor may be, and the kind of sensor model that stands for it."""
    from oddsmap.sensors.registry import NAMES

    return NAMES


def complete_sensor(incomplete: str) -> list[str]:
    """The names that may be meant, for the completion of the shell."""
    return [name for name in sensor_names() if name.startswith(incomplete)]


def check_name(stated: str | None) -> None:
    """Refuse what no sensor is called.

    Raises:
        ConfigError: --sensor says so.
    """
    from oddsmap.errors import ConfigError, did_you_mean

    known = sensor_names()
    if stated is not None and stated not in known:
        raise ConfigError(
            f"--sensor {stated}: not available{did_you_mean(stated, known)} "
            f"(known: {', '.join(known)})"
        )


def sensor_name(log: Log, config: Config) -> str:
    """What --sensor would call a log's sensor, by its readings; a 2D cone is a "sonar" here."""
    from oddsmap.integrate.add import ndim_of
    from oddsmap.scans.depth_image import DepthScan
    from oddsmap.scans.grid_scan import GridScan

    first = next(iter(log), None)
    kind, flat = config.sensor.kind, ndim_of(first) == 2
    if isinstance(first, GridScan):
        return "overhead"
    if kind == "cone":
        return "sonar" if flat else "tof"
    if kind not in ("beam", "overhead"):
        return config.sensor.names[0]
    if flat:
        return "lidar2d"
    return "depth" if isinstance(first, DepthScan) else "lidar3d"


def may_be_called(name: str, stated: str) -> bool:
    """Whether --sensor may call a sensor so: sonars and time-of-flight sensors are both cones."""
    return stated == name or {stated, name} == {"sonar", "tof"}


def check_width(log: Log, stated: str | None) -> None:
    """Refuse the name of another sensor for wide beams: their width would be lost.

    Raises:
        ConfigError: --sensor does not stand for cones, and the log's beams are.
    """
    from oddsmap.errors import ConfigError

    width = log.sensor.get("cone_deg")
    if width is None or stated is None or sensor_names()[stated] == "cone":
        return
    raise ConfigError(
        f"{log.path}: beams are {width:g} degrees wide, --sensor {stated} would lose that: leave "
        "it out, or say sonar or tof (--set sensor.kind=beam maps their axes alone)"
    )
