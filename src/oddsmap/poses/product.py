# SPDX-License-Identifier: Apache-2.0
"""Products of small matrices that are the same on every CPU.

`a @ b` is BLAS, which fuses multiplications with additions where the CPU can, and sums in an order
of its own: the last bit differs from machine to machine, and with it the cell of a point on a
border. Here each sum goes from left to right, rounded at each step, as plain Python does it.
"""

from __future__ import annotations

import numpy as np

from oddsmap.array_types import FloatArray

__all__ = ["inverse", "product"]


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """The matrix product of a, shape (n, k), and b, shape (k, m), k at least 1: shape (n, m)."""
    # What is not finite stays so, and is counted where it is used.
    with np.errstate(invalid="ignore", over="ignore"):
        total = a[:, :1] * b[:1]
        for k in range(1, len(b)):
            total = total + a[:, k : k + 1] * b[k : k + 1]
    return total


def inverse(a: FloatArray) -> FloatArray | None:
    """The inverse of a matrix of shape (3, 3), by cofactors; None where it has none."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = a.tolist()
    x, y, z = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    determinant = ax * x + ay * y + az * z
    if determinant == 0.0:
        return None
    adjugate = [
        [x, az * cy - ay * cz, ay * bz - az * by],
        [y, ax * cz - az * cx, az * bx - ax * bz],
        [z, ay * cx - ax * cy, ax * by - ay * bx],
    ]
    found: FloatArray = np.array(adjugate) / determinant
    return found
