# SPDX-License-Identifier: Apache-2.0
"""The voxels without hits of a 3D map, as the page takes them: runs along x, in slabs of heights.

A slab is unpacked when it is asked for, for a slice or for free space as a whole. Its arrays are
named `air.K.rows`, `air.K.gaps`, `air.K.lengths` and `air.K.passes`, K the number of the slab:

    rows        steps from the row of the run before; the first one's from row 0. Rows are numbered
                along y, and those of the next height go on where the ones before end.
    gaps        voxels between the run before and this one, modulo 65536; where the row is another
                one, x of this run less where the run before ended
    lengths     voxels of the run, less 1
    passes      of each voxel
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import IntArray
from oddsmap.viewer.facts import Packing
from oddsmap.viewer.payload import BytePlanes

__all__ = ["Air"]

# Of one height each where the map is not higher: a slice unpacks one.
_MOST_SLABS = 256
# The page unpacks a slab at a time, but holds the packed ones: about a byte for each voxel.
_MOST_VOXELS = 1 << 26


class Air:
    """The voxels without hits, which are added in the order of their index, x changing fastest.

    Args:
        lo: the first cell of the map.
        hi: one past the last.
        packing: of counts.
    """

    def __init__(self, lo: IntArray, hi: IntArray, packing: Packing) -> None:
        self._lo, self._packing = lo, packing
        self._rows_of_a_height = int(hi[1] - lo[1])
        self._heights = -(-int(hi[2] - lo[2]) // _MOST_SLABS)
        self._slabs: dict[int, _Slab] = {}
        self._voxels = 0

    def append(self, index: IntArray, passes: IntArray) -> None:
        """Add voxels, in whole rows.

        Args:
            index: shape (n, 3).
            passes: shape (n,) [units].
        """
        self._voxels += len(index)
        if self._voxels > _MOST_VOXELS:
            self._slabs.clear()
        if self._voxels > _MOST_VOXELS or len(index) == 0:
            return
        x, y, z = (index - self._lo).T
        slab, height = np.divmod(z, self._heights)
        rows = height * self._rows_of_a_height + y
        counts = self._packing.counts(passes)
        cuts = [0, *(np.flatnonzero(np.diff(slab)) + 1).tolist(), len(slab)]
        for begin, end in pairwise(cuts):
            number = int(slab[begin])
            if number not in self._slabs:
                self._slabs[number] = _Slab(number, self._packing)
            self._slabs[number].append(x[begin:end], rows[begin:end], counts[begin:end])

    def facts(self) -> dict[str, Any] | None:
        """Heights of a slab and the numbers of those there are; None: there are too many voxels."""
        if self._voxels > _MOST_VOXELS:
            return None
        return {"heights": self._heights, "slabs": list(self._slabs)}

    def arrays(self) -> list[BytePlanes]:
        """The arrays of all slabs."""
        return [array for slab in self._slabs.values() for array in slab.arrays]


class _Slab:
    def __init__(self, number: int, packing: Packing) -> None:
        kinds: dict[str, npt.DTypeLike] = {
            "rows": np.uint32, "gaps": np.uint16, "lengths": np.uint16, "passes": packing.dtype,
        }  # fmt: skip
        self.arrays = [BytePlanes(f"air.{number}.{name}", kind) for name, kind in kinds.items()]
        self._row = self._end = 0

    def append(self, x: IntArray, rows: IntArray, counts: IntArray) -> None:
        starts = (np.diff(x) != 1) | (np.diff(rows) != 0)
        begin = np.concatenate([[0], np.flatnonzero(starts) + 1])
        lengths = np.diff(begin, append=len(x))
        ends = x[begin] + lengths
        steps = np.diff(rows[begin], prepend=self._row)
        gaps = (x[begin] - np.concatenate([[self._end], ends[:-1]])) % (1 << 16)
        self._row, self._end = int(rows[-1]), int(ends[-1])
        for array, values in zip(self.arrays, (steps, gaps, lengths - 1, counts), strict=True):
            array.append(values)
