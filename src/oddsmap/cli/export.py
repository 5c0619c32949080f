# SPDX-License-Identifier: Apache-2.0
"""`oddsmap export`: a map to what other software reads."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    from oddsmap.posterior.log_odds import LogOdds
    from oddsmap.probability_map import ProbabilityMap, Thresholds
    from oddsmap.voxels import VoxelMap

__all__ = ["HELP", "export"]

HELP = """Write a map as a ROS map, a picture, arrays, an OctoMap or points: OUT's suffix decides.

\b
  oddsmap export intel.zarr intel.yaml                 ROS map_server: YAML and PGM
  oddsmap export intel.zarr intel.yaml --mode scale    the same with probabilities, as PNG
  oddsmap export intel.zarr intel.png                  a picture with axes in metres
  oddsmap export intel.zarr intel.npz --prior 0.2      cells, counts and probabilities

\b
Maps of space, MAP may be an OctoMap, too:
  oddsmap export hall.zarr hall.bt                     OctoMap: free and occupied; .ot: log odds
  oddsmap export hall.zarr hall.ply                    the occupied cells as points
  oddsmap export hall.zarr hall.yaml --z-min 0.2 --z-max 1.8 --ground relative
"""

_SUFFIXES = (".yaml", ".yml", ".png", ".npz", ".bt", ".ot", ".ply")
_OF_SPACE = (".bt", ".ot", ".ply")
_OF_PLANE = (".yaml", ".yml", ".png")


def export(
    source: Annotated[Path, typer.Argument(metavar="MAP")],
    output: Annotated[
        Path, typer.Argument(metavar="OUT", help=".yaml, .png, .npz, .bt, .ot or .ply")
    ],
    mode: Annotated[
        Literal["trinary", "scale", "raw"], typer.Option(help="How a ROS map writes probabilities.")
    ] = "trinary",
    posterior: Annotated[str, typer.Option(metavar="NAME", help="Which view.")] = "log-odds",
    prior: Annotated[
        str | None, typer.Option(metavar="P", help="p(occupied) before any reading.")
    ] = None,
    p_hit: Annotated[float | None, typer.Option(metavar="P", help="Belief in a hit.")] = None,
    p_miss: Annotated[float | None, typer.Option(metavar="P", help="Belief after a pass.")] = None,
    z_min: Annotated[
        float | None, typer.Option(metavar="M", help="Space to plane: lowest height that counts.")
    ] = None,
    z_max: Annotated[
        float | None, typer.Option(metavar="M", help="Space to plane: where heights end to count.")
    ] = None,
    ground: Annotated[
        Literal["none", "relative"],
        typer.Option(help="Heights above z = 0, or above a plane fitted to the ground."),
    ] = "none",
    clamp: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="P P", help="Bounds of p in an .ot; OctoMap's own: 0.1192 0.971."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
) -> None:
    """Write a map as a ROS map, a picture, arrays, an OctoMap or points: see `HELP`."""
    from oddsmap.errors import ConfigError

    if posterior != "log-odds":
        raise ConfigError(f'--posterior {posterior}: not available, this version has "log-odds"')
    suffix = output.suffix.lower()
    if suffix not in _SUFFIXES:
        raise ConfigError(
            f"{output}: the suffix says what to write: .yaml (ROS map), .png (picture), .npz "
            f'(arrays), .bt or .ot (OctoMap), .ply (points); got "{output.suffix}"'
        )
    if clamp is not None and suffix != ".ot":
        raise ConfigError(f"--clamp bounds the probabilities of an .ot, not of {output.name}")
    if suffix not in _OF_PLANE and (z_min, z_max, ground) != (None, None, "none"):
        raise ConfigError(f"--z-min, --z-max, --ground make a map of the plane, not {output.name}")
    view = _open(source, prior=_number(prior), p_hit=p_hit, p_miss=p_miss)
    written = [output]
    if suffix == ".npz":
        _save_npz(view, output, force=force)
    elif suffix == ".ply":
        view.save_ply(output, force=force)
    elif suffix in _OF_SPACE:
        view.save_octomap(output, clamp=clamp, force=force)
    else:
        grid, thresholds = _plane(view, z_min, z_max, ground)
        if suffix == ".png":
            from oddsmap.plot.picture import save_png

            save_png(grid, output, force=force)
        else:
            from oddsmap.export.ros import save_ros

            written = list(save_ros(grid, output, mode=mode, thresholds=thresholds, force=force))
    typer.echo(f"wrote    {', '.join(str(path) for path in written)}")


def _open(
    source: Path, *, prior: float | None, p_hit: float | None, p_miss: float | None
) -> LogOdds | VoxelMap:
    from oddsmap.errors import ConfigError
    from oddsmap.export.octomap_reader import is_octomap, load_octomap
    from oddsmap.store import load_map

    if not is_octomap(source):
        return load_map(source).log_odds(p_hit=p_hit, p_miss=p_miss, prior=prior)
    if (prior, p_hit, p_miss) != (None, None, None):
        raise ConfigError(
            f"{source}: an OctoMap has no counts; --prior, --p-hit and --p-miss need those"
        )
    return load_octomap(source)


def _plane(
    view: LogOdds | VoxelMap, z_min: float | None, z_max: float | None, ground: str
) -> tuple[ProbabilityMap, Thresholds | None]:
    from oddsmap.errors import ConfigError
    from oddsmap.posterior.log_odds import LogOdds
    from oddsmap.projection import project

    banded = z_min is not None or z_max is not None
    thresholds = view.thresholds if isinstance(view, LogOdds) else None
    if isinstance(view, LogOdds) and view.evidence.ndim == 2:
        if banded or ground != "none":
            raise ConfigError(
                "--z-min, --z-max and --ground need a map of space, this one is of the plane"
            )
        return view.to_probability_map(), thresholds
    if not banded:
        raise ConfigError(
            "this map is of space: say which heights make the map of the plane, for example "
            "--z-min 0.2 --z-max 1.8 --ground relative"
        )
    lowest = -float("inf") if z_min is None else z_min
    highest = float("inf") if z_max is None else z_max
    grid = project(view, lowest, highest, ground="relative" if ground == "relative" else None)
    return grid, thresholds


def _save_npz(view: LogOdds | VoxelMap, output: Path, *, force: bool) -> None:
    from oddsmap.errors import ConfigError
    from oddsmap.posterior.log_odds import LogOdds

    if not isinstance(view, LogOdds):
        raise ConfigError(f"{output}: the arrays list hits and passes, an OctoMap has none")
    view.save_npz(output, force=force)


def _number(prior: str | None) -> float | None:
    from oddsmap.errors import ConfigError

    if prior is None:
        return None
    try:
        return float(prior)
    except ValueError:
        raise ConfigError(
            f"--prior {prior}: a probability is needed; a map as the prior is not available yet"
        ) from None
