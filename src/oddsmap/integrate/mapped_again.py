# SPDX-License-Identifier: Apache-2.0
"""A log mapped again as it was mapped into a map, by what the map's provenance says of it."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from oddsmap.errors import InputError
from oddsmap.evidence.evidence import Evidence
from oddsmap.integrate.add import add_log, ndim_of
from oddsmap.scans.log import Log, parts_of
from oddsmap.scans.split_log import hold_out
from oddsmap.sensors.registry import KINDS, Sensor, sensor_of_log

__all__ = ["Way", "entries_of", "map_again", "ways_of"]

E = TypeVar("E", bound=Evidence)
Entry = dict[str, Any]

# What another version of oddsmap, or a command beside the mapping itself, says in an entry.
_ASIDE = {"oddsmap", "posterior", "hold_out_every", "hold_out_run", "moved"}

# What was done to a map as a whole: the same is to be done to the log's own map.
_OF_THE_WHOLE = {
    "resampled_from": "it was resampled to larger cells (oddsmap resample)",
    "rotated": "it was turned (oddsmap rotate-frame)",
    "rescaled_from_t_ref_ns": "its half-life was counted from a later time, with rounding",
}


class Way(NamedTuple):
    """How the scans of a log were mapped."""

    sensor: Sensor
    method: str
    every: int | None
    """As in `oddsmap.scans.split_log.hold_out`; None: all scans were mapped."""
    run: int


def entries_of(grid: Evidence, log: Any) -> list[Entry]:
    """What a map's provenance says of this log, of scans without a log likewise."""
    path = getattr(log, "path", None)
    name = None if path is None else Path(path).name
    return [
        entry
        for entry in grid.provenance
        if entry.get("source") == name and ("scans" in entry or name is not None)
    ]


def ways_of(grid: Evidence, parts: list[Any], entries: list[Entry]) -> list[Way]:
    """How each part of a log was mapped, or would be by the map's own settings.

    Args:
        grid: the map.
        parts: of the log, see `parts_of`.
        entries: of the provenance, one a part; another number of them says nothing.
    """
    return [
        _way(grid, part, number, entries[number] if len(entries) == len(parts) else {})
        for number, part in enumerate(parts)
    ]


def _way(grid: Evidence, part: Any, number: int, entry: Entry) -> Way:
    if "sensor" in entry:
        settings = {
            name: tuple(value) if isinstance(value, list) else value  # JSON has no tuples
            for name, value in entry["sensor"].items()
            if name != "kind"
        }
        sensor = KINDS[entry["sensor"]["kind"]](**settings)
    else:
        sensor = grid.sensor if number == 0 else sensor_of_log(part)
    every, run = entry.get("hold_out_every"), entry.get("hold_out_run", 1)
    return Way(sensor, entry.get("method", "rays"), every, run)


def map_again(
    grid: E,
    log: Log,
    *,
    watch: Callable[[Log, Sensor], Log] = lambda part, _: part,
    threads: int = 1,
    progress: Callable[[int], None] | None = None,
) -> E:
    """The evidence of a log, as a map of the same kind has it: what `subtract` takes out again.

    Where the map's provenance names the log, its scans are mapped by the sensor models, without
    the scans that were held out, and the counts of scans and beams have to be the same. Otherwise
    they are mapped by the map's own settings, and whether that is what is in it nobody can tell.

    Args:
        grid: the map.
        log: what `open_log` returned, read with the options of then.
        watch: gives a log that looks at scans while they are read, for a part of the log and the
            sensor model that it is mapped by.
        threads: how many threads to use.
        progress: called with the number of scans done so far of each part.

    Returns:
        A map with the provenance of then, where there is one.

    Raises:
        InputError: the map was changed as a whole, the log was mapped in several ways or in a
            moved frame, or it does not read as it did.
    """
    name = Path(log.path).name
    _check_unchanged(grid, name)
    parts = parts_of(log)
    groups = _groups(grid, log, len(parts))
    ways = _only_way([ways_of(grid, parts, group) for group in groups or [[]]], name)
    again = grid.like()
    for part, way in zip(parts, ways, strict=True):
        first = next(iter(part), None)
        if first is not None and ndim_of(first) != grid.ndim:
            raise InputError(f"{name} has {ndim_of(first)}D scans, the map is {grid.ndim}D")
        watched = watch(part, way.sensor)
        mapped = watched if way.every is None else hold_out(watched, way.every, way.run)[0]
        add_log(
            again, mapped, sensor=way.sensor, method=way.method, threads=threads, progress=progress
        )
    if groups:
        again.provenance = copy.deepcopy(_same(groups, again.provenance, name))
    return again


def _check_unchanged(grid: Evidence, name: str) -> None:
    for key, what in _OF_THE_WHOLE.items():
        if any(key in entry for entry in grid.provenance):
            raise InputError(
                f"what {name} has added to the map cannot be mapped again, for {what}: do the same "
                "to a map of the log alone, and subtract that"
            )


def _groups(grid: Evidence, log: Log, parts: int) -> list[list[Entry]]:
    """What the provenance says of each time that the log was mapped."""
    found = entries_of(grid, log)
    moved = [entry for entry in found if "moved" in entry]
    entries = [entry for entry in found if "moved" not in entry]
    if moved and not entries:
        raise InputError(
            f"{Path(log.path).name} was moved after it was mapped, by {moved[0]['moved']}: build a "
            "map of it alone, and subtract that with the same --transform"
        )
    if len(entries) % parts:
        raise InputError(
            f"{Path(log.path).name} was mapped as {len(entries)} parts, and now has {parts}: read "
            "it with the options of then (--scans)"
        )
    return [entries[start : start + parts] for start in range(0, len(entries), parts)]


def _only_way(ways: list[list[Way]], name: str) -> list[Way]:
    if any(way != ways[0] for way in ways):
        raise InputError(
            f"logs of the name {name} were mapped in several ways (sensor, method, scans held "
            "out): build a map of the one that is meant, with its options, and subtract that"
        )
    return ways[0]


def _same(groups: list[list[Entry]], found: list[Entry], name: str) -> list[Entry]:
    """The entries that say the same of the log as what was found now."""
    now = _facts(found)
    for group in groups:
        if _facts(group) == now:
            return group
    then, today = (
        f"{sum(entry.get('scans', 0) for entry in entries):,} scans, "
        f"{sum(entry.get('beams', 0) for entry in entries):,} beams"
        for entries in (groups[-1], found)
    )
    raise InputError(
        f"{name} is not read as when it was mapped: {today} now, {then} then"
        + (" (others were skipped)" if today == then else "")
        + "; give the options of then (--poses, --scans, ...) and the log as it was"
    )


def _facts(entries: list[Entry]) -> str:
    """What of some entries is said by the log and by how it was mapped, as saved maps have it."""
    facts = [{k: v for k, v in entry.items() if k not in _ASIDE} for entry in entries]
    return json.dumps(facts, sort_keys=True)
