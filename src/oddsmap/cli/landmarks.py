# SPDX-License-Identifier: Apache-2.0
"""`oddsmap landmarks`: observations of landmarks to a map of them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oddsmap.cli.options import Quiet, Verbose, flag, force_option, json_option
from oddsmap.cli.picture_options import PICTURES
from oddsmap.cli.voice import Voice

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
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="OUT",
            help="What to write: .csv (table), .json (all), .png, .pdf or .svg (picture).",
        ),
    ],
    sigma_range: Annotated[
        float | None, typer.Option(metavar="METRES", help="Noise of ranges, by default 0.1.")
    ] = None,
    sigma_bearing: Annotated[
        float | None, typer.Option(metavar="DEGREES", help="Noise of bearings, by default 1.")
    ] = None,
    sigma_xy: Annotated[
        float | None, typer.Option(metavar="METRES", help="Noise of dx and of dy, by default 0.1.")
    ] = None,
    gate: Annotated[
        float, typer.Option(metavar="PROBABILITY", help="Without id: probability of the gate.")
    ] = 0.99,
    min_count: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=1,
            help="Observations of a landmark to be reported; by default 1, or 3 without id.",
        ),
    ] = None,
    force: Annotated[bool, force_option("an existing file")] = False,
    as_json: Annotated[bool, json_option("the summary")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Map point landmarks: see `HELP`."""
    from oddsmap.cli.files import check_files, check_suffix
    from oddsmap.errors import InputError
    from oddsmap.landmarks import LandmarkMap, read_observations

    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    stated = {"sigma_range": sigma_range, "sigma_bearing": sigma_bearing, "sigma_xy": sigma_xy}
    _check_noise(stated)
    found = LandmarkMap(gate=gate, min_count=min_count)
    check_suffix(
        output,
        (".csv", ".json", *PICTURES),
        "the suffix says what to write: .csv (table), .json (all), .png, .pdf or .svg (picture)",
    )
    check_files([observations], output, force=force)
    table = read_observations(observations)
    noise = _noise(table, stated)
    in_radians = {**noise}
    if "sigma_bearing" in noise:
        in_radians["sigma_bearing"] = math.radians(noise["sigma_bearing"])
    for scan in table.scans(**in_radians):
        found.add(scan)
    facts = _facts(found, table, noise, output)
    if not facts["landmarks"]:
        raise InputError(f"{observations}: {_why_none(found, table)}")
    if output.suffix.lower() in PICTURES:
        from oddsmap.landmarks.picture import save_landmarks_png

        save_landmarks_png(found.landmarks, output, trajectory=table.poses[:, :2], force=force)
    else:
        found.save(output, force=force)
    voice.facts(facts)
    _say(voice, facts)


def _check_noise(stated: dict[str, float | None]) -> None:
    from oddsmap.errors import ConfigError

    for name, value in stated.items():
        if value is not None and not 0.0 < value < math.inf:
            raise ConfigError(f"{flag(name)} {value:g}: a standard deviation is positive")


def _noise(table: ObservationTable, stated: dict[str, float | None]) -> dict[str, float]:
    from oddsmap.errors import ConfigError

    needs = _NOISE_OF[table.kind]
    for name, value in stated.items():
        if value is not None and name not in needs:
            raise ConfigError(
                f"{flag(name)}: {table.path} has {table.kind} observations, without it"
            )
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
    skipped = ", ".join(f"{n} x {why}" for why, n in (table.skipped + found.skipped).items())
    return f"no landmark: none of the observations is usable ({skipped or 'there are none'})"


def _say(voice: Voice, facts: dict[str, Any]) -> None:
    say = voice.say
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
