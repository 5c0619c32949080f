# SPDX-License-Identifier: Apache-2.0
"""`oddsmap export`: a map to what other software reads."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import typer

from oddsmap.cli.build_plan import EXPORTED
from oddsmap.cli.export_formats import HEIGHTS
from oddsmap.cli.export_log_odds import write_calibrated, write_full_map, write_log_odds
from oddsmap.cli.export_rates import write_decay, write_reflection
from oddsmap.cli.map_regions import corners_of
from oddsmap.cli.options import Quiet, Verbose, flag, force_option
from oddsmap.cli.picture_options import OF_PICTURES
from oddsmap.cli.progress import working
from oddsmap.cli.voice import Voice
from oddsmap.cli.written import Written

__all__ = ["HELP", "export"]

HELP = """Write a map as what other software reads: OUT's suffix decides.

\b
  .yaml             ROS map_server: YAML and an image
  .mcap             messages of ROS 2, for RViz and Foxglove; .bag: of ROS 1
  .png .pdf .svg    a picture
  .npz              arrays
  .tif              GeoTIFF, for QGIS and other GIS
  .bt .ot           OctoMap (3D)
  .las .laz .ply    the occupied cells as points (3D)
  .rrd              a recording of Rerun

\b
  oddsmap export intel.zarr intel.yaml    ROS map_server: YAML and PGM
  oddsmap export intel.zarr intel.yaml --mode scale
                                          the same with probabilities, as PNG
  oddsmap export intel.zarr intel.mcap    nav_msgs/OccupancyGrid on /map
  oddsmap export intel.zarr bag_of_intel --format ros2-bag
                                          the same, for ros2 bag play
  oddsmap export yard.zarr yard.tif --crs EPSG:32632
                                          GeoTIFF: probability, hits, passes
  oddsmap export intel.zarr intel.png     a picture with axes in metres
  oddsmap export intel.zarr intel.pdf --title "Intel lab" \\
    --trajectory intel.log.gz --crop -10 -10 20 6
                                          a part of it for a paper
  oddsmap export town.zarr street.yaml --box "0 0 200 80"
                                          a part of a map of any size
  oddsmap export intel.zarr intel.npz --prior 0.2
                                          cells, counts and probabilities
  oddsmap export intel.zarr intel.png --prior old.yaml
                                          with an older map as the prior
  oddsmap export intel.zarr intel.yaml --p-hit 0.9 --p-miss 0.3 \\
    --free 0.2 --occupied 0.8 --force     other beliefs, other limits

\b
How often cells reflect beams (maps made with --votes beam), with credible
intervals:
  oddsmap export hall.zarr hall.png --posterior reflection
  oddsmap export hall.zarr hall.png --posterior reflection \\
    --show interval-width --level 0.8

\b
MAP may also be the YAML of a ROS map:
  oddsmap export old.yaml old.tif

\b
3D maps (MAP may also be an OctoMap):
  oddsmap export hall.zarr hall.bt        OctoMap: free and occupied;
                                          .ot: log odds
  oddsmap export utm.zarr utm.bt --shift 500000 5400000 0
                                          that point becomes the origin
  oddsmap export hall.zarr hall.laz       the occupied cells as points;
                                          also .las, .ply
  oddsmap export hall.zarr hall.mcap      OctoMaps and points for RViz
  oddsmap export hall.zarr hall.mcap --format foxglove
                                          all cells, as a VoxelGrid
  oddsmap export hall.zarr hall.rrd       voxels for Rerun
  oddsmap export hall.zarr hall.yaml --z-min 0.2 --z-max 1.8 --ground relative
"""


def complete_view(incomplete: str) -> list[str]:
    """The views that may be meant, for the completion of the shell."""
    return [name for name in _VIEWS if name.startswith(incomplete)]


def export(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="MAP",
            help="A saved map (.zarr), an OctoMap (.bt, .ot) or a ROS map (.yaml).",
        ),
    ],
    output: Annotated[
        Path,
        typer.Argument(
            metavar="OUT",
            help=".yaml, .mcap, .bag, .png, .pdf, .svg, .npz, .tif, .bt, .ot, .ply, .las, .laz or "
            ".rrd",
        ),
    ],
    format_: Annotated[
        Literal["ros2-bag", "foxglove"] | None,
        typer.Option(
            "--format",
            help="What no suffix says: ros2-bag is a folder with metadata.yaml, foxglove an .mcap "
            "with a Grid or VoxelGrid alone. By default OUT's suffix decides.",
        ),
    ] = None,
    mode: Annotated[
        Literal["trinary", "scale", "raw"] | None,
        typer.Option(
            help="How a ROS map writes probabilities: trinary by default, scale for reflection."
        ),
    ] = None,
    posterior: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Which view: log-odds, calibrated, reflection or decay; full-map: of such a map.",
            autocompletion=complete_view,
        ),
    ] = "log-odds",
    neighbours: Annotated[
        bool | None,
        typer.Option(
            "--neighbours",
            help="Calibrated: also look at the counts around a cell; .npz lists cells without "
            "evidence near others, too, as not observed.",
        ),
    ] = None,
    prior: Annotated[
        str | None,
        typer.Option(
            metavar="P|MAP",
            help="p(occupied) before any reading: a number, or a map (.zarr, .yaml, .bt, .ot); by "
            "default the map's posterior.prior.",
        ),
    ] = None,
    p_hit: Annotated[
        float | None,
        typer.Option(
            metavar="PROBABILITY", help="Belief in a hit; by default the map's sensor.p_hit."
        ),
    ] = None,
    p_miss: Annotated[
        float | None,
        typer.Option(
            metavar="PROBABILITY", help="Belief after a pass; by default the map's sensor.p_miss."
        ),
    ] = None,
    free: Annotated[
        float | None,
        typer.Option(
            metavar="PROBABILITY",
            help="ROS maps, .bt, points: the largest p of a free cell; by default the map's "
            "posterior.free.",
        ),
    ] = None,
    occupied: Annotated[
        float | None,
        typer.Option(
            metavar="PROBABILITY",
            help="ROS maps, .bt, points, .rrd: the smallest p of an occupied cell; by default the "
            "map's posterior.occupied.",
        ),
    ] = None,
    z_min: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="Space to plane: lowest height that counts; by default any, where --z-max is set.",
        ),
    ] = None,
    z_max: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="Space to plane: where heights end to count; by default nowhere, where --z-min is "
            "set.",
        ),
    ] = None,
    ground: Annotated[
        Literal["none", "relative"] | None,
        typer.Option(
            help="Heights above z = 0 (none, the default), or above the ground found in the map."
        ),
    ] = None,
    rule: Annotated[
        Literal["slabs", "largest"] | None,
        typer.Option(
            help="Space to plane: a column is free after enough passes in each slab of the band "
            "(slabs, the default), or in each seen cell (largest)."
        ),
    ] = None,
    slab: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="Space to plane: height of a slab, by default 0.3; what is lower may be missed "
            "between beams.",
        ),
    ] = None,
    clamp: Annotated[
        tuple[float, float] | None,
        typer.Option(
            metavar="PROBABILITY PROBABILITY",
            help="Lowest and highest p, of the sum of all evidence; by default none. OctoMap's own "
            "are 0.1192 0.971.",
        ),
    ] = None,
    shift: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="METRES METRES METRES",
            help="OctoMap, .rrd: the point that becomes the origin [m], whole cells away, by "
            "default its own; add it to get the map's coordinates back.",
        ),
    ] = None,
    crs: Annotated[
        str | None,
        typer.Option(
            metavar="CRS",
            help=".tif, .las, .laz: what the coordinates are in, such as EPSG:32632; by default "
            "not said.",
        ),
    ] = None,
    frame: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Messages of ROS: the map's frame, by default map."),
    ] = None,
    stamp: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Messages of ROS: the map's time since 1970, by default map.t_ref_ns, or 0.",
        ),
    ] = None,
    show: Annotated[
        Literal["mean", "mode", "std", "interval-width", "lower", "upper", "p-above", "p-pass"]
        | None,
        typer.Option(help="Reflection, decay: what the picture shows; by default the mean."),
    ] = None,
    level: Annotated[
        float | None,
        typer.Option(
            metavar="PROBABILITY",
            help="Reflection, decay: mass of the interval, by default 0.95.",
        ),
    ] = None,
    interval: Annotated[
        Literal["equal-tailed", "highest-density"] | None,
        typer.Option(help="Reflection: which credible interval; by default equal-tailed."),
    ] = None,
    threshold: Annotated[
        float | None,
        typer.Option(
            metavar="PROBABILITY", help="Reflection: the limit of p-above, by default 0.5."
        ),
    ] = None,
    beta_a: Annotated[
        float | None,
        typer.Option(metavar="VOTES", help="Reflection: the prior's weight of hits, by default 1."),
    ] = None,
    beta_b: Annotated[
        float | None,
        typer.Option(metavar="VOTES", help="Reflection: its weight of passes, by default 1."),
    ] = None,
    title: Annotated[
        str | None,
        typer.Option(metavar="TEXT", help="Pictures: a line above the map, by default none."),
    ] = None,
    trajectory: Annotated[
        Path | None,
        typer.Option(
            metavar="LOG|POSES",
            help="Pictures: draw the way of the sensor, of a log or a file of poses; by default "
            "none.",
        ),
    ] = None,
    crop: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(
            metavar="METRES METRES METRES METRES",
            help="Pictures: lowest x and y, highest x and y that are shown; by default what is "
            "known.",
        ),
    ] = None,
    box: Annotated[
        str | None,
        typer.Option(
            metavar="'X0 Y0 X1 Y1'",
            help="Only this part of a saved map is read and written: lowest and highest corner "
            "[metres], of a 3D map x y z of each; by default all.",
        ),
    ] = None,
    size: Annotated[
        int | None,
        typer.Option(
            metavar="PIXELS",
            help="Pictures: the longer side of the map, at most, by default 1200 to 3800.",
        ),
    ] = None,
    whole: Annotated[
        bool,
        typer.Option(
            "--whole",
            help="Pictures: also show the few cells that lie far from all others.",
        ),
    ] = False,
    force: Annotated[bool, force_option("existing files")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Write a map as what other software reads: see `HELP`."""
    voice = Voice(quiet=quiet, verbose=verbose)
    stated = {
        name: value
        for name, value in {
            "format": format_, "mode": mode, "shift": shift, "crs": crs, "frame": frame,
            "neighbours": neighbours,
            "stamp": stamp, "prior": prior, "p_hit": p_hit, "p_miss": p_miss, "free": free,
            "occupied": occupied, "z_min": z_min,
            "z_max": z_max, "ground": ground, "rule": rule, "slab": slab, "clamp": clamp,
            "show": show, "level": level,
            "interval": interval, "threshold": threshold, "beta_a": beta_a, "beta_b": beta_b,
            "title": title, "trajectory": trajectory, "crop": crop, "box": box,
            "size": size,
            "whole": whole or None,
        }.items()
        if value is not None
    }  # fmt: skip
    view = _view_of(posterior, stated)
    _check_suffix(output, stated)
    if box is not None:
        corners_of(box)
    with working(f"writing {output.name}", quiet=voice.still):
        written = view.write(source, output, stated, force, voice)
    voice.say(f"wrote    {', '.join(str(path) for path in written.files)}")
    for note in written.notes:
        voice.say(f"note     {note}")


class _View(NamedTuple):
    """What writes a view, and the options that it knows."""

    write: Callable[[Path, Path, Mapping[str, Any], bool, Voice], Written]
    options: frozenset[str]


_OF_FILES = ("format", "mode", "clamp", "shift", "crs", "frame", "stamp", *OF_PICTURES)

_OF_CELLS = ("prior", "p_hit", "p_miss", "free", "occupied")

_VIEWS = {
    "log-odds": _View(
        write_log_odds,
        frozenset({*_OF_FILES, *_OF_CELLS, *HEIGHTS, "box"}),
    ),
    "calibrated": _View(
        write_calibrated,
        frozenset({*_OF_FILES, "neighbours", "prior", "free", "occupied", *HEIGHTS}),
    ),
    "full-map": _View(
        write_full_map,
        frozenset({*_OF_FILES, "free", "occupied", *HEIGHTS}),
    ),
    "reflection": _View(
        write_reflection,
        frozenset(
            {
                "mode",
                "show",
                "level",
                "interval",
                "threshold",
                "beta_a",
                "beta_b",
                "box",
                *OF_PICTURES,
            }
        ),
    ),
    "decay": _View(write_decay, frozenset({"show", "level", "box", *OF_PICTURES})),
}


def _view_of(posterior: str, stated: Mapping[str, Any]) -> _View:
    """The view of --posterior; options that belong to another view are refused."""
    from oddsmap.errors import ConfigError, did_you_mean

    if posterior not in _VIEWS:
        raise ConfigError(
            f"--posterior {posterior}: there is no such view{did_you_mean(posterior, _VIEWS)} "
            f"(known: {', '.join(_VIEWS)})"
        )
    view = _VIEWS[posterior]
    for name in stated:
        if name not in view.options:
            owners = [other for other, theirs in _VIEWS.items() if name in theirs.options]
            raise ConfigError(
                f"{flag(name)} belongs to --posterior {' or '.join(owners)}, not to {posterior}"
            )
    return view


def _check_suffix(output: Path, stated: Mapping[str, Any]) -> None:
    from oddsmap.cli.export_formats import check_format_options, kind_of
    from oddsmap.cli.files import check_suffix
    from oddsmap.errors import ConfigError

    if stated.get("format") == "foxglove":
        if output.suffix.lower() != ".mcap":
            raise ConfigError(f"{output}: --format foxglove makes an MCAP: name it .mcap")
        return
    if "format" in stated:
        if output.suffix.lower() in EXPORTED:
            raise ConfigError(
                f"{output}: --format ros2-bag makes a folder, and {output.suffix} is a file's "
                "suffix: leave one of them out"
            )
        return
    check_suffix(
        output,
        EXPORTED,
        "the suffix says what to write: .yaml (ROS map), .mcap or .bag (messages of ROS), .png, "
        ".pdf or .svg (picture), .npz (arrays), .tif (GeoTIFF), .bt or .ot (OctoMap), .ply, .las "
        "or .laz (points), .rrd (Rerun); --format ros2-bag makes a folder",
    )
    mode = {name: value for name, value in stated.items() if name == "mode"}
    check_format_options(output, kind_of(output, stated), mode)
