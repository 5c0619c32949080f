# SPDX-License-Identifier: Apache-2.0
"""The options that commands share: name, metavar and help of each, declared once.

A name in capitals is the whole type of a parameter. A function is for an option whose help depends
on the command: `config: Annotated[Path | None, config_option("...")] = None`.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

__all__ = [
    "BodyFromSensor",
    "Camera",
    "ClockOffset",
    "Columns",
    "DepthScale",
    "Deskew",
    "Frame",
    "Origin",
    "PointsIn",
    "Poses",
    "Quiet",
    "Resolution",
    "Scans",
    "Settings",
    "SkipBad",
    "Threads",
    "Times",
    "Tolerance",
    "Verbose",
    "complete_field",
    "config_option",
    "flag",
    "force_option",
    "json_option",
    "thread_count",
]

Resolution = Annotated[
    float | None,
    typer.Option(
        "--resolution",
        metavar="METRES",
        help="Side of a cell; required, here or as map.resolution.",
    ),
]

Threads = Annotated[
    int | None,
    typer.Option(
        "--threads",
        metavar="N",
        min=1,
        help="How many work; by default all cores. Changes no bit.",
    ),
]


def complete_field(incomplete: str) -> list[str]:
    """The fields that may be meant by --set, for the completion of the shell."""
    from oddsmap.cli.setting_fields import all_fields

    names = {f"{field.section}.{field.name}=" for field in all_fields()}
    return sorted(name for name in names if name.startswith(incomplete))


Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="SECTION.FIELD=VALUE",
        help="Set any field that oddsmap config lists; may be repeated.",
        autocompletion=complete_field,
    ),
]

# How a log is read; see `oddsmap.cli.log_options`.

Poses = Annotated[
    Path | None,
    typer.Option(
        "--poses",
        metavar="FILE|TOPIC|tf",
        help="KITTI or TUM poses of a folder of scans, by default the file of poses in it; or a "
        "topic of a recording, by default its transforms.",
    ),
]

Times = Annotated[
    Path | None,
    typer.Option(
        "--times",
        metavar="FILE",
        help="Stamps of a folder of scans, a number of seconds a line; by default times.txt in it.",
    ),
]

Tolerance = Annotated[
    float | None,
    typer.Option(
        "--tolerance",
        metavar="SECONDS",
        help="How far a pose may be from a scan's stamp; by default 0.02, in recordings 0.1.",
    ),
]

Scans = Annotated[
    list[str] | None,
    typer.Option(
        "--scans",
        metavar="TOPIC",
        help="Scans of a recording; by default its only topic of them. May be repeated.",
    ),
]

Frame = Annotated[
    str | None,
    typer.Option(
        "--frame",
        metavar="NAME",
        help="Frame of the map in a recording; by default map, world or odom.",
    ),
]

ClockOffset = Annotated[
    float,
    typer.Option(
        "--clock-offset",
        metavar="SECONDS",
        help="Added to the stamps of a recording's scans: the time of its poses.",
    ),
]

Deskew = Annotated[
    Literal["auto", "on", "off"],
    typer.Option(
        "--deskew",
        help="Take each beam from where the sensor was at its own time; by default where the log "
        "has times to trust and poses ten times a second.",
    ),
]

BodyFromSensor = Annotated[
    str | None,
    typer.Option(
        "--body-from-sensor",
        metavar="'X Y Z QX QY QZ QW'|FILE",
        help="Where the sensor sits on the body that the poses are of [metres, quaternion], or a "
        "file with the 3 x 4 or 4 x 4 matrix; by default the poses are the sensor's.",
    ),
]

Camera = Annotated[
    str | None,
    typer.Option(
        "--camera",
        metavar="'FX FY CX CY W H'",
        help="Intrinsics of depth images [pixels]; by default those in the folder.",
    ),
]

PointsIn = Annotated[
    Literal["sensor", "map"] | None,
    typer.Option(
        "--points-in",
        help="The frame that the points of clouds are in; by default the sensor's, and asked for "
        "where PCD's VIEWPOINT leaves it open.",
    ),
]

Origin = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        "--origin",
        metavar="METRES METRES METRES",
        help="x, y and z of the place where the sensor stood, for points that are in the map and "
        "have no poses; by default the poses say it.",
    ),
]

Columns = Annotated[
    str | None,
    typer.Option(
        "--columns",
        metavar="x,y,z,...",
        help="The float32 columns of .bin scans; by default found by what stands in them.",
    ),
]

DepthScale = Annotated[
    float | None,
    typer.Option(
        "--depth-scale",
        metavar="UNITS",
        help="Units of a depth image in a metre, 1000 for millimetres; by default 1000, in TUM's "
        "layout 5000.",
    ),
]

SkipBad = Annotated[
    bool, typer.Option("--skip-bad", help="Use the readable part of a damaged file.")
]

Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print errors alone, and what --json prints.")
]

Verbose = Annotated[
    bool,
    typer.Option("--verbose", "-v", help="Print details too, and where unexpected errors arise."),
]


def config_option(meaning: str) -> Any:
    """`--config FILE.toml`; `meaning` says what the command looks at."""
    return typer.Option("--config", metavar="FILE.toml", help=f"Settings from a file: {meaning}.")


def force_option(what: str) -> Any:
    """`--force`, which replaces `what`: "an existing map"."""
    return typer.Option("--force", help=f"Replace {what}.")


def json_option(what: str) -> Any:
    """`--json`, which prints `what`: "the summary"."""
    return typer.Option("--json", help=f"Print {what} as one JSON object.")


def flag(name: str) -> str:
    """The option of a parameter as it is typed: "p_hit" is "--p-hit"."""
    return "--" + name.replace("_", "-")


def thread_count(stated: int | None) -> int:
    """What --threads says, or all cores that this process may use."""
    if stated is not None:
        return stated
    if hasattr(os, "sched_getaffinity"):  # not on macOS and Windows
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
