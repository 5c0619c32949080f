# SPDX-License-Identifier: Apache-2.0
"""`oddsmap demo`: the main job on data that needs no download."""

from __future__ import annotations

import math
from pathlib import Path
from shlex import quote
from typing import Annotated

import typer

from oddsmap.cli.compiling import when_compiling
from oddsmap.cli.options import Quiet, Verbose, force_option
from oddsmap.cli.voice import Voice

__all__ = ["HELP", "demo"]

HELP = """Simulate a robot in an office, write its log, map it, draw the map.

\b
  oddsmap demo                          into the folder oddsmap-demo
  oddsmap demo -o elsewhere --force     elsewhere, again
"""

_RESOLUTION = 0.05


def demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Where to put the files.")
    ] = Path("oddsmap-demo"),
    force: Annotated[bool, force_option("existing files")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Simulate, map and draw: see `HELP`."""
    import numpy as np

    from oddsmap.atomic_write import check_output
    from oddsmap.errors import OutputError
    from oddsmap.evidence_map import build_map
    from oddsmap.map_files.zarr_folder import check_map_output
    from oddsmap.readers import open_log
    from oddsmap.simulate import Lidar2D, office_drive, office_plan, write_carmen

    voice = Voice(quiet=quiet, verbose=verbose)
    log_path, map_path = output / "office.log.gz", output / "office.zarr"
    ros_path, picture = output / "office.yaml", output / "office.png"
    if output.exists() and not output.is_dir():
        raise OutputError(f"{output}: is a file; give the name of a folder")
    output.mkdir(parents=True, exist_ok=True)
    check_map_output(map_path, force=force)
    for path in (log_path, ros_path, picture):
        check_output(path, force=force)

    say = voice.say
    drive = office_drive()
    say(f"1. A robot drives through an office: {len(drive)} scans of a simulated 2D LIDAR.")
    lidar = Lidar2D(
        361, -math.pi / 2, math.radians(0.5), range_max=15.0, p_dropout=0.01, p_random=0.0002
    )
    plan, rng = office_plan(), np.random.default_rng(0)
    write_carmen(log_path, (lidar.scan(plan, pose, rng) for pose in drive), force=force)
    say(f"   {log_path}")

    say("2. Its log becomes a map.")
    log = open_log(log_path)
    with when_compiling(lambda what: say(f"   ({what}: 10 to 20 s)")):
        grid = build_map(log, _RESOLUTION)
    grid.save(map_path, force=force)
    say(f"   {map_path}: {grid.cell_count() * _RESOLUTION**2:.0f} square metres")

    say("3. The map becomes what other software reads.")
    view = grid.log_odds()
    view.save_ros(ros_path, force=force)
    view.save_png(picture, force=force)
    say(f"   {ros_path} and .pgm for ROS, {picture} to look at")
    coarse = quote(str(output / "coarse.zarr"))
    say(f"Next: oddsmap build {quote(str(log_path))} --resolution 0.1 -o {coarse}")
