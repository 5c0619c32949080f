# SPDX-License-Identifier: Apache-2.0
"""A learnt prior over 2D maps: which 3 x 3 windows of cells occur, and how often.

p(m) is proportional to exp(STRENGTH * sum of the potentials of all windows), those that reach over
the edge as well: what lies beyond is free. An Ising prior knows that neighbours are alike; this one
also knows that walls go on, end square and are no single cells.

The table is printed by `python benchmarks/window_prior.py`, which says what it is learnt from.

Source: Besag, Statistical analysis of non-lattice data (1975), for the pseudo-likelihood that it
maximises; Geman and Geman, Stochastic relaxation (1984), for priors on windows and their sampling.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.forward.cell_grid import CellField
from oddsmap.kernels.infer.beam_factor import BeamRows

__all__ = [
    "STRENGTH",
    "TABLE",
    "Windows",
    "kinds_of_windows",
    "lines_of",
    "potentials",
    "windows_of",
]

STRENGTH = 0.65
"""Share of the learnt potentials that is used."""

_WINDOWS = 512

# A window of each kind, row by row, and its potential: more is more often.
TABLE = """
... ... ...   1.15
#.. ... ...   0.80
.#. ... ...  -0.54
##. ... ...   0.42
#.# ... ...  -0.35
### ... ...   0.82
.#. #.. ...  -0.04
##. #.. ...   0.76
..# #.. ...  -0.30
#.# #.. ...  -0.32
.## #.. ...  -0.19
### #.. ...   0.54
... .#. ...  -0.35
#.. .#. ...  -0.45
.#. .#. ...  -0.31
##. .#. ...  -0.12
#.# .#. ...  -0.09
### .#. ...   1.08
.#. ##. ...  -0.16
##. ##. ...   0.45
..# ##. ...  -0.23
#.# ##. ...  -0.36
.## ##. ...  -0.14
### ##. ...   0.81
... #.# ...  -0.09
#.. #.# ...  -0.30
.#. #.# ...  -0.05
##. #.# ...  -0.41
#.# #.# ...   0.17
### #.# ...  -0.17
... ### ...   1.04
#.. ### ...  -0.27
.#. ### ...  -0.41
##. ### ...  -0.87
#.# ### ...  -0.51
### ### ...   0.78
..# ... #..   0.28
#.# ... #..  -0.17
.## ... #..  -0.26
### ... #..  -0.26
.## #.. #..  -0.42
### #.. #..  -0.28
..# .#. #..   0.21
#.# .#. #..  -0.00
.## .#. #..   0.06
### .#. #..  -0.30
.## ##. #..  -0.37
### ##. #..   0.20
#.. ..# #..  -0.07
.#. ..# #..  -0.04
##. ..# #..   0.06
#.# ..# #..  -0.06
.## ..# #..   0.32
### ..# #..   0.07
#.. #.# #..  -0.36
.#. #.# #..  -0.03
##. #.# #..  -0.27
..# #.# #..   0.05
#.# #.# #..   0.02
.## #.# #..   0.17
### #.# #..  -0.09
#.. .## #..  -0.11
.#. .## #..   0.15
##. .## #..  -0.07
#.# .## #..  -0.02
.## .## #..  -0.42
### .## #..  -0.04
#.. ### #..   0.05
.#. ### #..   0.02
##. ### #..  -0.19
..# ### #..   0.19
#.# ### #..  -0.72
.## ### #..  -0.38
### ### #..   0.05
.#. #.# .#.  -0.00
##. #.# .#.  -0.02
#.# #.# .#.  -0.01
### #.# .#.  -0.11
.#. ### .#.   0.34
##. ### .#.  -0.49
#.# ### .#.  -0.06
### ### .#.   0.41
#.# ..# ##.  -0.03
### ..# ##.  -0.16
.## #.# ##.   0.21
### #.# ##.  -0.32
#.# .## ##.  -0.00
### .## ##.  -0.07
.## ### ##.   0.09
### ### ##.   0.68
#.# ... #.#   0.00
### ... #.#  -0.11
### #.. #.#  -0.17
#.# .#. #.#   0.00
### .#. #.#  -0.02
### ##. #.#   0.04
#.# #.# #.#   0.35
### #.# #.#  -0.09
#.# ### #.#   0.13
### ### #.#  -0.49
### #.# ###  -0.12
### ### ###   1.30
"""


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """The window prior of a map's cells, and which of them it is about; all others are free.

    Args:
        cells: numbers of the cells that may be occupied, shape (n,).
        around: numbers of the 3 x 3 cells around each of these, row by row, itself in the middle,
            shape (n, 9).
        potentials: of each window, see `potentials`, shape (512,).
    """

    cells: npt.NDArray[np.int32]
    around: npt.NDArray[np.int32]
    potentials: FloatArray

    @property
    def nbytes(self) -> int:
        """Bytes of memory in use."""
        return self.cells.nbytes + self.around.nbytes

    def codes(self, state: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint16]:
        """Number of the window around each cell of a map, shape as `state`, (cells,)."""
        codes = np.zeros(len(state), np.uint16)
        occupied = state[self.cells] == 1
        for place in range(9):
            # A cell at place k of the windows lies at place 8 - k of the window around that.
            np.bitwise_or.at(codes, self.around[occupied, place], np.uint16(1 << (8 - place)))
        return codes

    def steps(self) -> FloatArray:
        """What a window's log factor gains by the cell in place 8 - k, shape (9, 512)."""
        code = np.arange(_WINDOWS)
        with_cell = code | (1 << np.arange(8, -1, -1))[:, None]
        without = code & ~(1 << np.arange(8, -1, -1))[:, None]
        return np.ascontiguousarray(self.potentials[with_cell] - self.potentials[without])

    def log_prior(self, state: npt.NDArray[np.uint8]) -> float:
        """Log p(m) of a map, up to a constant; the map without anything has 0."""
        return float(np.sum(self.potentials[self.codes(state)] - self.potentials[0]))


def potentials() -> FloatArray:
    """Log factor of each window, STRENGTH times what the table says, shape (512,).

    Bit 3 y + x of a window's number is its cell in column x and row y.
    """
    values = [float(line.rsplit(maxsplit=1)[1]) for line in TABLE.strip().splitlines()]
    return STRENGTH * np.array(values)[kinds_of_windows()]


def windows_of(field: CellField, rows: BeamRows) -> tuple[Windows, npt.NDArray[np.int32]]:
    """The window prior of the cells that beams are about; cells that no beam lists are free.

    Args:
        field: the cells, 2D.
        rows: the beams.

    Returns:
        The prior; and the neighbours of the field's cells, and of a rim of blocks around them, as
        `CellField.neighbours` has them: windows reach over the edge.
    """
    wide = CellField(2, 0)
    wide.insert(field.coords)  # first: its cells keep their numbers
    ways = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2)
    wide.insert(np.unique((field.coords[:, None] + ways).reshape(-1, 2), axis=0))
    beside = wide.neighbours()
    cells = np.flatnonzero(np.bincount(rows.cells, minlength=len(beside)))
    around = np.empty((len(cells), 9), np.int32)
    around[:, 1], around[:, 4], around[:, 7] = beside[cells, 2], cells, beside[cells, 3]
    for middle in (1, 4, 7):
        row = around[:, middle]
        around[:, middle - 1], around[:, middle + 1] = beside[row, 0], beside[row, 1]
    return Windows(cells.astype(np.int32), around, potentials()), beside


def kinds_of_windows() -> npt.NDArray[np.int64]:
    """Kind of each window, 0 to 101: those that turns and mirrors make of each other share one.

    Bit 3 y + x of a window's number is its cell in column x and row y; kinds are in the order of
    the smallest number of each. Shape (512,).
    """
    cells = (np.arange(_WINDOWS)[:, None] >> np.arange(9)) & 1
    least = np.full(_WINDOWS, _WINDOWS)
    for mirrored in (cells.reshape(-1, 3, 3), cells.reshape(-1, 3, 3)[:, :, ::-1]):
        for turn in range(4):
            turned = np.rot90(mirrored, turn, (1, 2)).reshape(-1, 9)
            least = np.minimum(least, turned @ (1 << np.arange(9)))
    return np.unique(least, return_inverse=True)[1].astype(np.int64)


def lines_of(potentials: FloatArray) -> list[str]:
    """The table as it is written here: a window of each kind, row by row, and its potential."""
    _, first = np.unique(kinds_of_windows(), return_index=True)
    lines = []
    for window, potential in zip(first.tolist(), potentials.tolist(), strict=True):
        cells = "".join(".#"[window >> bit & 1] for bit in range(9))
        lines.append(f"{cells[:3]} {cells[3:6]} {cells[6:]} {potential:6.2f}")
    return lines
