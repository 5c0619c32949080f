# SPDX-License-Identifier: Apache-2.0
"""`oddsmap demo`: the main job on data that needs no download."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from oddsmap.cli.options import force_option

__all__ = ["demo"]

_RESOLUTION = 0.05


def demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Where to put the files.")
    ] = Path("oddsmap-demo"),
    force: Annotated[bool, force_option("existing files")] = False,
) -> None:
    """Simulate a robot with a 2D LIDAR in an office, write its log, map it, draw the map."""
    import numpy as np

    from oddsmap.atomic_write import check_output
    from oddsmap.evidence_map import build_map
    from oddsmap.map_files.zarr_folder import check_map_output
    from oddsmap.readers import open_log
    from oddsmap.simulate import Lidar2D, office_drive, office_plan, write_carmen

    log_path, map_path = output / "office.log.gz", output / "office.zarr"
    ros_path, picture = output / "office.yaml", output / "office.png"
    output.mkdir(parents=True, exist_ok=True)
    check_map_output(map_path, force=force)
    for path in (log_path, ros_path, picture):
        check_output(path, force=force)

    say = typer.echo
    drive = office_drive()
    say(f"1. A robot drives through an office: {len(drive)} scans of a simulated 2D LIDAR.")
    lidar = Lidar2D(
        361, -math.pi / 2, math.radians(0.5), range_max=15.0, p_dropout=0.01, p_random=0.0002
    )
    plan, rng = office_plan(), np.random.default_rng(0)
    write_carmen(log_path, (lidar.scan(plan, pose, rng) for pose in drive), force=force)
    say(f"   {log_path}")

    say("2. Its log becomes a map. (The first run compiles the kernels: some 10 s, once.)")
    log = open_log(log_path)
    grid = build_map(log, _RESOLUTION)
    grid.save(map_path, force=force)
    say(f"   {map_path}: {grid.cell_count() * _RESOLUTION**2:.0f} square metres")

    say("3. The map becomes what other software reads.")
    view = grid.log_odds()
    view.save_ros(ros_path, force=force)
    view.save_png(picture, force=force)
    say(f"   {ros_path} and .pgm for ROS, {picture} to look at")
    say(f"Next: oddsmap build {log_path} --resolution 0.1 -o {output / 'coarse.zarr'}")
