# SPDX-License-Identifier: Apache-2.0
"""Layers of settings: the file, the options by name, --set; and the configuration they make."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from oddsmap.config.config import Config
    from oddsmap.errors import ConfigError
    from oddsmap.scans.log import Log

__all__ = ["Layer", "SettingLayers", "read_layers"]

Layer = Mapping[str, Mapping[str, Any]]
"""Section -> field -> value."""

# What a log may say of its sensor, where it matters for others that it is said; so large that no
# setting can be above it.
_OF_A_LOG = {"range_max": 1e12, "cone_deg": 30.0}


@dataclass(frozen=True, slots=True)
class SettingLayers:
    """What the user sets, layer upon layer.

    Args:
        layers: where each comes from, for error messages, and what it sets; the strongest last.

    Raises:
        ConfigError: there is no such kind of sensor.
    """

    layers: tuple[tuple[str, Layer], ...]

    def __post_init__(self) -> None:
        from oddsmap.errors import ConfigError
        from oddsmap.sensors.registry import KINDS

        # A log is asked for the fields of its kind of sensor, before a Config checks the kind.
        for where, values in self.layers:
            kind = values.get("sensor", {}).get("kind", "beam")
            if kind not in tuple(KINDS):  # a list of TOML is no key of a dictionary
                raise ConfigError(
                    f"{where}: sensor.kind is one of {', '.join(KINDS)}, got {kind!r}"
                )

    def __iter__(self) -> Iterator[tuple[str, Layer]]:
        """The layers, the strongest last."""
        return iter(self.layers)

    def fields(self, section: str) -> set[str]:
        """The fields of a section that any layer sets."""
        return {name for _, values in self.layers for name in values.get(section, {})}

    def sections(self) -> set[str]:
        """The sections that anything is set in."""
        return {section for _, values in self.layers for section in values if values[section]}

    def sensor_kind(self) -> str | None:
        """The strongest word on the kind of sensor model; None: nothing is stated."""
        kind = None
        for _, values in self.layers:
            kind = values.get("sensor", {}).get("kind", kind)
        return kind

    def resolve(self, log: Log) -> Config:
        """The configuration for a log: what it says of its sensor, and the layers above.

        Raises:
            ConfigError: a field is unknown, or its value is not possible.
        """
        from oddsmap.config.config import resolve
        from oddsmap.sensors.registry import stated_of_sensor

        kind = self.sensor_kind()
        # The first reading tells the kind where nobody does.
        first = None if kind is not None else next(iter(log), None)
        stated = stated_of_sensor(log, kind, first=first, decided=self.fields("sensor"))
        return resolve(("log", {"sensor": stated}), *self.layers)

    def resolve_above(self, stored: Config, log: Log) -> Config:
        """The configuration stored with a map, and the layers above.

        Raises:
            ConfigError: a field is unknown, or its value is not possible.
        """
        from oddsmap.config.config import resolve
        from oddsmap.sensors.registry import check_agreement, stated_of_sensor

        check_agreement(log, self.fields("sensor"))
        base, kind = stored.to_dict(), self.sensor_kind()
        if kind is not None and kind != stored.sensor.kind:
            base["sensor"] = stated_of_sensor(log, kind)
        return resolve(("map", base), *self.layers)

    def resolve_added(self, stored: Config, log: Log) -> Config:
        """The configuration for a log that is added to a saved map.

        What is stored with the map, what the log says of its own sensor, and the layers above.

        Raises:
            ConfigError: a field is unknown, its value is not possible, or the log is of another
                kind of sensor.
        """
        from oddsmap.config.config import resolve
        from oddsmap.errors import ConfigError
        from oddsmap.sensors.registry import stated_of_sensor

        base, kind = stored.to_dict(), self.sensor_kind()
        first = None if kind is not None else next(iter(log), None)
        stated = stated_of_sensor(log, kind, first=first, decided=self.fields("sensor"))
        if stated["kind"] != stored.sensor.kind:
            raise ConfigError(
                f"{log.path}: is mapped by a sensor of kind {stated['kind']}, the map by one of "
                f"kind {stored.sensor.kind}: give --sensor or --set sensor.kind as for the map, or "
                "build a map of the log and add the two with oddsmap merge"
            )
        base["sensor"] |= stated
        return resolve(("map", base), *self.layers)

    def check_values(self) -> None:
        """Refuse what is right for no log, before one is opened.

        What a log may say of its sensor counts as said. Where nobody states the kind of sensor,
        the settings have to be right for one.

        Raises:
            ConfigError: a field is unknown, or its value is not possible.
        """
        from oddsmap.config.config import resolve
        from oddsmap.errors import ConfigError
        from oddsmap.sensors.registry import KINDS

        stated, errors = self.sensor_kind(), []
        for kind in KINDS if stated is None else [stated]:
            fields = {field.name for field in dataclasses.fields(KINDS[kind])}
            said = {name: value for name, value in _OF_A_LOG.items() if name in fields}
            base: Layer = {"map": {"resolution": 1.0}, "sensor": {"kind": kind, **said}}
            try:
                resolve(("log", base), *self.layers)
                return
            except ConfigError as error:
                errors.append(error)
        # The kind that has such a field, or nearly, is the one that is meant.
        raise max(errors, key=_knows_the_field) from None

    def check_sections(self, command: str, *used: str) -> None:
        """Refuse --set of a section that a command does not look at.

        The file may serve other commands as well.

        Raises:
            ConfigError: there is one.
        """
        from oddsmap.errors import ConfigError

        for where, values in self.layers:
            unused = [section for section in values if section not in used]
            if unused and where.startswith("--set "):
                wanted = ", ".join(f"{section}.*" for section in used)
                raise ConfigError(
                    f"{where}: oddsmap {command} does not look at {unused[0]}.*, only at {wanted}: "
                    "leave it out"
                )

    def check_estimator(self, estimator: str) -> None:
        """Refuse settings that the estimator would not look at.

        Raises:
            ConfigError: a field of full_map for the filter, or posterior.prior for a full map.
        """
        from oddsmap.errors import ConfigError

        for where, values in self.layers:
            of_full_map = list(values.get("full_map", {}))
            if estimator == "filter" and of_full_map:
                name = of_full_map[0]
                remedy = "set posterior.prior for the filter" if name == "prior" else "leave it out"
                raise ConfigError(
                    f"{where}: full_map.{name} belongs to --estimator full-map, the filter would "
                    f"not look at it: {remedy}, or add --estimator full-map"
                )
            if estimator == "full-map" and "prior" in values.get("posterior", {}):
                raise ConfigError(
                    f"{where}: posterior.prior belongs to --estimator filter, a full map would not "
                    "look at it: set full_map.prior"
                )


def _knows_the_field(error: ConfigError) -> tuple[bool, bool]:
    said = str(error)
    return ": no field of " not in said, "did you mean" in said


def read_layers(
    config: Path | None, settings: Sequence[str] | None, options: Layer | None = None
) -> SettingLayers:
    """Read what the user sets.

    Args:
        config: the file of --config.
        settings: the words of --set.
        options: what options by name set; None as a value is one that is not stated.

    Raises:
        ConfigError: the file cannot be read, or a word of --set is of another form.
    """
    from oddsmap.config.config import parse_setting, read_toml

    layers: list[tuple[str, Layer]] = []
    if config is not None:
        layers.append((str(config), read_toml(config)))
    for section, fields in (options or {}).items():
        stated = {name: value for name, value in fields.items() if value is not None}
        layers.append(("options", {section: stated}))
    for text in settings or ():
        section, name, value = parse_setting(text)
        layers.append((f"--set {text}", {section: {name: value}}))
    return SettingLayers(tuple(layers))
