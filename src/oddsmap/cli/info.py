# SPDX-License-Identifier: Apache-2.0
"""`oddsmap info`: what is in a log or in a map."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from oddsmap.cli.log_options import LogOptions
from oddsmap.cli.options import Columns, PointsIn, Poses, SkipBad, json_option

if TYPE_CHECKING:
    from oddsmap.evidence_map import EvidenceMap
    from oddsmap.full_map.full_map import FullMap
    from oddsmap.maps.voxel_map import VoxelMap
    from oddsmap.scans.log import Log

__all__ = ["HELP", "info"]

HELP = """Say what is in a log or in a map.

\b
  oddsmap info intel.log.gz
  oddsmap info intel.zarr --json
  oddsmap info hall.bt
"""


def info(
    path: Annotated[
        Path, typer.Argument(metavar="PATH", help="A log, a saved map, or an OctoMap.")
    ],
    poses: Poses = None,
    points_in: PointsIn = None,
    columns: Columns = None,
    skip_bad: SkipBad = False,
    as_json: Annotated[bool, json_option("the facts")] = False,
) -> None:
    """Say what is in a log or in a map: see `HELP`."""
    from oddsmap.evidence.store import is_map
    from oddsmap.full_map.full_map import load_full_map
    from oddsmap.full_map.store import is_full_map
    from oddsmap.map_files.octomap_reader import is_octomap
    from oddsmap.maps.voxel_map import load_octomap

    if is_map(path):
        from oddsmap.evidence_map import load_map

        facts = _of_map(load_map(path), path)
    elif is_full_map(path):
        facts = _of_full_map(load_full_map(path), path)
    elif is_octomap(path):
        facts = _of_octomap(load_octomap(path), path)
    else:
        options = LogOptions(poses=poses, points_in=points_in, columns=columns, skip_bad=skip_bad)
        facts = _of_log(options.open(path))
    if as_json:
        typer.echo(json.dumps(facts))
        return
    for name, value in facts.items():
        for i, line in enumerate(_lines(value)):
            typer.echo(f"{name if i == 0 else '':<12} {line}")


def _lines(value: Any) -> list[str]:
    if isinstance(value, dict):
        return [f"{key} {_word(item)}" for key, item in value.items()] or ["none"]
    if isinstance(value, list) and value and isinstance(value[0], str | dict):
        return [line for item in value for line in (_lines(item) if item else [])]
    return [_word(value)]


def _word(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {_word(item)}" for key, item in value.items()) or "none"
    if isinstance(value, list):
        return " to ".join(_word(item) for item in value)
    if isinstance(value, float):
        return f"{value:.6g}"
    if value is None:
        return "not set"
    return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) else str(value)


def _of_log(log: Log) -> dict[str, Any]:
    import numpy as np

    positions = np.array([scan.map_from_sensor.translation for scan in log])
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    beams = [scan.size for scan in log]
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


def _of_map(evidence: EvidenceMap, path: Path) -> dict[str, Any]:
    from oddsmap.kernels.units import ONE

    census = evidence.census()
    facts: dict[str, Any] = {
        "map": str(path),
        "resolution": evidence.resolution,
        "votes": evidence.votes,
        "cells known": census.cells,
        "hits": census.hits / ONE,
        "passes": census.passes / ONE,
        "config": evidence.config.to_dict(),
        "made from": evidence.provenance,
    }
    return facts | _extent(evidence)


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
    return facts | _extent(full_map)


def _extent(grid: EvidenceMap | FullMap) -> dict[str, list[float]]:
    bounds = grid.bounds()
    if bounds is None:
        return {}
    return {
        f"{name} [m]": [float(end[axis]) * grid.resolution for end in bounds]
        for axis, name in enumerate("xyz"[: grid.ndim])
    }


def _of_octomap(voxels: VoxelMap, path: Path) -> dict[str, Any]:
    import numpy as np

    from oddsmap.odds import State

    state, cells = voxels.state(), voxels.side**3
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
    bounds = voxels.bounds()
    if bounds is not None:
        for axis, name in enumerate("xyz"):
            facts[f"{name} [m]"] = [float(end[axis]) * voxels.resolution for end in bounds]
    return facts
