# SPDX-License-Identifier: Apache-2.0
"""Kernels are compiled, or loaded from the cache, before the clock of a job starts."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable

__all__ = ["warm_up"]

_done: set[tuple[Callable[..., None], tuple[Hashable, ...]]] = set()


def warm_up(toy: Callable[..., None], *variant: Hashable) -> float:
    """Run a toy job that goes through the kernels of a real one, once per process.

    Args:
        toy: runs the job, given the variant.
        variant: what decides which kernels are needed.

    Returns:
        How long that took [s].
    """
    started = time.perf_counter()
    if (toy, variant) not in _done:
        toy(*variant)
        _done.add((toy, variant))
    return time.perf_counter() - started
