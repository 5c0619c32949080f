# SPDX-License-Identifier: Apache-2.0
"""The sensor models by name, as `sensor.kind` in a configuration chooses them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, TypeAlias

from oddsmap.scans.grid_scan import GridScan
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.overhead import OverheadSensor

__all__ = ["KINDS", "CellSensor", "Sensor"]

Sensor: TypeAlias = BeamSensor | ConeSensor | OverheadSensor

CellSensor: TypeAlias = ConeSensor | OverheadSensor
"""Sensors whose `votes` names the cells itself."""

KINDS: dict[str, type[Sensor]] = {
    kind.kind: kind for kind in (BeamSensor, ConeSensor, OverheadSensor)
}


def stated_of_sensor(
    log: object, kind: str | None = None, *, first: Measurement | None = None
) -> dict[str, Any]:
    """What a log says of its sensor, as fields of the sensor model, with its `kind`.

    Args:
        log: any log.
        kind: the kind of sensor; default: as the log's readings are.
        first: the first of them.
    """
    said: Mapping[str, float] = getattr(log, "sensor", {})
    if kind is None and isinstance(first, GridScan):
        kind = OverheadSensor.kind
    elif kind is None:
        kind = ConeSensor.kind if "cone_deg" in said else BeamSensor.kind
    fields = {field.name for field in dataclasses.fields(KINDS[kind])}
    return {"kind": kind} | {name: value for name, value in said.items() if name in fields}
