# SPDX-License-Identifier: Apache-2.0
"""Which cells does a cone meet, from near to far, and how much of each?

The geometry of the forward sensor model, for many 2D or 3D beams: each beam's
cells, sorted into range bins, in the rows of one table (offsets, then cells), so that a beam is
gone through in one sweep.

- The *range* of a cell is the distance from the sensor to its nearest point, plus a bias.
- The *fraction* is overlap / min(cell, cone), all three angles as seen from the sensor: what part
  of the cell lies inside the cone or, for a cone narrower than the cell, what part of the cone is
  taken up by the cell. A cone that lies wholly inside a cell's extent is stopped by the cell for
  certain, however little of the cell it meets.
- The cell that the sensor is in is left out: the sensor stands there, so it is free.

Everything is in cells (position / resolution). The two dimensions are in `cone2d.py`
(exact) and `cone3d.py` (cells taken as balls).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import kernel
from oddsmap.kernels.trace.cone2d import plane_cells
from oddsmap.kernels.trace.cone3d import space_cells

__all__ = ["LEAST_HALF_ANGLE", "list_cells"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

LEAST_HALF_ANGLE = 1e-6
"""A narrower cone is taken as this wide [rad]: a ray along a border is then halved between the two
cells, in place of belonging to either by rounding."""


@kernel
def list_cells(
    origins: FloatArray,
    axes: FloatArray,
    reaches: FloatArray,
    half_angle: float,
    bin_width: float,
    bias: float,
    lo: IntArray,
    shape: IntArray,
    first: int,
    offsets: IntArray,
    cells: npt.NDArray[np.signedinteger],
    bins: npt.NDArray[np.int32],
    fractions: npt.NDArray[np.floating],
) -> int:
    """List the cells of beams until the room is used up.

    Args:
        origins: sensor positions [cells], shape (n, d), d = 2 or 3.
        axes: unit vectors along the beams, shape (n, d).
        reaches: the range up to which cells are listed [cells], shape (n,); NaN or 0: none.
        half_angle: half the opening angle [rad], from LEAST_HALF_ANGLE to pi / 2.
        bin_width: width of a range bin [cells].
        bias: added to the distance of a cell's nearest point [cells].
        lo: first cell of the window, shape (d,), x first; cells outside of it are not listed.
        shape: cells of the window along each axis, shape (d,), x first.
        first: beam to begin with.
        offsets: where the cells of each beam begin, and the end, shape (n + 1 - first,); row 0 is
            beam `first`. Filled as far as beams were done.
        cells: places in the window, x fastest.
        bins: range bin of each cell, never falling along a beam.
        fractions: in (0, 1].

    Returns:
        The beam to go on with; n when done. If it is `first`, not even one beam has room.
    """
    room = cells.shape[0]
    # Never touched beyond the longest beam, so it costs address space, not memory.
    raw_cells = np.empty(room, np.int64)
    raw_bins = np.empty(room, np.int32)
    raw_fractions = np.empty(room, np.float64)
    max_bins = 0
    for i in range(first, reaches.shape[0]):
        if reaches[i] > 0.0:
            max_bins = max(max_bins, int(reaches[i] / bin_width) + 1)
    places = np.zeros(max_bins + 1, np.int64)
    in_3d = origins.shape[1] == 3
    offsets[0] = 0
    used = 0
    for i in range(first, reaches.shape[0]):
        reach = reaches[i]
        count = 0
        if reach > bias:
            limit = room - used
            if in_3d:
                count = space_cells(
                    origins[i], axes[i], half_angle, bin_width, bias, reach, lo, shape,
                    limit, raw_cells, raw_bins, raw_fractions,
                )  # fmt: skip
            else:
                count = plane_cells(
                    origins[i], axes[i], half_angle, bin_width, bias, reach, lo, shape,
                    limit, raw_cells, raw_bins, raw_fractions,
                )  # fmt: skip
            if count < 0:
                return i
        # Counting sort: first how many, then where each bin begins, then each cell to its place.
        last = 0
        for k in range(count):
            b = raw_bins[k]
            places[b] += 1
            last = max(last, b)
        at = used
        for b in range(last + 1):
            width = places[b]
            places[b] = at
            at += width
        for k in range(count):
            b = raw_bins[k]
            to = places[b]
            places[b] = to + 1
            cells[to] = raw_cells[k]
            bins[to] = b
            fractions[to] = raw_fractions[k]
        places[: last + 1] = 0
        used += count
        offsets[i + 1 - first] = used
    return reaches.shape[0]
