# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap export` writes of the probability of cells: the view of log odds."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from oddsmap.cli.files import check_files
from oddsmap.cli.written import Written

if TYPE_CHECKING:
    from oddsmap.cli.voice import Voice
    from oddsmap.maps.probability_map import ProbabilityMap
    from oddsmap.maps.voxel_map import VoxelMap
    from oddsmap.odds import Thresholds
    from oddsmap.posterior.belief import Belief
    from oddsmap.posterior.prior import MapLike

__all__ = ["write_log_odds"]

_OF_SPACE = (".bt", ".ot", ".ply")
_OF_PLANE = (".yaml", ".yml", ".png")


def write_log_odds(
    source: Path, output: Path, options: Mapping[str, Any], force: bool, voice: Voice
) -> Written:
    """Write the probabilities of a map: as its suffix says.

    Args:
        source: a saved map, a full map or an OctoMap.
        output: the file to write.
        options: those of `oddsmap export` that are stated, by name.
        force: whether to replace existing files.
        voice: says what is doubtful about a prior's file.

    Returns:
        What was written.

    Raises:
        OddsmapError: an option does not fit the map or the file, or one cannot be read or written.
    """
    from oddsmap.cli.undecided import undecided_in_plane, undecided_in_points
    from oddsmap.errors import ConfigError

    suffix = output.suffix.lower()
    clamp = options.get("clamp")
    if clamp is not None and suffix != ".ot":
        raise ConfigError(f"--clamp bounds the probabilities of an .ot, not of {output.name}")
    heights = options.keys() & {"z_min", "z_max", "ground"}
    if suffix not in _OF_PLANE and heights:
        raise ConfigError(f"--z-min, --z-max, --ground make a 2D map, not {output.name}")
    number, prior_file = _prior_of(options.get("prior"), source)
    rates = {name: options.get(name) for name in ("p_hit", "p_miss")}
    _check_values(options, number)
    check_files([source, prior_file], output, force=force)
    prior = number if prior_file is None else _prior_map(prior_file, voice)
    view = _open(source, prior, rates)
    if suffix == ".npz":
        _save_npz(view, output, force=force)
    elif suffix == ".ply":
        view.save_ply(output, force=force)
        return Written([output], undecided_in_points(view))
    elif suffix in _OF_SPACE:
        view.save_octomap(output, clamp=clamp, force=force)
    else:
        grid, thresholds = _plane(
            view, options.get("z_min"), options.get("z_max"), options.get("ground", "none")
        )
        if suffix == ".png":
            from oddsmap.plot.picture import save_png

            save_png(grid, output, force=force)
        else:
            from oddsmap.map_files.ros_writer import save_ros

            mode = options.get("mode", "trinary")
            written = save_ros(grid, output, mode=mode, thresholds=thresholds, force=force)
            note = undecided_in_plane(grid, thresholds, view) if mode == "trinary" else None
            return Written(list(written), note)
    return Written([output])


def _check_values(options: Mapping[str, Any], prior: float | None) -> None:
    """Refuse probabilities and heights that are right for no map, before one is loaded."""
    from oddsmap.errors import ConfigError
    from oddsmap.evidence_map import EvidenceMap

    rates = {name: options.get(name) for name in ("p_hit", "p_miss", "clamp")}
    EvidenceMap(1.0).log_odds(prior=prior, **rates)
    low, high = options.get("z_min"), options.get("z_max")
    if low is not None and high is not None and not low < high:
        raise ConfigError(f"--z-min has to lie below --z-max, got {low:g} and {high:g}")


def _open(
    source: Path, prior: float | MapLike | None, rates: Mapping[str, Any]
) -> Belief | VoxelMap:
    from oddsmap.errors import ConfigError
    from oddsmap.evidence_map import load_map
    from oddsmap.full_map.full_map import load_full_map
    from oddsmap.full_map.store import is_full_map
    from oddsmap.map_files.octomap_reader import is_octomap
    from oddsmap.maps.voxel_map import load_octomap

    kind = "an OctoMap" if is_octomap(source) else "a full map" if is_full_map(source) else None
    if kind is not None and any(value is not None for value in (prior, *rates.values())):
        raise ConfigError(
            f"{source}: {kind} has no counts; --prior, --p-hit and --p-miss need those"
        )
    if kind is not None:
        return load_octomap(source) if is_octomap(source) else load_full_map(source)
    grid = load_map(source)
    return grid.log_odds(prior=prior, **rates)


def _prior_of(text: str | None, source: Path) -> tuple[float | None, Path | None]:
    """What --prior says: a number, or a file."""
    from oddsmap.errors import ConfigError

    if text is None:
        return None, None
    try:
        return float(text), None
    except ValueError:
        path = Path(text)
    if not path.exists():
        raise ConfigError(
            f"--prior {text}: neither a number nor a file; give a probability between 0 and 1, "
            "or a map (.zarr, .yaml of a ROS map, .bt or .ot)"
        )
    if path.resolve() == source.resolve():
        raise ConfigError(f"--prior {text}: the map itself; its evidence would count twice")
    return None, path


def _prior_map(path: Path, voice: Voice) -> MapLike:
    from oddsmap.errors import ConfigError
    from oddsmap.evidence.store import is_map
    from oddsmap.evidence_map import load_map
    from oddsmap.full_map.store import is_full_map
    from oddsmap.map_files.octomap_reader import is_octomap
    from oddsmap.maps.probability_map import load_ros
    from oddsmap.maps.voxel_map import load_octomap

    if is_full_map(path):
        raise ConfigError(
            f"--prior {path}: a full map; export it as a ROS map (.yaml, --mode raw), which can be "
            "a prior"
        )
    if is_map(path):
        return load_map(path)
    if path.suffix.lower() in (".yaml", ".yml"):
        prior = load_ros(path)
        for note in prior.notes:
            voice.note(path, note, err=True)
        return prior
    if is_octomap(path):
        return load_octomap(path)
    raise ConfigError(
        f"--prior {path}: not a map that can be a prior; known: a saved map (.zarr), the .yaml of "
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
            raise ConfigError("--z-min, --z-max and --ground need a 3D map, this one is 2D")
        return view.to_probability_map(), thresholds
    if not banded:
        raise ConfigError(
            "this map is 3D: say which heights make the 2D map, for example "
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
