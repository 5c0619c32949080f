# SPDX-License-Identifier: Apache-2.0
"""Exact squared Euclidean distances between cells, one axis after the other, in whole numbers.

The distance along the first axis is a count of cells. Along each further axis a cell's squared
distance is the least of (q - u)^2 + f(u) over the cells u of its line, f being what the axes before
gave: the lower envelope of parabolas. For each cell one place is worked out where its parabola
comes under another one, as a whole number: no distance is rounded.

Lines are read over one box of cells and answered over another.

Source: Meijster, Roerdink, Hesselink: A general algorithm for computing distance transforms in
linear time (2000); Felzenszwalb, Huttenlocher: Distance transforms of sampled functions (2012).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.kernels.jit import borrowing, inlined

__all__ = ["FAR", "STRIP", "count_cells", "mark_cells", "squared_distances"]

FAR = 1 << 30
"""Cells to a marked one where there is none; boxes are closer together than that."""

STRIP = 16
"""Columns turned into rows at a time: a line of the cache holds 16 numbers."""

EXACT_QUOTIENT = 1 << 52
"""Below this the quotient of two whole numbers as doubles rounds down as they do."""

Mask = npt.NDArray[np.uint8]
Whole = npt.NDArray[Any]


@borrowing
def count_cells(mask: Mask, first: int, run: Whole, out: Whole) -> None:
    """Cells to the nearest marked one along the first axis, `FAR` where there is none.

    Args:
        mask: not 0 where marked, shape (n, ny, nx).
        first: where `out` begins along that axis, cell 0 being the first of `mask`.
        run: room for a row, shape (nx,).
        out: filled, shape (m, ny, nx).
    """
    n, past = mask.shape[0], first + out.shape[0]
    for y in range(mask.shape[1]):
        for x in range(run.shape[0]):
            run[x] = FAR
        for z in range(first, min(0, past)):
            out[z - first, y, :] = FAR
        for z in range(min(n, past)):
            marked = mask[z, y]
            for x in range(run.shape[0]):
                run[x] = 0 if marked[x] != 0 else run[x] + 1
            if z >= first:
                row = out[z - first, y]
                for x in range(run.shape[0]):
                    row[x] = run[x]
        for z in range(max(n, first), past):
            row = out[z - first, y]
            for x in range(run.shape[0]):
                row[x] = min(run[x] + (z - n + 1), FAR)
        for x in range(run.shape[0]):
            run[x] = FAR
        for z in range(n - 1, max(first, 0) - 1, -1):
            marked = mask[z, y]
            for x in range(run.shape[0]):
                run[x] = 0 if marked[x] != 0 else run[x] + 1
            if z < past:
                row = out[z - first, y]
                for x in range(run.shape[0]):
                    row[x] = min(row[x], run[x], FAR)
        for z in range(first, min(0, past)):
            row = out[z - first, y]
            for x in range(run.shape[0]):
                row[x] = min(run[x] - z, FAR)


@inlined
def _meets(above: int, twice: int) -> int:
    # floor(above / twice) of whole numbers, twice > 0.
    if (above >= 0) & (above < EXACT_QUOTIENT):
        return np.int64(np.float64(above) / np.float64(twice))
    return above // twice


@borrowing
def _line(f: Whole, first: int, reach: int, none: int, at: Whole, begin: Whole, out: Whole) -> None:
    """Squared distances of a line.

    Args:
        f: squared distances by the axes before, shape (n,); above `reach` they are none.
        first: where `out` begins, cell 0 being the first of `f`.
        reach: the largest squared distance asked for.
        none: what is written where there is none.
        at: room for cells, shape (n,).
        begin: room for where each of them begins to be the nearest, shape (n + 1,).
        out: filled, shape (m,).
    """
    past = first + out.shape[0]
    top = -1
    s, t, g = np.int64(0), np.int64(0), np.int64(0)  # of the topmost parabola
    for u in range(f.shape[0]):
        h = np.int64(f[u])
        if h > reach:
            continue
        while top >= 0:
            if (t - s) * (t - s) + g <= (t - u) * (t - u) + h:
                break
            top -= 1
            if top >= 0:
                s, t = np.int64(at[top]), np.int64(begin[top])
                g = np.int64(f[s])
        if top >= 0:
            t = 1 + _meets((u - s) * (u + s) + h - g, 2 * (u - s))
            if t >= past:
                t = np.int64(begin[top])
                continue
        else:
            t = np.int64(first)
        s, g = np.int64(u), h
        top += 1
        at[top], begin[top] = s, t
    if top < 0:
        for q in range(out.shape[0]):
            out[q] = none
        return
    begin[top + 1] = past
    for k in range(top + 1):
        s = np.int64(at[k])
        g = np.int64(f[s])
        for q in range(np.int64(begin[k]), np.int64(begin[k + 1])):
            d = (q - s) * (q - s) + g
            out[q - first] = d if d <= reach else none


@borrowing
def squared_distances(
    counts: Whole,
    first_y: int,
    first_x: int,
    reach: int,
    none: int,
    at: Whole,
    begin: Whole,
    columns: Whole,
    turned: Whole,
    middle: Whole,
    out: Whole,
) -> None:
    """Squared distances of layers of cells.

    Args:
        counts: cells along the axis of layers, as `count_cells` gives them, shape (n, ny, nx).
        first_y: where `out` begins along the second axis, cell 0 being the first of `counts`.
        first_x: likewise, along the third.
        reach: the largest squared distance asked for.
        none: what is written beyond it.
        at: room, shape (max(ny, nx),).
        begin: room, shape (max(ny, nx) + 1,).
        columns: room, shape (STRIP, ny).
        turned: room, shape (STRIP, my).
        middle: room, shape (my, nx).
        out: filled, shape (n, my, mx).
    """
    n, ny, nx = counts.shape
    my = out.shape[1]
    for z in range(n):
        layer = counts[z]
        if ny == 1 and my == 1 and first_y == 0:
            # A 2D map.
            for x in range(nx):
                c = np.int64(layer[0, x])
                middle[0, x] = min(c * c, reach + 1)
        else:
            for left in range(0, nx, STRIP):
                width = min(STRIP, nx - left)
                for y in range(ny):
                    for x in range(width):
                        c = np.int64(layer[y, left + x])
                        columns[x, y] = min(c * c, reach + 1)
                for x in range(width):
                    _line(columns[x], first_y, reach, reach + 1, at, begin, turned[x])
                for y in range(my):
                    for x in range(width):
                        middle[y, left + x] = turned[x, y]
        for y in range(my):
            _line(middle[y], first_x, reach, none, at, begin, out[z, y])


@borrowing
def mark_cells(
    index: npt.NDArray[np.int64],
    marks: Mask,
    lo: npt.NDArray[np.int64],
    hi: npt.NDArray[np.int64],
    mask: Mask,
) -> None:
    """Write the marks of those cells that lie in a box.

    Args:
        index: cells, shape (n, d), x first.
        marks: theirs, shape (n,).
        lo: first cell of the box, shape (d,).
        hi: past its last.
        mask: the marks of its cells, x fastest, shape (all of them,).
    """
    d = index.shape[1]
    for i in range(index.shape[0]):
        place, inside = 0, True
        for a in range(d - 1, -1, -1):
            c = index[i, a]
            inside &= (c >= lo[a]) & (c < hi[a])
            place = place * (hi[a] - lo[a]) + (c - lo[a])
        if inside:
            mask[place] = marks[i]
