# SPDX-License-Identifier: Apache-2.0
"""How kernels are compiled: the one place that knows the compiler's options."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

__all__ = ["allocating", "inlined", "kernel"]

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile a module-level function.

    `cache` keeps the machine code on disk (a cached start takes about 0.2 s instead of 10), and
    `nogil` lets ordinary Python threads run kernels side by side. No `fastmath`: results are exact.

    A kernel has no memory of its own: whoever calls it holds the arrays, and gives it those that it
    needs to work in. So it need not count references (`_nrt`), which Numba does with atomic
    instructions, 5 ns each, for every array that a function inlined into it is given: 43 of the
    65 ns that the set-up of a ray of space took.
    """
    return cast(F, njit(nogil=True, cache=True, error_model="numpy", _nrt=False)(function))


def allocating(function: F) -> F:
    """Compile a function that makes arrays of its own, which are freed when none refers to them."""
    return cast(F, njit(nogil=True, cache=True, error_model="numpy", _nrt=True)(function))


def inlined(function: F) -> F:
    """Compile a small function into each of its callers."""
    return cast(F, njit(nogil=True, inline="always", error_model="numpy")(function))
