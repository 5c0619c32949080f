# SPDX-License-Identifier: Apache-2.0
"""How kernels are compiled: the one place that knows the compiler's options."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

__all__ = ["inlined", "kernel"]

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile a module-level function.

    `cache` keeps the machine code on disk (a cached start takes about 0.2 s instead of 10), and
    `nogil` lets ordinary Python threads run kernels side by side. No `fastmath`: results are exact.
    """
    return cast(F, njit(nogil=True, cache=True, error_model="numpy")(function))


def inlined(function: F) -> F:
    """Compile a small function into each of its callers.

    A call of a compiled function counts references of every array it is given, with atomic
    instructions; in a loop over beams that is most of the time (100 of 175 ns a beam).
    """
    return cast(F, njit(nogil=True, inline="always", error_model="numpy")(function))
