# SPDX-License-Identifier: Apache-2.0
"""Names for the arrays that functions take and give."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

__all__ = ["BoolArray", "FloatArray", "IntArray", "Region"]

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]

Region: TypeAlias = tuple[npt.ArrayLike, npt.ArrayLike]
"""A box of cells: (lo, hi), each of shape (d,), x first, hi past the last cell."""
