# SPDX-License-Identifier: Apache-2.0
"""`oddsmap info`: what is in a log or in a map."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oddsmap.cli.layout import fitted, screen_width
from oddsmap.cli.log_options import LogOptions
from oddsmap.cli.options import (
    Columns,
    Origin,
    PointsIn,
    Poses,
    Quiet,
    SkipBad,
    Verbose,
    json_option,
)
from oddsmap.cli.progress import progress_of_scans, working
from oddsmap.cli.setting_fields import set_fields
from oddsmap.cli.voice import Voice

if TYPE_CHECKING:
    from oddsmap.array_types import IntArray
    from oddsmap.full_map.full_map import FullMap
    from oddsmap.map_files.ros_reader import RosGrid
    from oddsmap.maps.voxel_map import VoxelMap
    from oddsmap.scans.log import Log

__all__ = ["HELP", "info"]

HELP = """Say what is in a log or in a map.

\b
  oddsmap info intel.log.gz
  oddsmap info intel.zarr --json
  oddsmap info hall.bt
  oddsmap info depot.yaml                 a ROS map
"""


def info(
    path: Annotated[
        Path,
        typer.Argument(
            metavar="PATH", help="A log, a saved map, an OctoMap, or a ROS map (.yaml)."
        ),
    ],
    poses: Poses = None,
    points_in: PointsIn = None,
    origin: Origin = None,
    columns: Columns = None,
    skip_bad: SkipBad = False,
    as_json: Annotated[bool, json_option("the facts")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Say what is in a log or in a map: see `HELP`."""
    from oddsmap.cli.files import check_files

    voice = Voice(quiet=quiet, verbose=verbose, as_json=as_json)
    options = LogOptions(
        poses=poses, points_in=points_in, origin=origin, columns=columns, skip_bad=skip_bad
    )
    check_files([path, *options.files(path)], force=False)
    facts = _facts(path, options, quiet=voice.still)
    voice.facts(facts)
    for line in _lines(facts, all_settings=verbose):
        # A command stays one line, so that it can be copied.
        command = line.startswith("map it")
        voice.say(line if command else fitted(line, screen_width()))


def _facts(path: Path, log_options: LogOptions, *, quiet: bool) -> dict[str, Any]:
    from oddsmap.cli.export_sources import check_no_image, is_ros_map
    from oddsmap.full_map.store import is_full_map
    from oddsmap.map_files.octomap_reader import is_octomap
    from oddsmap.map_files.zarr_snapshot import holds
    from oddsmap.readers.recorded import is_recording

    with working(f"reading {path.name}", quiet=quiet, compiles=False):
        if holds(path, "hits"):  # `is_map`, without the kernels that evidence comes with
            return _of_map(path)
        if is_full_map(path):
            from oddsmap.full_map.full_map import load_full_map

            return _of_full_map(load_full_map(path), path)
        if is_octomap(path):
            from oddsmap.maps.voxel_map import load_octomap

            return _of_octomap(load_octomap(path), path)
        check_no_image(path)
        if is_ros_map(path):
            from oddsmap.map_files.ros_reader import read_ros

            return _of_ros_map(read_ros(path), path)
        if is_recording(str(path)):
            from oddsmap.errors import ConfigError
            from oddsmap.recordings.ros_recording import open_ros_recording
            from oddsmap.recordings.summary import describe

            if log_options != LogOptions(skip_bad=log_options.skip_bad):
                raise ConfigError(
                    f"{path}: info lists all that a recording holds: leave --poses, "
                    "--points-in, --origin and --columns out"
                )
            # Damage is one of the facts.
            return describe(open_ros_recording(str(path), skip_bad=True))
        log = log_options.open(path)
    with progress_of_scans("reading", log.scan_count, quiet=quiet, compiles=False) as progress:
        return _of_log(log, progress)


def _lines(facts: dict[str, Any], *, all_settings: bool) -> Iterator[str]:
    """A label and a text each; where a fact has several lines, the label stands in the first."""
    for name, value in facts.items():
        label = name
        for line in _texts(name, value, all_settings=all_settings):
            yield f"{label:<12} {line}"
            label = ""


def _texts(name: str, value: Any, *, all_settings: bool) -> list[str]:
    if name == "config":
        rest = [] if all_settings else ["(all others as oddsmap config lists them)"]
        return _settings(value, all_settings=all_settings) + rest
    if name == "resolution":
        return [f"{_word(value)} m"]
    if name == "made from":
        return [text for entry in value for text in _source(entry, all_settings=all_settings)]
    if name == "own votes predicted":
        return [f"by log odds {value['log_odds']:.4f}, by a constant {value['constant']:.4f}"
                " (log loss)"]  # fmt: skip
    if name == "topics":
        return [_topic(topic, said) for topic, said in value.items()] or ["none"]
    if isinstance(value, dict):
        return [f"{key} {_word(item)}" for key, item in value.items()] or ["none"]
    if isinstance(value, list) and value and isinstance(value[0], str):
        return value
    return [_word(value)]


def _topic(name: str, said: dict[str, Any]) -> str:
    """A topic of a recording: its name, how many messages of which type, and how often."""
    rate = f", {_word(said['hz'])} per second" if "hz" in said else ""
    frames = said.get("frames", [])
    more = f" and {len(frames) - 4} more" if len(frames) > 4 else ""
    frames = f", in {', '.join(frames[:4])}{more}" if frames else ""
    return f"{name}: {_word(said['count'])} x {said['type']}{rate}{frames}"


def _settings(config: dict[str, Any], *, all_settings: bool) -> list[str]:
    """What of a configuration is not the default, or all of it."""
    stated = set_fields(config)
    if all_settings:
        stated = {
            f"{section}.{key}": item for section in config for key, item in config[section].items()
        }
    return [f"{key} = {_word(item)}" for key, item in stated.items()]


def _source(entry: dict[str, Any], *, all_settings: bool) -> list[str]:
    """What a map was made from: one entry of its provenance."""
    entry = dict(entry)
    skipped, sensor = entry.pop("skipped", {}), entry.pop("sensor", {})
    source = entry.pop("source", None) or "scans without a file"
    counts = [f"{_word(entry.pop(key))} {key}" for key in ("scans", "beams") if key in entry]
    lines = [": ".join([str(source), ", ".join(counts)]) if counts else str(source)]
    lines += [f"  skipped {_word(count)} x {reason}" for reason, count in skipped.items()]
    if sensor:
        stated = _settings({"sensor": sensor}, all_settings=all_settings)
        lines += [f"  {line}" for line in stated]
    return lines + [f"  {key} {_word(item)}" for key, item in entry.items()]


def _word(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_word(item)}" for key, item in value.items()) or "none"
    if isinstance(value, list | tuple):
        return " to ".join(_word(item) for item in value)
    if isinstance(value, float):
        return f"{value:,.0f}" if abs(value) >= 1e5 else f"{value:.6g}"
    if value is None:
        return "not set"
    return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) else str(value)


def _of_log(log: Log, progress: Callable[[int], None]) -> dict[str, Any]:
    import numpy as np

    places, beams = [], []
    for scan in log:
        places.append(scan.map_from_sensor.translation)
        beams.append(scan.size)
        progress(len(beams))
    positions = np.array(places) if places else np.empty((0, 0))
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    facts: dict[str, Any] = {
        "log": log.path,
        "format": log.format,
        "scans": log.scan_count,
        "beams": int(sum(beams)),
        "beams/scan": sorted({min(beams), max(beams)}) if beams else [],
        "path [m]": float(np.nansum(steps)),
        "sensor": dict(log.sensor),
        "skipped": dict(log.skipped),
        "notes": list(log.notes),
    }
    for axis, name in enumerate("xyz"[: positions.shape[1]] if positions.ndim == 2 else ""):
        facts[f"{name} [m]"] = [
            float(np.nanmin(positions[:, axis])),
            float(np.nanmax(positions[:, axis])),
        ]
    return facts


def _of_map(path: Path) -> dict[str, Any]:
    from oddsmap.cli.auto import advised
    from oddsmap.cli.bounds_of_trust import facts_of_votes, trust_line
    from oddsmap.evidence.saved_totals import read_totals
    from oddsmap.kernels.units import ONE
    from oddsmap.posterior.saved_pairs import TotalsWithPairs

    totals = read_totals(path, TotalsWithPairs)
    like = totals.like
    votes = facts_of_votes(like, totals.pairs())
    facts: dict[str, Any] = {
        "map": str(path),
        "resolution": like.resolution,
        "votes": like.votes,
        "cells known": totals.cells,
        "hits": totals.hits / ONE,
        "passes": totals.passes / ONE,
        "config": like.config.to_dict(),
        "made from": like.provenance,
        **({} if votes is None else {"own votes predicted": votes}),
    }
    posterior, doubt = advised(like.provenance), trust_line(votes)
    if posterior is not None:
        facts["posterior"] = posterior
        facts["take"] = f"oddsmap export {quote(str(path))} OUT --posterior {posterior}"
    elif doubt is not None:
        facts["warning"] = doubt
    return facts | _extent(totals.bounds, like.resolution)


def _of_full_map(full_map: FullMap, path: Path) -> dict[str, Any]:
    facts: dict[str, Any] = {
        "map": str(path),
        "estimator": "full-map",
        "method": full_map.method,
        "resolution": full_map.resolution,
        "cells known": full_map.cell_count,
        "sweeps": full_map.sweeps,
        "residual": full_map.residual,
        "converged": full_map.converged,
        "config": full_map.config.to_dict(),
        "made from": full_map.provenance,
    }
    return facts | _extent(full_map.bounds(), full_map.resolution)


def _extent(bounds: tuple[IntArray, IntArray] | None, resolution: float) -> dict[str, list[float]]:
    if bounds is None:
        return {}
    return {
        f"{name} [m]": [float(end) * resolution for end in ends]
        for name, ends in zip("xyz", zip(*bounds, strict=True), strict=False)
    }


def _of_octomap(voxels: VoxelMap, path: Path) -> dict[str, Any]:
    import numpy as np

    from oddsmap.odds import State

    state, cells = voxels.leaf_state(), voxels.side**3
    facts: dict[str, Any] = {
        "map": str(path),
        "format": "OctoMap",
        "resolution": voxels.resolution,
        "leaves": voxels.leaf_count,
        "cells known": voxels.cell_count,
    }
    for kind in (State.FREE, State.UNDECIDED, State.OCCUPIED):
        facts[kind.name.lower()] = int(cells[state == kind].sum())
    sizes, counts = np.unique(voxels.side, return_counts=True)
    facts["leaf sizes"] = {
        f"{size * voxels.resolution:g} m": int(n) for size, n in zip(sizes, counts, strict=True)
    }
    return facts | _extent(voxels.bounds(), voxels.resolution)


def _of_ros_map(grid: RosGrid, path: Path) -> dict[str, Any]:
    import math

    import numpy as np

    from oddsmap.odds import State, Thresholds

    state = Thresholds().state(grid.probability, grid.observed)
    ny, nx = state.shape
    facts: dict[str, Any] = {
        "map": str(path),
        "format": "ROS map",
        "mode": grid.mode,
        "resolution": grid.resolution,
        "columns": nx,
        "rows": ny,
        "size [m]": {"x": nx * grid.resolution, "y": ny * grid.resolution},
        "origin [m]": {"x": grid.origin[0], "y": grid.origin[1]},
        "yaw [deg]": math.degrees(grid.yaw),
        "cells known": int(np.count_nonzero(grid.observed)),
    }
    for kind in State:
        count = int(np.count_nonzero(state == kind))
        facts[kind.name.lower()] = {"cells": count, "percent": round(100 * count / state.size, 2)}
    return facts | ({"notes": list(grid.notes)} if grid.notes else {})
