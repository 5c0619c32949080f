# SPDX-License-Identifier: Apache-2.0
"""`oddsmap doctor`: what is wrong with a log."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oddsmap.cli.log_options import LogOptions, takes_log_options
from oddsmap.cli.options import (
    Quiet,
    Verbose,
    json_option,
)
from oddsmap.cli.progress import progress_of_scans
from oddsmap.cli.voice import Voice

if TYPE_CHECKING:
    from oddsmap.doctor.diagnosis import Diagnosis

__all__ = ["HELP", "doctor"]

HELP = """Say what is wrong with a log: its poses, units, times, frames, its sensor.

\b
  oddsmap doctor run.bag --scans /scan
  oddsmap doctor clouds/ --poses poses.txt
  oddsmap doctor intel.log.gz --json

The log is read in other ways, too: with poses inverted, in other units, at other times, of a sensor
that sits in another way. A doubt is what predicts beams of the log better, by maps of other scans
at the same places; what is not sure is not said.
"""


@takes_log_options
def doctor(
    *,
    log: Annotated[Path, typer.Argument(metavar="LOG", help="A log file, or a folder of scans.")],
    range_max: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="Readings from here on are no returns; by default as the log says.",
        ),
    ] = None,
    log_options: LogOptions,
    as_json: Annotated[bool, json_option("what was found")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Examine a log: see `HELP`."""
    from oddsmap.cli.files import check_files, check_logs
    from oddsmap.doctor.diagnosis import diagnose

    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    check_logs([log])
    check_files([log, *log_options.files(log)], force=False)
    opened = log_options.open(log)
    with progress_of_scans("examining", opened.scan_count, quiet=voice.still) as progress:
        found = diagnose(
            opened, range_max=range_max, body_from_sensor=log_options.extrinsics, progress=progress
        )
    for finding in found.findings:
        voice.note(log, finding)
    voice.facts({"log": str(log), **_facts(found)})
    for sensor in found.sensors:
        name = f" of {sensor.sensor_id}" if len(found.sensors) > 1 else ""
        voice.say(f"examined  {sensor.scans:,} scans{name}, with maps of {sensor.places} places")
        voice.say(
            f"measured  maps of some scans say {sensor.information:.2f} nats of each beam of others"
        )
    count = len(found.findings)
    words = {0: "nothing that is sure", 1: "1 thing to look at"}
    voice.say(f"found     {words.get(count, f'{count} things to look at')}")


def _facts(found: Diagnosis) -> dict[str, Any]:
    return {
        "findings": [{"code": note.code, "text": str(note)} for note in found.findings],
        "sensors": [
            {
                "id": sensor.sensor_id,
                "scans": sensor.scans,
                "places": sensor.places,
                "information": sensor.information,
            }
            for sensor in found.sensors
        ],
    }
