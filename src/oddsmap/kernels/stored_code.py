# SPDX-License-Identifier: Apache-2.0
"""Machine code of kernels on disk: what a wheel brings along, and what was compiled here.

A file holds one kernel for one choice of types, and its name says all that the code depends on:
where anything differs, another file is looked for. So no version of oddsmap, Numba or Python, and
no other processor, finds code that is not for it, and nothing has to be kept up to date.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import sys
import uuid
from collections.abc import Callable
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import numba

__all__ = ["NATIVE", "SHIPPED", "SHIPPED_CPU", "StoredCode", "sources_digest"]

SHIPPED = "compiled"
"""The folder beside this file in which a wheel brings machine code."""

NATIVE = "ODDSMAP_NATIVE_KERNELS"
"""The variable that asks to compile for this very processor all the same."""

SHIPPED_CPU = {
    # Intel from Haswell (2013) and AMD from Excavator (2015) on have all of this.
    "x86_64": (
        "x86-64-v3",
        "+avx,+avx2,+bmi,+bmi2,+crc32,+cx16,+f16c,+fma,+lzcnt,+movbe,+popcnt,+sahf,+sse3,+sse4.1,"
        "+sse4.2,+ssse3,+xsave",
    ),
    "aarch64": ("generic", ""),
}
"""For each architecture the processor that shipped code is compiled for, and what it must have."""

# A Numba that keeps its code in another way: compile in each process rather than fail.
_OTHER_NUMBA = (ImportError, AttributeError, TypeError)
_CHECKSUM = hashlib.sha256().digest_size


class StoredCode:
    """The stored machine code of one kernel, by the interface that Numba calls a cache."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    @property
    def is_kept(self) -> bool:
        """Whether there is a folder for what is compiled here."""
        return self.cache_path is not None

    @property
    def cache_path(self) -> str | None:
        """The folder for what is compiled here, as Numba and NUMBA_CACHE_DIR say; None: none."""
        source = self._function.__code__.co_filename
        if source not in _folders:
            _folders[source] = _folder_for(self._function)
        return _folders[source]

    def load_overload(self, signature: Any, target: Any) -> Any:
        """The kernel for some types, or None.

        Numba would get ready to compile first, which takes 0.35 s and loads SciPy; code that is
        compiled already needs no more than the functions that count references.
        """
        try:
            return self._load(signature, target)
        except _OTHER_NUMBA:
            return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep what was compiled, where that can be done."""
        try:
            self._save(signature, result)
        except (OSError, *_OTHER_NUMBA):
            pass  # a full disk, or on Windows a file that another process reads

    def _load(self, signature: Any, target: Any) -> Any:
        from numba.core.compiler import CompileResult
        from numba.core.runtime.nrt import rtsys

        rtsys.initialize(target)
        cpu = target.codegen().magic_tuple()
        # Code for this very processor first: in 3D it is up to a fifth faster.
        places = [] if self.cache_path is None else [(Path(self.cache_path), cpu)]
        if (brought := _shipped_for(*cpu)) is not None:
            places.append((_SHIPPED_FOLDER, brought))
        for folder, compiled_for in places:
            stored = _read(folder / self._name(signature, compiled_for))
            if stored is not None and stored[0] == signature:
                # Numba states no types.
                return CompileResult._rebuild(target, *stored[1])  # type: ignore[no-untyped-call]
        return None

    def _save(self, signature: Any, result: Any) -> None:
        from numba.core.serialize import dumps

        if self.cache_path is None or result.lifted or result.library.has_dynamic_globals:
            return
        name = self._name(signature, result.codegen.magic_tuple())
        content: bytes = dumps((signature, result._reduce()))  # type: ignore[no-untyped-call]
        temporary = Path(self.cache_path) / f"{name}.tmp.{uuid.uuid4().hex[:16]}"
        try:
            temporary.write_bytes(hashlib.sha256(content).digest() + content)
            temporary.replace(temporary.with_name(name))
        finally:
            temporary.unlink(missing_ok=True)

    def _name(self, signature: Any, cpu: tuple[str, ...]) -> str:
        function = self._function
        conditions = (
            sources_digest(),
            numba.__version__,
            sys.implementation.cache_tag,
            function.__module__,
            function.__qualname__,
            str(signature),
            cpu,
        )
        digest = hashlib.sha256(repr(conditions).encode()).hexdigest()
        return f"{function.__module__.rpartition('.')[2]}.{function.__name__}-{digest[:32]}.code"

    def enable(self) -> None:
        """Nothing: it is on."""

    def disable(self) -> None:
        """Nothing: it stays on."""

    def flush(self) -> None:
        """Nothing: code for other sources is never found."""


_SHIPPED_FOLDER = Path(__file__).parent / SHIPPED
_folders: dict[str, str | None] = {}  # by source file


@cache
def _shipped_for(triple: str, name: str, features: str) -> tuple[str, str, str] | None:
    """What shipped code that runs on a processor was compiled for; None where there is none."""
    shipped = SHIPPED_CPU.get(triple.partition("-")[0])
    if shipped is None or not _SHIPPED_FOLDER.is_dir() or os.environ.get(NATIVE):
        return None
    needed = {each for each in shipped[1].split(",") if each}
    return (triple, *shipped) if needed <= set(features.split(",")) else None


def _folder_for(function: Callable[..., Any]) -> str | None:
    """Where Numba would keep the code of a function; asking makes the folder, and writes to it."""
    try:
        from numba.core.caching import CompileResultCacheImpl

        kept = CompileResultCacheImpl(function)  # type: ignore[no-untyped-call]
        folder: str = kept.locator.get_cache_path()
    except (RuntimeError, *_OTHER_NUMBA):  # RuntimeError: no folder can be written to
        return None
    return folder


def _read(path: Path) -> Any:
    """What a file holds; None where it does not exist or is damaged."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    if hashlib.sha256(content[_CHECKSUM:]).digest() != content[:_CHECKSUM]:
        return None
    # Who can write there can write the sources, too.
    return pickle.loads(content[_CHECKSUM:])  # noqa: S301


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
        if entry.is_dir() and entry.name not in ("__pycache__", SHIPPED):
            found += _sources(entry, f"{prefix}{entry.name}/")
        elif entry.name.endswith(".py"):
            found.append((prefix + entry.name, entry))
    return found
