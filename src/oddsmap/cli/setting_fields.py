# SPDX-License-Identifier: Apache-2.0
"""Every field that --set and --config set: as its dataclass declares and describes it."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_type_hints

__all__ = ["SettingField", "all_fields", "set_fields"]

_ENTRY = re.compile(r"^    (\w+): (.*(?:\n {8}.*)*)", re.MULTILINE)
_UNIT = re.compile(r"\[([a-z/]{1,5})\]")


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingField:
    """One field of the configuration.

    Args:
        section: "map", "sensor", ...
        kind: of which kind of sensor; None in other sections.
        name: name of the field.
        type: of its values, as it is declared.
        required: whether there is no default.
        default: its value where nobody sets it; None also where it is then not set.
        unit: of its values; None: they have none.
        meaning: what it does.
    """

    section: str
    kind: str | None
    name: str
    type: str
    required: bool
    default: Any
    unit: str | None
    meaning: str


def all_fields() -> list[SettingField]:
    """All of them, in the order of their declaration, those of sensors kind by kind."""
    from oddsmap.config.config import Config
    from oddsmap.sensors.registry import KINDS

    found = []
    for section, holder in get_type_hints(Config).items():
        if section == "sensor":
            for kind, sensor in KINDS.items():
                found += _fields_of(sensor, section, kind)
        else:
            found += _fields_of(holder, section, None)
    return found


def set_fields(config: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """What of a configuration, as nested values, is not as it is where nobody sets it."""
    kind = config.get("sensor", {}).get("kind")
    default = {(f.section, f.name): f.default for f in all_fields() if f.kind in (None, kind)}
    return {
        f"{section}.{name}": value
        for section, fields in config.items()
        for name, value in fields.items()
        if value != default.get((section, name))
    }


def _fields_of(holder: Any, section: str, kind: str | None) -> list[SettingField]:
    page = inspect.getdoc(holder) or ""
    _, _, entries = page.partition("Args:\n")
    entries, _, _ = entries.partition("\n\n")
    meaning = {name: _in_toml(" ".join(text.split())) for name, text in _ENTRY.findall(entries)}
    return [
        SettingField(
            section=section,
            kind=kind,
            name=field.name,
            type=str(field.type),
            required=field.default is dataclasses.MISSING,
            default=None if field.default is dataclasses.MISSING else field.default,
            unit=unit[1] if (unit := _UNIT.search(meaning.get(field.name, ""))) else None,
            meaning=meaning.get(field.name, ""),
        )
        for field in dataclasses.fields(holder)
    ]


def _in_toml(text: str) -> str:
    """A sentence of a docstring, for those who write TOML."""
    for python, toml in (("None", "not set"), ("True", "true"), ("False", "false")):
        text = re.sub(rf"\b{python}\b", toml, text)
    text = text.replace(". not set", ". Not set")
    return text if text.startswith(("true", "false")) else text[:1].upper() + text[1:]
