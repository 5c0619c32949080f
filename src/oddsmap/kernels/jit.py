# SPDX-License-Identifier: Apache-2.0
"""How kernels are compiled: the one place that knows the compiler's options.

`kernel` is the rule, `borrowing` the exception for the inner loops of mapping, and `inlined` is for
small functions inside either. Machine code is kept on disk and is valid for exactly the sources it
was made from.
"""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Callable
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any, TypeVar, cast

from numba import njit

__all__ = ["borrowing", "inlined", "kernel", "sources_digest"]

_PROCESS = secrets.token_hex(4)

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile a module-level function.

    `cache` keeps the machine code on disk (a cached start takes about 0.2 s instead of 10), and
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
    """Compile with a cache on disk that is valid for all sources of the kernels as they are.

    Numba's own stamp is a digest of the file of the compiled function alone, but a kernel calls
    and inlines functions of other files, and pip leaves the machine code of the old version behind
    when it installs a new one. So the index holds a digest of all sources. The names of the data
    files hold it, too, and a word of this process: Numba writes the index first, and whoever is
    killed in between, or compiles at the same time, must not make it name another's code.
    """
    # Always stated: where it is not, Numba takes the option of whichever caller compiles first.
    options = {"nogil": True, "error_model": "numpy", "_nrt": counts_references}
    try:
        dispatcher = njit(cache=True, **options)(function)
        if dispatcher is function:  # NUMBA_DISABLE_JIT: plain Python
            return function
        index, digest = dispatcher._cache._cache_file, sources_digest()
        base, _, _ = index._data_name_pattern.partition(".{number")
        index._data_name_pattern = f"{base}.{digest[:16]}-{_PROCESS}.{{number:d}}.nbc"
        index._source_stamp = (index._source_stamp, digest)
    except (AttributeError, RuntimeError):
        # No folder to write to, or a Numba that keeps its cache in another way: compile in each
        # process rather than fail, or trust what may be stale.
        return njit(**options)(function)
    return dispatcher


@cache
def sources_digest() -> str:
    """A digest of every source file of the kernels, by name and content."""
    digest = hashlib.sha256()
    for name, source in sorted(_sources(files(__package__), "")):
        content = source.read_bytes()
        digest.update(f"{name}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()


def _sources(folder: Traversable, prefix: str) -> list[tuple[str, Traversable]]:
    found = []
    for entry in folder.iterdir():
        if entry.is_dir() and entry.name != "__pycache__":
            found += _sources(entry, f"{prefix}{entry.name}/")
        elif entry.name.endswith(".py"):
            found.append((prefix + entry.name, entry))
    return found
