# SPDX-License-Identifier: Apache-2.0
"""How kernels are compiled: the one place that knows the compiler's options.

`kernel` is the rule, `borrowing` the exception for the inner loops of mapping, and `inlined` is for
small functions inside either. Machine code is kept on disk: see `oddsmap.kernels.stored_code`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

from oddsmap.kernels.stored_code import StoredCode

__all__ = ["borrowing", "inlined", "kernel"]

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile a module-level function.

    `nogil` lets ordinary Python threads run kernels side by side. No `fastmath`: results are exact.
    """
    return cast(F, _compiled(function, counts_references=True))


def borrowing(function: F) -> F:
    """Compile a function that only borrows arrays: its caller holds them, it makes none.

    So it need not count references (Numba's `_nrt`), which costs an atomic instruction, about 5 ns,
    for every array that is handed to a function inlined into it, and keeps loops from being
    vectorised. What that brings on one thread, `_nrt` off against on: 2D at 0.05 m, 6.0 M beams/s
    against 4.7 (`benchmarks/lidar2d.py --quick`, office); 3D, 25 ms per scan against 348 at 0.1 m
    and 87 against 972 at 0.05 m (`benchmarks/lidar3d.py --quick --part speed`). Message passing and
    the cells of cones gain nothing, so they are `kernel`s.

    The danger: an array that such a function gets from a function that *makes* it is never freed.
    The compiler does not refuse that; tests/kernels/test_jit.py does.
    """
    return cast(F, _compiled(function, counts_references=False))


def inlined(function: F) -> F:
    """Compile a small function into each of its callers."""
    return cast(F, njit(nogil=True, inline="always", error_model="numpy")(function))


def _compiled(function: Callable[..., Any], *, counts_references: bool) -> object:
    # Always stated: where it is not, Numba takes the option of whichever caller compiles first.
    options = {"nogil": True, "error_model": "numpy", "_nrt": counts_references}
    dispatcher = njit(**options)(function)
    if dispatcher is not function:  # NUMBA_DISABLE_JIT: plain Python
        dispatcher._cache = StoredCode(function)
    return dispatcher
