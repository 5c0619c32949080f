# SPDX-License-Identifier: Apache-2.0
"""The beams' cells in memory, 14 bytes each with their message: what every sweep goes through."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
import numpy.typing as npt

from oddsmap.errors import MapTooLargeError
from oddsmap.forward.beams import Beams
from oddsmap.forward.cell_grid import CellField, windows_of
from oddsmap.forward.model import ForwardModel
from oddsmap.kernels.infer.beam_factor import BeamRows
from oddsmap.limits import memory_limit

__all__ = ["list_rows", "note_observed"]

_Number = TypeVar("_Number", bound=np.generic)

# Cell number, bin, fraction, message, and room for a new message.
_BYTES = 4 + 2 + 4 + 4 + 4

# A cell counts as seen by a beam if at least half of it (or of a narrower beam) is inside, up to
# two sigma behind the reading: farther back the beam says nothing about it.
_LEAST_FRACTION = 0.5
_SIGMAS_BEHIND = 2.0
_LEAST_CHANCE = 0.1


def list_rows(field: CellField, beams: Beams, model: ForwardModel, resolution: float) -> BeamRows:
    """List the cells of beams and number them.

    Args:
        field: takes the cells' blocks.
        beams: those that carry information; their readings are finite or +Inf, and their poses
            less than 2^45 cells from the map's origin (see `usable_beams`).
        model: what the sensor is.
        resolution: side of a cell [m].

    Raises:
        MapTooLargeError: memory would not hold them, or a beam is too long.
    """
    if len(beams) == 0:
        return BeamRows(
            np.empty(0), np.zeros(1, np.int64), np.empty(0, np.int32), np.empty(0, np.uint16),
            np.empty(0, np.float32),
        )  # fmt: skip
    if model.bin_count(resolution) > np.iinfo(np.uint16).max:
        raise MapTooLargeError(
            f"a beam of {model.range_max:g} m has {model.bin_count(resolution):,} range bins: use "
            "a coarser resolution, or a lower range_max"
        )
    offsets = [np.zeros(1, np.int64)]
    cells: list[npt.NDArray[np.int32]] = []
    bins: list[npt.NDArray[np.uint16]] = []
    fractions: list[npt.NDArray[np.float32]] = []
    total = 0
    far = float(np.max(model.reach(beams.ranges))) / resolution + 2.0
    for run, window in windows_of(field, beams.origins / resolution, far):
        shape = tuple(int(n) for n in window.shape[::-1])
        some = Beams(beams.origins[run], beams.directions[run], beams.ranges[run])
        for part, listed in model.cells(some, resolution=resolution, lo=window.lo, shape=shape):
            offsets.append(listed.offsets[1:] + total)
            total += int(listed.offsets[-1])
            done = run.start + part.stop
            _check_memory(total / done * len(beams), len(beams), field.nbytes)
            cells.append(window.number(listed.cells))
            bins.append(listed.bins.astype(np.uint16))
            fractions.append(listed.fractions.copy())
    return BeamRows(
        beams.ranges, np.concatenate(offsets), _joined(cells), _joined(bins), _joined(fractions)
    )


def _joined(parts: list[npt.NDArray[_Number]]) -> npt.NDArray[_Number]:
    # One list at a time, and forgotten at once: twice the memory for one array, not for all.
    joined = np.concatenate(parts)
    parts.clear()
    return joined


def note_observed(
    field: CellField,
    rows: BeamRows,
    model: ForwardModel,
    resolution: float,
    detection: npt.NDArray[np.float64],
) -> None:
    """Note the cells that beams have reached, given what is believed now to stand before them.

    A reading from behind a wall, random or leaked, lists cells that nobody has seen. Unknown is
    what no beam reached, never where p is about the prior's.
    """
    from oddsmap.kernels.infer.beam_factor import mark_reached

    far = np.minimum(rows.readings, model.range_max) + _SIGMAS_BEHIND * model.sigma
    last = (far / model.bin_width_at(resolution)).astype(np.int64)
    mark_reached(
        rows, last, _LEAST_FRACTION, _LEAST_CHANCE, detection, field.belief, field.observed
    )


def _check_memory(rows: float, beams: int, cells: int) -> None:
    needed, limit = rows * _BYTES + cells, memory_limit()
    if needed > limit:
        raise MapTooLargeError(
            f"full-map estimation of {beams} beams, {rows / max(beams, 1):.0f} cells each, would "
            f"take {needed / 1e9:.3g} GB of memory (there are {limit / 1e9:.3g} GB): use a coarser "
            "resolution, a lower range_max, or map a part of the log"
        )
