# SPDX-License-Identifier: Apache-2.0
"""`oddsmap config`: every field that changes a result."""

from __future__ import annotations

import dataclasses
import json
import textwrap
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oddsmap.cli.options import json_option
from oddsmap.cli.sensor_names import complete_sensor

if TYPE_CHECKING:
    from oddsmap.cli.setting_fields import SettingField

__all__ = ["HELP", "config"]

HELP = """List all settings: unit, default and meaning of what --set and --config set.

\b
  oddsmap config                        all of them
  oddsmap config sensor --sensor sonar  those of one section, for one sensor
  oddsmap config map.half_life          one
  oddsmap config > my.toml              a file for --config, to be edited

What is printed is such a file. It changes nothing as it stands: take the # off before what it
should set.
"""

_WIDTH = 79
_HEAD = (
    "What --set SECTION.FIELD=VALUE sets, with its defaults. This is a file for --config, too: "
    "take the # off before what it should set."
)


def config(
    which: Annotated[
        str | None,
        typer.Argument(metavar="SECTION[.FIELD]", help="One section or field; by default all."),
    ] = None,
    sensor: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Fields of this sensor alone: {sensors}; by default of all kinds.",
            autocompletion=complete_sensor,
        ),
    ] = None,
    as_json: Annotated[bool, json_option("the fields")] = False,
) -> None:
    """List all settings: see `HELP`."""
    from oddsmap.cli.sensor_names import check_name, sensor_names
    from oddsmap.cli.setting_fields import all_fields
    from oddsmap.errors import ConfigError, did_you_mean

    check_name(sensor)
    kind = None if sensor is None else sensor_names()[sensor]
    fields = [f for f in all_fields() if kind is None or f.kind in (None, kind)]
    if which is not None:
        known = {f.section for f in fields} | {f"{f.section}.{f.name}" for f in fields}
        if which not in known:
            sections = ", ".join(dict.fromkeys(f.section for f in fields))
            raise ConfigError(
                f"{which}: no such section or field{did_you_mean(which, known)} "
                f"(sections: {sections})"
            )
        fields = [f for f in fields if which in (f.section, f"{f.section}.{f.name}")]
    if as_json:
        typer.echo(json.dumps({"fields": [dataclasses.asdict(field) for field in fields]}))
    else:
        typer.echo("\n".join(_as_toml(fields)))


def _as_toml(fields: Iterable[SettingField]) -> Iterator[str]:
    """A file of the configuration in which all is a comment but the sections."""
    from oddsmap.sensors.registry import KINDS

    yield from _comment(_HEAD)
    section = kind = None
    for field in fields:
        if field.section != section:
            section = field.section
            yield f"\n[{section}]"
        if field.kind != kind and field.kind is not None:
            kind = field.kind
            names = ", ".join(KINDS[kind].names)
            yield ""
            yield from _comment(f"{'-' * 8} Of sensors of kind {kind} (--sensor {names}):")
            yield f'#kind = "{kind}"'
        yield ""
        yield from _comment(f"{field.meaning} {_default_of(field)}")
        yield f"#{field.name} = {_toml(field.default)}".rstrip()


def _default_of(field: SettingField) -> str:
    """What is to say of the default of a field that has no value."""
    if field.required:
        return "Required: here, or by what the log says." if field.kind else "Required."
    return "Default: not set." if field.default is None else ""


def _comment(text: str) -> list[str]:
    return textwrap.wrap(
        text,
        _WIDTH,
        initial_indent="# ",
        subsequent_indent="# ",
        break_on_hyphens=False,
        break_long_words=False,
    )


def _toml(value: Any) -> str:
    return "" if value is None else json.dumps(value)
