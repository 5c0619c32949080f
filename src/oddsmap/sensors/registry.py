# SPDX-License-Identifier: Apache-2.0
"""The sensor models by name: a new one is a file in this folder and a name in `SENSORS`."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeVar, cast

from oddsmap.errors import ConfigError, InputError
from oddsmap.scans.grid_scan import GridScan
from oddsmap.scans.log import parts_of
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.base import Sensor
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.overhead import OverheadSensor

__all__ = [
    "KINDS",
    "NAMES",
    "SENSORS",
    "Sensor",
    "agreeing",
    "check_agreement",
    "sensor_of_log",
    "settings_of",
    "stated_of_sensor",
]

M = TypeVar("M", bound=Measurement)

SENSORS: tuple[type[Sensor], ...] = (BeamSensor, ConeSensor, OverheadSensor)

KINDS: dict[str, type[Any]] = {sensor.kind: sensor for sensor in SENSORS}
"""By `sensor.kind` of a configuration."""

NAMES: dict[str, str] = {name: sensor.kind for sensor in SENSORS for name in sensor.names}
"""What --sensor may say, and the kind that stands for it."""


def stated_of_sensor(
    log: object,
    kind: str | None = None,
    *,
    first: Measurement | None = None,
    decided: Collection[str] = (),
) -> dict[str, Any]:
    """What a log says of its sensor, as fields of the sensor model, with its `kind`.

    Args:
        log: any log, or a list of scans.
        kind: the kind of sensor; default: as the log's readings are.
        first: the first of them, which speaks for what is neither a log nor a list.
        decided: fields whose value the caller sets, whatever the log states.

    Raises:
        ConfigError: there is no sensor model of this kind.
        InputError: scans of a list come from logs that state different things, or the sensors of
            a log do.
    """
    check_agreement(log, decided)
    if first is None and isinstance(log, Sequence) and len(log):
        first = log[0]
    stated: Mapping[str, float] = getattr(log, "sensor", getattr(first, "stated", {}))
    if isinstance(log, Sequence) and not hasattr(log, "sensor"):
        for _ in agreeing(log, stated):
            pass
    if kind is None and isinstance(first, GridScan):
        kind = OverheadSensor.kind
    elif kind is None:
        kind = ConeSensor.kind if "cone_deg" in stated else BeamSensor.kind
    if kind not in KINDS:
        raise ConfigError(f"sensor.kind is one of {', '.join(KINDS)}, got {kind!r}")
    fields = {field.name for field in dataclasses.fields(KINDS[kind])}
    return {"kind": kind} | {name: value for name, value in stated.items() if name in fields}


def sensor_of_log(log: object, *, first: Measurement | None = None) -> Sensor:
    """The sensor model that a log asks for; arguments as in `stated_of_sensor`."""
    stated = stated_of_sensor(log, first=first)
    return cast(Sensor, KINDS[stated.pop("kind")](**stated))


def agreeing(scans: Iterable[M], stated: Mapping[str, float]) -> Iterator[M]:
    """The scans, all of which come from logs that state this about their sensor.

    Raises:
        InputError: one comes from a log that states something else.
    """
    for number, scan in enumerate(scans):
        own: Mapping[str, float] = getattr(scan, "stated", stated)
        if own is not stated and dict(own) != dict(stated):
            raise InputError(
                f"scan {number} comes from a log that states {_words(own)} of its sensor, the "
                f"first from one that states {_words(stated)}: map log by log and merge, or give "
                "the sensor"
            )
        yield scan


def check_agreement(log: object, decided: Collection[str] = ()) -> None:
    """Refuse one sensor model for sensors that state different things.

    Args:
        log: any log, or a list of scans.
        decided: fields whose value the caller sets.

    Raises:
        InputError: they state different things of another field.
    """
    first, *others = parts_of(log)
    for part in others:
        differ = [
            name
            for name in sorted({*first.sensor, *part.sensor} - set(decided))
            if first.sensor.get(name) != part.sensor.get(name)
        ]
        if differ:
            raise InputError(
                f"{part.path}: its sensors state different things, {next(iter(first.sensors))} "
                f"{_words(first.sensor)}, {next(iter(part.sensors))} {_words(part.sensor)}: take "
                f"one at a time (--scans, scans=), or set {' and '.join(differ)} for all"
            )


def _words(stated: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in stated.items()) or "nothing"


def settings_of(sensor: Sensor) -> dict[str, Any]:
    """The kind and the fields of a sensor model, as they are written down."""
    return {"kind": sensor.kind, **dataclasses.asdict(cast(Any, sensor))}
