# SPDX-License-Identifier: Apache-2.0
"""Doubts: what to know where settings do not fit a log and nobody requested that."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oddsmap.cli.setting_layers import SettingLayers
    from oddsmap.config.config import Config
    from oddsmap.scans.log import Log
    from oddsmap.scans.note import Note
    from oddsmap.sensors.registry import Sensor

__all__ = ["doubt_of_estimator", "doubt_of_sensor", "doubts_of_settings"]

# Calibration may find a width that differs from the one in the log, but not by such a factor.
_ANOTHER_WIDTH = 1.5
# Settings of where the robot itself is.
_ON_THE_ROBOT = ("body_min", "angle_min", "angle_max")
# What the filter does not look at in a sensor of wide beams.
_FORWARD = ("detection", "p_random", "p_dropout", "sigma")


def doubts_of_settings(log: Log, config: Config) -> list[Note]:
    """What to say of a map that a log is made into with this configuration."""
    found = []
    width = log.sensor.get("cone_deg")
    if width is not None and config.sensor.kind == "beam":
        found.append(
            _doubt(
                f"beams are {width:g} degrees wide, sensor.kind beam maps their axes alone",
                "sensor.width",
            )
        )
    written, used = log.sensor.get("range_max"), getattr(config.sensor, "range_max", None)
    if written is not None and used is not None and used > written:
        found.append(
            _doubt(
                f"range_max {used:g} is above the {written:g} m that this log writes where nothing "
                "was seen: such readings now count as obstacles",
                "sensor.range_max",
            )
        )
    turning = [name for name in _ON_THE_ROBOT if getattr(config.sensor, name, None) is not None]
    if turning and log.format == "NPZ beam log":
        found.append(
            _doubt(
                f"sensor.{turning[0]} is in the sensor frame, and this log has the directions of "
                "its beams in the map frame: what is set does not turn with the robot",
                "sensor.frame",
            )
        )
    return found


def doubt_of_estimator(layers: SettingLayers, config: Config, estimator: str) -> Note | None:
    """A doubt where a sensor of wide beams was described for a full map, and none is made."""
    stated = [name for name in _FORWARD if name in layers.fields("sensor")]
    if estimator == "full-map" or config.sensor.kind != "cone" or not stated:
        return None
    return _doubt(
        f"the filter does not look at {', '.join(f'sensor.{name}' for name in stated)} of wide "
        "beams, but maps by p_hit and p_miss: --estimator full-map uses what was found or set",
        "sensor.estimator",
    )


def doubt_of_sensor(log: Log, sensor: Sensor, layers: SettingLayers) -> Note | None:
    """A doubt where a log's beams are not as wide as predicted, and nobody requested that."""
    from oddsmap.sensors.registry import stated_of_sensor

    requested = layers.fields("sensor")
    stated = stated_of_sensor(log, decided=requested)
    theirs, ours = stated.get("cone_deg", 0.0), getattr(sensor, "cone_deg", 0.0)
    if stated["kind"] == sensor.kind:
        narrow, wide = sorted((theirs, ours))
        if "cone_deg" in requested or wide <= _ANOTHER_WIDTH * narrow:
            return None
    elif "kind" in requested:
        return None
    words = [
        f"{width:g} degrees wide (sensor.kind {kind})" if width else f"narrow (sensor.kind {kind})"
        for kind, width in ((stated["kind"], theirs), (sensor.kind, ours))
    ]
    return _doubt(
        f"by what it says of its sensor its beams are {words[0]}, those of the map's sensor are "
        f"{words[1]}: they were scored as the latter (--set sensor.kind, sensor.cone_deg)",
        "sensor.width",
    )


def _doubt(text: str, code: str) -> Note:
    from oddsmap.scans.note import Note

    return Note(text, code=code, severity="warning")
