# SPDX-License-Identifier: Apache-2.0
"""`oddsmap costmap`: a map as the costs of Nav2's planners."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from oddsmap.cli.options import Quiet, Verbose, force_option
from oddsmap.cli.progress import working
from oddsmap.cli.voice import Voice

__all__ = ["HELP", "costmap"]

HELP = """Write a map as costs around obstacles, by the formulas of Nav2's inflation layer.

\b
  oddsmap costmap intel.zarr costs.yaml --inscribed-radius 0.22
                                          a ROS map, mode raw, for map_server
  oddsmap costmap hall.zarr costs.yaml --inscribed-radius 0.3 \\
    --z-min 0.2 --z-max 1.8               of a band of heights of a 3D map

The image holds what Nav2 publishes of a costmap: 0 free, 1 to 98 near an
obstacle, 99 where the robot touches it, 100 the obstacle, 255 unknown.
"""


def costmap(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="MAP",
            help="A saved map (.zarr), an OctoMap (.bt, .ot) or a ROS map (.yaml).",
        ),
    ],
    output: Annotated[Path, typer.Argument(metavar="OUT", help="The .yaml to write.")],
    inscribed_radius: Annotated[
        float,
        typer.Option(
            metavar="METRES",
            help="Of the largest circle in the robot's footprint about its centre.",
        ),
    ],
    inflation_radius: Annotated[
        float, typer.Option(metavar="METRES", help="Where costs around obstacles end.")
    ] = 0.55,
    cost_scaling_factor: Annotated[
        float, typer.Option(metavar="PER_METRE", help="How fast costs fall off.")
    ] = 10.0,
    inflate_unknown: Annotated[
        bool,
        typer.Option("--inflate-unknown", help="Unknown cells near obstacles get a cost, too."),
    ] = False,
    inflate_around_unknown: Annotated[
        bool, typer.Option("--inflate-around-unknown", help="Unknown cells are obstacles.")
    ] = False,
    free: Annotated[
        float | None,
        typer.Option(
            metavar="PROBABILITY",
            help="The largest p of a free cell; by default the map's posterior.free.",
        ),
    ] = None,
    occupied: Annotated[
        float | None,
        typer.Option(
            metavar="PROBABILITY",
            help="The smallest p of an occupied cell; by default the map's posterior.occupied.",
        ),
    ] = None,
    z_min: Annotated[
        float | None,
        typer.Option(metavar="METRES", help="3D maps: lowest height that counts; by default any."),
    ] = None,
    z_max: Annotated[
        float | None,
        typer.Option(
            metavar="METRES", help="3D maps: where heights end to count; by default nowhere."
        ),
    ] = None,
    ground: Annotated[
        Literal["none", "relative"],
        typer.Option(help="3D maps: heights above z = 0, or above the ground found in the map."),
    ] = "none",
    force: Annotated[bool, force_option("existing files")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Write a map as costs: see `HELP`."""
    import numpy as np

    from oddsmap.cli.export_plane import grid_of
    from oddsmap.cli.export_sources import open_source
    from oddsmap.cli.files import check_files, check_suffix
    from oddsmap.errors import ConfigError
    from oddsmap.map_files.ros_writer import image_beside
    from oddsmap.odds import Thresholds
    from oddsmap.query.costmap import Costmap, inflate

    voice = Voice(quiet=quiet, verbose=verbose)
    Thresholds(0.0 if free is None else free, 1.0 if occupied is None else occupied)
    if z_min is not None and z_max is not None and not z_min < z_max:
        raise ConfigError(f"--z-min has to lie below --z-max, got {z_min:g} and {z_max:g}")
    radii: dict[str, Any] = {
        "inscribed_radius": inscribed_radius,
        "inflation_radius": inflation_radius,
        "cost_scaling_factor": cost_scaling_factor,
    }
    inflate(np.zeros((1, 1), np.uint8), 1.0, **radii)  # refuses wrong ones
    check_suffix(output, (".yaml", ".yml"), "a costmap is written as a ROS map, named by its .yaml")
    check_files([source], output, beside=image_beside(output, "raw"), force=force)
    stated = {"free": free, "occupied": occupied, "z_min": z_min, "z_max": z_max}
    options = {name: value for name, value in stated.items() if value is not None}
    with working(f"writing {output.name}", quiet=voice.still):
        view = open_source(source, None, {}, voice)
        grid, thresholds = grid_of(view, {**options, "ground": ground})
        costs = grid.costmap(
            **radii, inflate_unknown=inflate_unknown,
            inflate_around_unknown=inflate_around_unknown, thresholds=thresholds,
        )  # fmt: skip
        files = costs.save_ros(output, force=force)
    ny, nx = costs.cost.shape
    shares = {
        "free": costs.cost < Costmap.INSCRIBED,
        "in collision": (costs.cost >= Costmap.INSCRIBED) & (costs.cost <= Costmap.LETHAL),
        "unknown": costs.cost == Costmap.NO_INFORMATION,
    }
    said = ", ".join(f"{100.0 * np.mean(part):.1f} % {name}" for name, part in shares.items())
    voice.say(f"costs    {nx} x {ny} cells of {costs.resolution:g} m: {said}")
    voice.say(f"wrote    {', '.join(str(path) for path in files)}")
