# SPDX-License-Identifier: Apache-2.0
"""What the options of `oddsmap build` and its kin say: settings, sensors, calibration."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from oddsmap.config.config import Config
    from oddsmap.poses.pose import Pose3
    from oddsmap.scans.depth_image import PinholeCamera
    from oddsmap.scans.log import Log

__all__ = [
    "SENSORS",
    "Layer",
    "Layers",
    "check_estimator",
    "check_sections",
    "check_width",
    "cores",
    "doubts",
    "names_of",
    "read_camera",
    "read_extrinsics",
    "resolved",
    "sensor_name",
    "setting_layers",
]

SENSORS = {
    "lidar2d": "beam",
    "lidar3d": "beam",
    "depth": "beam",
    "sonar": "cone",
    "tof": "cone",
    "overhead": "overhead",
}
"""What --sensor may say, and the kind of sensor model that stands for it."""


def sensor_name(log: Log, settled: Config) -> str:
    """What --sensor would call the sensor of a log; a cone of the plane is a "sonar" here."""
    if hasattr(log, "depth_scans"):
        return "depth"
    from oddsmap.poses.pose import Pose2
    from oddsmap.scans.grid_scan import GridScan

    first = next(iter(log), None)
    if isinstance(first, GridScan):
        return "overhead"
    flat = first is None or isinstance(first.map_from_sensor, Pose2)
    if settled.sensor.kind == "cone":
        return "sonar" if flat else "tof"
    return "lidar2d" if flat else "lidar3d"


def names_of(kind: str) -> tuple[str, ...]:
    """What --sensor may call a sensor: sonars and time-of-flight sensors are both cones."""
    return ("sonar", "tof") if kind in ("sonar", "tof") else (kind,)


def check_width(log: Log, sensor: str | None) -> None:
    """Refuse the name of another sensor for wide beams: their width would be lost.

    Raises:
        ConfigError: --sensor does not stand for cones, and the log's beams are.
    """
    from oddsmap.errors import ConfigError

    width = log.sensor.get("cone_deg")
    if width is None or sensor is None or SENSORS[sensor] == "cone":
        return
    raise ConfigError(
        f"{log.path}: beams are {width:g} degrees wide, --sensor {sensor} would lose that: leave "
        "it out, or say sonar or tof (--set sensor.kind=beam maps their axes alone)"
    )


def doubts(log: Log, settled: Config) -> list[str]:
    """What a person should know of settings that do not fit the log."""
    found = []
    width = log.sensor.get("cone_deg")
    if width is not None and settled.sensor.kind == "beam":
        found.append(f"beams are {width:g} degrees wide, sensor.kind beam maps their axes alone")
    said, given = log.sensor.get("range_max"), getattr(settled.sensor, "range_max", None)
    if said is not None and given is not None and given > said:
        found.append(
            f"range_max {given:g} is above the {said:g} m that this log writes where nothing was "
            "seen: such readings now count as obstacles"
        )
    return found


def _numbers(option: str, text: str, names: str) -> list[float]:
    from oddsmap.errors import ConfigError

    try:
        numbers = [float(part) for part in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) != len(names.split()) or not all(map(math.isfinite, numbers)):
        raise ConfigError(f'{option} "{text}": needs the numbers {names}')
    return numbers


def read_extrinsics(text: str | None) -> Pose3 | None:
    """What --body-from-sensor says."""
    from oddsmap.poses.pose import Pose3

    if text is None:
        return None
    numbers = _numbers("--body-from-sensor", text, "x y z qx qy qz qw")
    return Pose3.from_quaternion_xyzw(numbers[:3], numbers[3:])


def read_camera(text: str | None) -> PinholeCamera | None:
    """What --camera says."""
    from oddsmap.scans.depth_image import PinholeCamera

    if text is None:
        return None
    fx, fy, cx, cy, width, height = _numbers("--camera", text, "fx fy cx cy width height")
    return PinholeCamera(fx, fy, cx, cy, int(width), int(height))


Layer = dict[str, dict[str, Any]]
Layers = list[tuple[str, Layer]]


def setting_layers(config: Path | None, flags: Layer, settings: list[str]) -> Layers:
    """Layers of settings, the strongest last: the file, the options by name, --set."""
    from oddsmap.config.config import parse_setting, read_toml

    layers: Layers = []
    if config is not None:
        layers.append((str(config), read_toml(config)))
    for section, fields in flags.items():
        given = {name: value for name, value in fields.items() if value is not None}
        layers.append(("options", {section: given}))
    for text in settings:
        section, name, value = parse_setting(text)
        layers.append((f"--set {text}", {section: {name: value}}))
    return layers


def check_estimator(layers: Layers, estimator: str) -> None:
    """Refuse settings that the estimator would not look at.

    Raises:
        ConfigError: a field of full_map is set for the filter, or posterior.prior for a full map.
    """
    from oddsmap.errors import ConfigError

    for where, values in layers:
        of_full_map = list(values.get("full_map", {}))
        if estimator == "filter" and of_full_map:
            name = of_full_map[0]
            rest = "set posterior.prior for the filter" if name == "prior" else "leave it out"
            raise ConfigError(
                f"{where}: full_map.{name} belongs to --estimator full-map, the filter would not "
                f"look at it: {rest}, or add --estimator full-map"
            )
        if estimator == "full-map" and "prior" in values.get("posterior", {}):
            raise ConfigError(
                f"{where}: posterior.prior belongs to --estimator filter, a full map would not "
                "look at it: set full_map.prior"
            )


def check_sections(layers: Layers, command: str, *used: str) -> None:
    """Refuse --set of a section that a command does not look at; a file may serve other commands.

    Raises:
        ConfigError: there is one.
    """
    from oddsmap.errors import ConfigError

    for where, values in layers:
        unused = [section for section in values if section not in used]
        if unused and where.startswith("--set "):
            wanted = ", ".join(f"{section}.*" for section in used)
            raise ConfigError(
                f"{where}: oddsmap {command} does not look at {unused[0]}.*, only at {wanted}: "
                "leave it out"
            )


def cores() -> int:
    """How many threads to work with where nothing is said."""
    if hasattr(os, "sched_getaffinity"):  # not on macOS and Windows
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def resolved(layers: Layers, log: Log) -> Config:
    """The configuration for a log: what it says of its sensor, and the layers above."""
    from oddsmap.config.config import resolve
    from oddsmap.sensors.registry import stated_of_sensor

    said = [values["sensor"]["kind"] for _, values in layers if "kind" in values.get("sensor", {})]
    kind = said[-1] if said else None
    first = None if kind is not None or hasattr(log, "depth_scans") else next(iter(log), None)
    return resolve(("log", {"sensor": stated_of_sensor(log, kind, first=first)}), *layers)
