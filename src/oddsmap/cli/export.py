# SPDX-License-Identifier: Apache-2.0
"""`oddsmap export`: a map to what other software reads."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from oddsmap.cli.views import flag, write_decay, write_reflection

if TYPE_CHECKING:
    from oddsmap.maps.probability_map import ProbabilityMap
    from oddsmap.maps.voxel_map import VoxelMap
    from oddsmap.odds import Thresholds
    from oddsmap.posterior.belief import Belief
    from oddsmap.posterior.prior import MapLike

__all__ = ["HELP", "export"]

HELP = """Write a map as a ROS map, a picture, arrays, an OctoMap or points: OUT's suffix decides.

\b
  oddsmap export intel.zarr intel.yaml                 ROS map_server: YAML and PGM
  oddsmap export intel.zarr intel.yaml --mode scale    the same with probabilities, as PNG
  oddsmap export intel.zarr intel.png                  a picture with axes in metres
  oddsmap export intel.zarr intel.npz --prior 0.2      cells, counts and probabilities
  oddsmap export intel.zarr intel.png --prior old.yaml with an older map as the prior

\b
How often cells reflect beams (maps made with --votes beam), with credible intervals:
  oddsmap export hall.zarr hall.png --posterior reflection
  oddsmap export hall.zarr hall.png --posterior reflection --show interval-width --level 0.8

\b
Maps of space, MAP may be an OctoMap, too:
  oddsmap export hall.zarr hall.bt                     OctoMap: free and occupied; .ot: log odds
  oddsmap export hall.zarr hall.ply                    the occupied cells as points
  oddsmap export hall.zarr hall.yaml --z-min 0.2 --z-max 1.8 --ground relative
"""

_SUFFIXES = (".yaml", ".yml", ".png", ".npz", ".bt", ".ot", ".ply")
_OF_SPACE = (".bt", ".ot", ".ply")
_OF_PLANE = (".yaml", ".yml", ".png")

_Options = Mapping[str, Any]


def export(
    source: Annotated[Path, typer.Argument(metavar="MAP")],
    output: Annotated[
        Path, typer.Argument(metavar="OUT", help=".yaml, .png, .npz, .bt, .ot or .ply")
    ],
    mode: Annotated[
        Literal["trinary", "scale", "raw"] | None,
        typer.Option(
            help="How a ROS map writes probabilities: trinary by default, scale for reflection."
        ),
    ] = None,
    posterior: Annotated[
        str, typer.Option(metavar="NAME", help="Which view: log-odds, reflection or decay.")
    ] = "log-odds",
    prior: Annotated[
        str | None,
        typer.Option(
            metavar="P|MAP",
            help="p(occupied) before any reading: a number, or a map (.zarr, .yaml, .bt, .ot).",
        ),
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
        Literal["none", "relative"] | None,
        typer.Option(help="Heights above z = 0 (none), or above the ground found in the map."),
    ] = None,
    clamp: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="P P", help="Bounds of p in an .ot; OctoMap's own: 0.1192 0.971."),
    ] = None,
    show: Annotated[
        Literal["mean", "mode", "std", "interval-width", "lower", "upper", "p-above", "p-pass"]
        | None,
        typer.Option(help="Reflection, decay: what the picture shows; by default the mean."),
    ] = None,
    level: Annotated[
        float | None,
        typer.Option(metavar="P", help="Reflection, decay: mass of the interval, 0.95."),
    ] = None,
    interval: Annotated[
        Literal["equal-tailed", "highest-density"] | None,
        typer.Option(help="Reflection: which credible interval; by default equal-tailed."),
    ] = None,
    threshold: Annotated[
        float | None, typer.Option(metavar="P", help="Reflection: the limit of p-above, 0.5.")
    ] = None,
    beta_a: Annotated[
        float | None, typer.Option(metavar="N", help="Reflection: the prior's weight of hits, 1.")
    ] = None,
    beta_b: Annotated[
        float | None, typer.Option(metavar="N", help="Reflection: its weight of passes, 1.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
) -> None:
    """Write a map as a ROS map, a picture, arrays, an OctoMap or points: see `HELP`."""
    from oddsmap.errors import ConfigError

    given = {
        name: value
        for name, value in {
            "mode": mode, "prior": prior, "p_hit": p_hit, "p_miss": p_miss, "z_min": z_min,
            "z_max": z_max, "ground": ground, "clamp": clamp, "show": show, "level": level,
            "interval": interval, "threshold": threshold, "beta_a": beta_a, "beta_b": beta_b,
        }.items()
        if value is not None
    }  # fmt: skip
    if posterior not in _POSTERIORS:
        raise ConfigError(f"--posterior {posterior}: unknown, known: {', '.join(_POSTERIORS)}")
    write, options = _POSTERIORS[posterior]
    for name in given:
        if name not in options:
            owners = [view for view, (_, theirs) in _POSTERIORS.items() if name in theirs]
            raise ConfigError(
                f"{flag(name)} belongs to --posterior {' or '.join(owners)}, not to {posterior}"
            )
    suffix = output.suffix.lower()
    if suffix not in _SUFFIXES:
        raise ConfigError(
            f"{output}: the suffix says what to write: .yaml (ROS map), .png (picture), .npz "
            f'(arrays), .bt or .ot (OctoMap), .ply (points); got "{output.suffix}"'
        )
    if mode is not None and suffix not in (".yaml", ".yml"):
        raise ConfigError(f"--mode says how a ROS map is written, not {output.name}")
    written = write(source, output, given, force)
    typer.echo(f"wrote    {', '.join(str(path) for path in written)}")


def _write_log_odds(source: Path, output: Path, given: _Options, force: bool) -> list[Path]:
    from oddsmap.errors import ConfigError

    suffix = output.suffix.lower()
    clamp = given.get("clamp")
    if clamp is not None and suffix != ".ot":
        raise ConfigError(f"--clamp bounds the probabilities of an .ot, not of {output.name}")
    heights = given.keys() & {"z_min", "z_max", "ground"}
    if suffix not in _OF_PLANE and heights:
        raise ConfigError(f"--z-min, --z-max, --ground make a map of the plane, not {output.name}")
    view = _open(source, **{name: given.get(name) for name in ("prior", "p_hit", "p_miss")})
    if suffix == ".npz":
        _save_npz(view, output, force=force)
    elif suffix == ".ply":
        view.save_ply(output, force=force)
    elif suffix in _OF_SPACE:
        view.save_octomap(output, clamp=clamp, force=force)
    else:
        grid, thresholds = _plane(
            view, given.get("z_min"), given.get("z_max"), given.get("ground", "none")
        )
        if suffix == ".png":
            from oddsmap.plot.picture import save_png

            save_png(grid, output, force=force)
        else:
            from oddsmap.map_files.ros_writer import save_ros

            mode = given.get("mode", "trinary")
            return list(save_ros(grid, output, mode=mode, thresholds=thresholds, force=force))
    return [output]


_Writer = Callable[[Path, Path, _Options, bool], list[Path]]

# Each view: what writes it, and the options that it knows.
_POSTERIORS: dict[str, tuple[_Writer, frozenset[str]]] = {
    "log-odds": (
        _write_log_odds,
        frozenset({"mode", "prior", "p_hit", "p_miss", "z_min", "z_max", "ground", "clamp"}),
    ),
    "reflection": (
        write_reflection,
        frozenset({"mode", "show", "level", "interval", "threshold", "beta_a", "beta_b"}),
    ),
    "decay": (write_decay, frozenset({"show", "level"})),
}


def _open(
    source: Path, *, prior: str | None, p_hit: float | None, p_miss: float | None
) -> Belief | VoxelMap:
    from oddsmap.errors import ConfigError
    from oddsmap.evidence_map import load_map
    from oddsmap.full_map.full_map import load_full_map
    from oddsmap.full_map.store import is_full_map
    from oddsmap.map_files.octomap_reader import is_octomap
    from oddsmap.maps.voxel_map import load_octomap

    kind = "an OctoMap" if is_octomap(source) else "a full map" if is_full_map(source) else None
    if kind is not None and (prior, p_hit, p_miss) != (None, None, None):
        raise ConfigError(
            f"{source}: {kind} has no counts; --prior, --p-hit and --p-miss need those"
        )
    if kind is not None:
        return load_octomap(source) if is_octomap(source) else load_full_map(source)
    grid = load_map(source)
    belief = None if prior is None else _prior(prior, source)
    return grid.log_odds(p_hit=p_hit, p_miss=p_miss, prior=belief)


def _prior(text: str, source: Path) -> float | MapLike:
    """What --prior says: a number, or the map in a file."""
    from oddsmap.errors import ConfigError
    from oddsmap.evidence.store import is_map
    from oddsmap.evidence_map import load_map
    from oddsmap.full_map.store import is_full_map
    from oddsmap.map_files.octomap_reader import is_octomap
    from oddsmap.maps.probability_map import load_ros
    from oddsmap.maps.voxel_map import load_octomap

    try:
        return float(text)
    except ValueError:
        path = Path(text)
    if not path.exists():
        raise ConfigError(
            f"--prior {text}: neither a number nor a file; give a probability between 0 and 1, "
            "or a map (.zarr, .yaml of a ROS map, .bt or .ot)"
        )
    if path.resolve() == source.resolve():
        raise ConfigError(f"--prior {text}: the map itself; its evidence would count twice")
    if is_full_map(path):
        raise ConfigError(
            f"--prior {text}: a full map; export it as a ROS map (.yaml, --mode raw), which can be "
            "a prior"
        )
    if is_map(path):
        return load_map(path)
    if path.suffix.lower() in (".yaml", ".yml"):
        return load_ros(path)
    if is_octomap(path):
        return load_octomap(path)
    raise ConfigError(
        f"--prior {text}: not a map that can be a prior; known: a saved map (.zarr), the .yaml of "
        "a ROS map, an OctoMap (.bt, .ot)"
    )


def _plane(
    view: Belief | VoxelMap, z_min: float | None, z_max: float | None, ground: str
) -> tuple[ProbabilityMap, Thresholds | None]:
    from oddsmap.errors import ConfigError
    from oddsmap.posterior.belief import Belief
    from oddsmap.projection.project import project

    banded = z_min is not None or z_max is not None
    thresholds = view.thresholds if isinstance(view, Belief) else None
    if isinstance(view, Belief) and view.ndim == 2:
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


def _save_npz(view: Belief | VoxelMap, output: Path, *, force: bool) -> None:
    from oddsmap.errors import ConfigError
    from oddsmap.posterior.belief import Belief

    if not isinstance(view, Belief):
        raise ConfigError(f"{output}: the arrays list hits and passes, an OctoMap has none")
    view.save_npz(output, force=force)
