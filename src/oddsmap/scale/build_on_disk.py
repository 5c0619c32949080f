# SPDX-License-Identifier: Apache-2.0
"""A log to a saved map, of any size, within a budget of memory."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar, Unpack

from oddsmap.evidence.evidence import Evidence
from oddsmap.integrate.whole_log import MapOptions, WorkOptions, add_whole_log, begin_map
from oddsmap.limits import bytes_of, default_budget
from oddsmap.map_files.zarr_folder import check_map_output
from oddsmap.scale.budgeted_map import BudgetedMap
from oddsmap.scale.saved_map import SavedMap
from oddsmap.scans.log import Log
from oddsmap.scans.measurement import Measurement

__all__ = ["SavedMapOptions", "build_on_disk"]

E = TypeVar("E", bound=Evidence)


class SavedMapOptions(MapOptions, WorkOptions, total=False):
    """What may be said of a map that is built on the disk: as of `oddsmap.build_map`."""


def build_on_disk(
    kind: type[E],
    log: Log | Measurement | Iterable[Measurement],
    resolution: float,
    path: str | os.PathLike[str],
    *,
    memory: int | str | None,
    force: bool,
    **options: Unpack[SavedMapOptions],
) -> SavedMap[E]:
    """Map a log to a folder: see `oddsmap.build_saved_map`.

    Args:
        kind: what regions of it are.
        log: as in `build_saved_map`, as are the others, and what is raised.
        resolution: side of a cell [m].
        path: the folder.
        memory: bytes of tiles in memory.
        force: True where an existing map may be replaced.
        options: of the map and of the work.
    """
    budget = default_budget() if memory is None else bytes_of(memory)
    check_map_output(Path(path), force=force)
    own, work = dict[str, Any](), dict[str, Any]()
    for name, value in options.items():
        (work if name in WorkOptions.__annotations__ else own)[name] = value
    evidence, parts = begin_map(kind, log, resolution, **own)
    with BudgetedMap(evidence, Path(path), budget) as building:
        report = add_whole_log(evidence, parts, **work)
        building.save(force=force)
    saved = SavedMap(path, kind)
    saved.report = report
    return saved
