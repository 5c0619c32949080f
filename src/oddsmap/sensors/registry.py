# SPDX-License-Identifier: Apache-2.0
"""The sensor models by name, as `sensor.kind` in a configuration chooses them."""

from __future__ import annotations

from typing import TypeAlias

from oddsmap.scans.depth_image import DepthScan
from oddsmap.scans.scan import Scan
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.overhead import GridScan, OverheadSensor

__all__ = ["KINDS", "CellSensor", "Measurement", "Sensor"]

Measurement: TypeAlias = Scan | DepthScan | GridScan
"""One z_t with its pose."""

Sensor: TypeAlias = BeamSensor | ConeSensor | OverheadSensor

CellSensor: TypeAlias = ConeSensor | OverheadSensor
"""Sensors whose `votes` names the cells itself."""

KINDS: dict[str, type[Sensor]] = {
    kind.kind: kind for kind in (BeamSensor, ConeSensor, OverheadSensor)
}
