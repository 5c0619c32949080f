# SPDX-License-Identifier: Apache-2.0
"""What a map was made with: every field that changes a result, and nothing else."""

from __future__ import annotations

import dataclasses
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from oddsmap.config.full_map import FullMapConfig
from oddsmap.decoding import decoding
from oddsmap.errors import ConfigError, did_you_mean, shown
from oddsmap.odds import Thresholds
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.registry import KINDS, Sensor
from oddsmap.short_repr import short_repr

__all__ = ["Config", "MapConfig", "PosteriorConfig", "parse_setting", "read_toml", "resolve"]


@dataclass(frozen=True, slots=True, kw_only=True)
class MapConfig:
    """The grid and how it counts.

    Args:
        resolution: side of a cell [m].
        votes: "scan" (at most one vote per cell and scan) or "beam" (every beam votes); a
            map of cones has "beam" where nobody sets it.
        half_life: after this time evidence weighs half [s]; None: it never fades. A scan of time
            t votes with the weight 2^(-(t_ref - t) / half_life).
        t_ref_ns: the time t_ref at which evidence weighs 1, that of the last scan or later [ns];
            by default that of the log's last scan.
        half_life_scans: after so many scans evidence weighs half, for logs without stamps; None: it
            never fades. Scan i of its log votes with the weight
            2^(-(ref_scan - i) / half_life_scans).
        ref_scan: the number of the scan at which evidence weighs 1, counted from 0, that of the
            last scan or later; by default that of the log's last scan.
        path_lengths: True: also keep the length of the beams inside each cell, for the decay-rate
            view; needs votes "beam".

    Raises:
        ConfigError: a value is outside its range.
    """

    resolution: float
    votes: str = "scan"
    half_life: float | None = None
    t_ref_ns: int | None = None
    half_life_scans: float | None = None
    ref_scan: int | None = None
    path_lengths: bool = False

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if not 0.0 < self.resolution < math.inf:
            raise ConfigError(f"map.resolution is a length above 0 m, got {self.resolution}")
        if self.votes not in ("scan", "beam"):
            raise ConfigError(f'map.votes is "scan" or "beam", got "{self.votes}"')
        if self.half_life is not None and not 0.0 < self.half_life < math.inf:
            raise ConfigError(f"map.half_life is a time above 0 s, got {self.half_life}")
        if self.t_ref_ns is not None and self.half_life is None:
            raise ConfigError(
                f"map.t_ref_ns {self.t_ref_ns} is where map.half_life counts back from: set both"
            )
        if self.half_life_scans is not None:
            if not 0.0 < self.half_life_scans < math.inf:
                raise ConfigError(
                    f"map.half_life_scans is a number of scans above 0, got {self.half_life_scans}"
                )
            if self.half_life is not None:
                raise ConfigError(
                    "map.half_life and map.half_life_scans both let evidence fade: set one, by "
                    "stamps or by numbers of scans"
                )
        if self.ref_scan is not None and self.half_life_scans is None:
            raise ConfigError(
                f"map.ref_scan {self.ref_scan} is where map.half_life_scans counts back from: set "
                "both"
            )
        if self.path_lengths and self.votes != "beam":
            raise ConfigError(
                f'map.path_lengths counts every beam: it needs map.votes "beam", got "{self.votes}"'
            )

    @property
    def forgets(self) -> bool:
        """Whether scans have weights other than 1."""
        return self.half_life is not None or self.half_life_scans is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class PosteriorConfig:
    """Defaults of the log-odds view.

    Args:
        prior: p(x) of a cell before any reading.
        free: a seen cell is free where its probability is at most this.
        occupied: a seen cell is occupied where its probability is at least this.

    Raises:
        ConfigError: a value is outside its range.
    """

    prior: float = 0.5
    free: float = 0.196
    occupied: float = 0.65

    def __post_init__(self) -> None:
        if not 0.0 < self.prior < 1.0:
            raise ConfigError(f"posterior.prior lies between 0 and 1, got {self.prior}")
        Thresholds(self.free, self.occupied)

    @property
    def thresholds(self) -> Thresholds:
        """`free` and `occupied` together."""
        return Thresholds(self.free, self.occupied)


@dataclass(frozen=True, slots=True, kw_only=True)
class Config:
    """Every setting of a map that changes a result, as stored with it."""

    map: MapConfig
    sensor: Sensor = field(default_factory=BeamSensor)
    posterior: PosteriorConfig = field(default_factory=PosteriorConfig)
    full_map: FullMapConfig = field(default_factory=FullMapConfig)

    __repr__ = short_repr

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Nested plain values, as TOML and JSON take them; None where a field is not set."""
        values = dataclasses.asdict(self)
        return values | {"sensor": {"kind": self.sensor.kind, **values["sensor"]}}

    @classmethod
    def from_dict(cls, values: Mapping[str, Mapping[str, Any]], where: str) -> Config:
        """Check and build: the inverse of `to_dict`.

        Args:
            values: section -> field -> value.
            where: what the values came from, for error messages.

        Raises:
            ConfigError: an unknown section or field (the nearest known one is named), a value of
                the wrong type or outside its range, or no resolution.
        """
        _check_sections(values, where)
        kinds = _SECTIONS | {"sensor": _sensor_kind(values, where, BeamSensor)}
        for section, fields in values.items():
            for name, value in fields.items():
                _check_field(kinds[section], section, name, value, where)
        if "resolution" not in values.get("map", {}):
            raise ConfigError(f"{where}: map.resolution is missing; a map needs one, in metres")
        plain = {
            section: {
                name: tuple(value) if isinstance(value, list) else value  # JSON has no tuples
                for name, value in fields.items()
                if name != "kind"
            }
            for section, fields in values.items()
        }
        missing = [
            field.name
            for field in dataclasses.fields(kinds["sensor"])
            if field.default is dataclasses.MISSING and field.name not in plain.get("sensor", {})
        ]
        if missing:
            raise ConfigError(
                f"{where}: a sensor of kind {kinds['sensor'].kind} needs sensor.{missing[0]}"
            )
        plain["map"] = {"votes": kinds["sensor"].default_votes, **plain["map"]}
        return cls(**{name: kind(**plain.get(name, {})) for name, kind in kinds.items()})


# All fields with their comments are some 5 KB.
_LONGEST_TOML = 1 << 16
# tomllib takes minutes for a key like a.a.a... of ten thousand parts; ours have two.
_MOST_DOTS = 100

_SECTIONS: dict[str, Any] = {
    "map": MapConfig,
    "sensor": Sensor,
    "posterior": PosteriorConfig,
    "full_map": FullMapConfig,
}


def _check_sections(values: Mapping[str, Mapping[str, Any]], where: str) -> None:
    for section, fields in values.items():
        _known(section, _SECTIONS, where, "section")
        if not isinstance(fields, Mapping):
            raise ConfigError(f"{where}: [{section}] is a section, got {shown(fields)}")


def _sensor_kind(
    values: Mapping[str, Mapping[str, Any]], where: str, default: type[Sensor]
) -> type[Sensor]:
    kind = values.get("sensor", {}).get("kind", default.kind)
    if not isinstance(kind, str) or kind not in KINDS:
        raise ConfigError(f"{where}: sensor.kind is one of {', '.join(KINDS)}, got {shown(kind)}")
    return KINDS[kind]


def resolve(*layers: tuple[str, Mapping[str, Mapping[str, Any]]]) -> Config:
    """Merge layers of settings, the strongest last.

    Args:
        layers: (where it came from, section -> field -> value), the weakest first.

    Returns:
        The configuration; fields that no layer sets have their defaults.

    Raises:
        ConfigError: see `Config.from_dict`.
    """
    # The strongest word on the kind of sensor says which fields the others may set.
    sensor: type[Sensor] = BeamSensor
    for where, values in layers:
        _check_sections(values, where)
        sensor = _sensor_kind(values, where, sensor)
    kinds = _SECTIONS | {"sensor": sensor}
    merged: dict[str, dict[str, Any]] = {"sensor": {"kind": sensor.kind}}
    for where, values in layers:
        for section, fields in values.items():
            for name, value in fields.items():
                _check_field(kinds[section], section, name, value, where)
                if name != "kind":
                    merged.setdefault(section, {})[name] = value
    return Config.from_dict(merged, "configuration")


def read_toml(path: Path) -> dict[str, Any]:
    """Read a configuration file.

    Raises:
        ConfigError: it cannot be read, is not TOML, or has an unknown section.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    if len(content) > _LONGEST_TOML:
        raise ConfigError(f"{path}: not a configuration: {len(content)} bytes of TOML")
    for number, line in enumerate(content.split(b"\n"), start=1):
        if line.count(b".") > _MOST_DOTS:
            raise ConfigError(f"{path}:{number}: a key of {line.count(b'.') + 1} parts")
    with decoding(path, "not a TOML file", "correct it there", ConfigError):
        values = tomllib.loads(content.decode("utf-8-sig"))
    _check_sections(values, str(path))
    return values


def parse_setting(text: str) -> tuple[str, str, Any]:
    """Split "section.field=value"; the value is read as TOML, or as a word.

    Raises:
        ConfigError: not of that form.
    """
    key, equals, value = text.partition("=")
    section, dot, name = key.strip().partition(".")
    if not (equals and dot and section and name):
        raise ConfigError(f'--set {text}: needs section.field=value, like "sensor.range_max=30"')
    with decoding(f"--set {key}", "not a value", "give a number or a word", ConfigError):
        try:
            return section, name, tomllib.loads(f"value = {value.strip()}")["value"]
        except tomllib.TOMLDecodeError:
            return section, name, value.strip()


def _check_field(holder: Any, section: str, name: str, value: object, where: str) -> None:
    if (section, name) == ("sensor", "kind"):
        return
    fields = {field.name: str(field.type) for field in dataclasses.fields(holder)}
    of = f"[{section}]" if section != "sensor" else f"[sensor] of kind {holder.kind}"
    _known(name, fields, where, f"field of {of}")
    kind = fields[name]
    number = _is_number(value)
    if isinstance(value, int) and not isinstance(value, bool) and not number:
        raise ConfigError(
            f"{where}: {section}.{name} is a number that 64 bits can hold, got {shown(value)}"
        )
    fits, wanted = {
        "float": (number, "a number"),
        "float | None": (number or value is None, "a number"),
        "int": (number and isinstance(value, int), "a whole number"),
        "int | None": (value is None or (number and isinstance(value, int)), "a whole number"),
        "bool": (isinstance(value, bool), "true or false"),
        "str": (isinstance(value, str), "a word"),
        "tuple[float, ...] | None": (
            value is None or _is_corner(value),
            "two numbers in 2D, like [-0.3, -0.2], or three in 3D",
        ),
    }[kind]
    if not fits:
        raise ConfigError(f"{where}: {section}.{name} is {wanted}, got {shown(value)}")


def _is_corner(value: object) -> bool:
    return isinstance(value, list | tuple) and len(value) in (2, 3) and all(map(_is_number, value))


def _is_number(value: object) -> bool:
    """Whether it is a number to calculate with: TOML's integers may have any number of digits."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return isinstance(value, float) or -(2**63) <= value < 2**63


def _known(name: str, names: Mapping[str, object], where: str, what: str) -> None:
    if name not in names:
        raise ConfigError(
            f'{where}: no {what} is called "{name}"{did_you_mean(name, names)} '
            f"(known: {', '.join(names)})"
        )
