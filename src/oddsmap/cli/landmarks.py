# SPDX-License-Identifier: Apache-2.0
"""`oddsmap landmarks`: observations of landmarks to a map of them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oddsmap.cli.options import flag, force_option, json_option

if TYPE_CHECKING:
    from oddsmap.landmarks import LandmarkMap, ObservationTable

__all__ = ["HELP", "landmarks"]

HELP = """Map point landmarks seen from known poses.

\b
  oddsmap landmarks seen.csv --sigma-range 0.1 --sigma-bearing 1 -o trees.csv
  oddsmap landmarks corners.csv --sigma-xy 0.05 -o corners.json
  oddsmap landmarks beacons.npz --sigma-bearing 2 -o beacons.png

The table has one row per observation: x, y, theta (pose of the sensor; metres, radians) and range,
bearing, or bearing alone, or dx, dy (in the sensor frame); id and stamp may be there. Without id,
observations go to landmarks by a chi-square gate.
"""

# Used where the option is not stated, and always reported: [m], [deg], [m].
_DEFAULTS = {"sigma_range": 0.1, "sigma_bearing": 1.0, "sigma_xy": 0.1}
_UNITS = {"sigma_range": "m", "sigma_bearing": "deg", "sigma_xy": "m"}
_NOISE_OF = {
    "range-bearing": ("sigma_range", "sigma_bearing"),
    "bearing": ("sigma_bearing",),
    "position": ("sigma_xy",),
}


def landmarks(
    observations: Annotated[
        Path, typer.Argument(metavar="OBS", help="A .csv or .npz, one row per observation.")
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="OUT", help=".csv, .json (all) or .png")
    ],
    sigma_range: Annotated[
        float | None, typer.Option(metavar="M", help="Noise of ranges; default 0.1.")
    ] = None,
    sigma_bearing: Annotated[
        float | None, typer.Option(metavar="DEG", help="Noise of bearings; default 1.")
    ] = None,
    sigma_xy: Annotated[
        float | None, typer.Option(metavar="M", help="Noise of dx and of dy; default 0.1.")
    ] = None,
    gate: Annotated[
        float, typer.Option(metavar="P", help="Without id: probability of the gate.")
    ] = 0.99,
    min_count: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, help="Observations to be reported; 1, or 3 without id."),
    ] = None,
    force: Annotated[bool, force_option("an existing file")] = False,
    as_json: Annotated[bool, json_option("the summary")] = False,
) -> None:
    """Map point landmarks: see `HELP`."""
    from oddsmap.atomic_write import check_output
    from oddsmap.errors import ConfigError, InputError
    from oddsmap.landmarks import LandmarkMap, read_observations

    suffix = output.suffix.lower()
    if suffix not in (".csv", ".json", ".png"):
        raise ConfigError(
            f"{output}: the suffix says what to write: .csv (table), .json (all) or .png "
            f'(picture); got "{output.suffix}"'
        )
    check_output(output, force=force)
    found = LandmarkMap(gate=gate, min_count=min_count)
    table = read_observations(observations)
    if output.exists() and output.samefile(observations):
        raise ConfigError(f"{output}: is the input; give another name to write to")
    stated = {"sigma_range": sigma_range, "sigma_bearing": sigma_bearing, "sigma_xy": sigma_xy}
    noise = _noise(table, stated)
    in_radians = {**noise}
    if "sigma_bearing" in noise:
        in_radians["sigma_bearing"] = math.radians(noise["sigma_bearing"])
    for scan in table.scans(**in_radians):
        found.add(scan)
    facts = _facts(found, table, noise, output)
    if not facts["landmarks"]:
        raise InputError(f"{observations}: {_why_none(found, table)}")
    if suffix == ".png":
        from oddsmap.landmarks.picture import save_landmarks_png

        save_landmarks_png(found.landmarks, output, trajectory=table.poses[:, :2], force=force)
    else:
        found.save(output, force=force)
    if as_json:
        typer.echo(json.dumps(facts))
    else:
        _say(facts)


def _noise(table: ObservationTable, stated: dict[str, float | None]) -> dict[str, float]:
    from oddsmap.errors import ConfigError

    needs = _NOISE_OF[table.kind]
    for name, value in stated.items():
        if value is not None and name not in needs:
            raise ConfigError(
                f"{flag(name)}: {table.path} has {table.kind} observations, without it"
            )
        if value is not None and not 0.0 < value < math.inf:
            raise ConfigError(f"{flag(name)} {value:g}: a standard deviation is positive")
    noise = {}
    for name in needs:
        value = stated[name]
        noise[name] = _DEFAULTS[name] if value is None else value
    return noise


def _facts(
    found: LandmarkMap, table: ObservationTable, noise: dict[str, float], output: Path
) -> dict[str, Any]:
    skipped = table.skipped + found.skipped
    return {
        "output": str(output),
        "kind": table.kind,
        "association": "unknown" if table.ids is None else "known",
        "scans": len(table.starts),
        "observations": sum(track.count for track in found.tracks.values()),
        "landmarks": len(found.landmarks),
        "tentative": found.tentative,
        "unlocated": found.unlocated,
        "skipped": dict(skipped),
        **{f"{name}_{_UNITS[name]}": value for name, value in noise.items()},
    }


def _why_none(found: LandmarkMap, table: ObservationTable) -> str:
    if table.kind == "bearing" and table.ids is None:
        return "no landmark: bearings alone cannot start one; they need a column `id`"
    if found.unlocated:
        return (
            f"no landmark: the bearings of {found.unlocated} do not cross widely enough to say "
            "where they are"
        )
    if found.tentative:
        return (
            f"no landmark was observed often enough, {found.tentative} are tentative: "
            "see --min-count"
        )
    return "no landmark: none of the observations is usable"


def _say(facts: dict[str, Any]) -> None:
    say = typer.echo
    say(
        f"used     {facts['scans']:,} scans, {facts['observations']:,} {facts['kind']} observations"
    )
    for reason, count in sorted(facts["skipped"].items()):
        say(f"skipped  {count:,} x {reason}")
    noise = [
        f"{name} {facts[f'{name}_{unit}']:g} {unit}"
        for name, unit in _UNITS.items()
        if f"{name}_{unit}" in facts
    ]
    say(f"noise    {', '.join(noise)}")
    say(
        f"found    {facts['landmarks']:,} landmarks, {facts['tentative']:,} more are tentative, "
        f"{facts['unlocated']:,} not located"
    )
    say(f"wrote    {facts['output']}")
