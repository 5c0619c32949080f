# SPDX-License-Identifier: Apache-2.0
"""How large things may be: memory, coordinates, tiles."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from oddsmap.errors import ConfigError, InputError, MapTooLargeError, OddsmapError, shown

__all__ = [
    "MAX_COORDINATE",
    "TILE_SIDE",
    "TOO_LONG",
    "bytes_of",
    "check_content_size",
    "default_budget",
    "in_metres",
    "memory_for",
    "memory_limit",
]

TOO_LONG = "use a coarser resolution, or range_max where a reading is too long"
"""What to do where one scan spans more than can be held."""

# Beyond this many cells from the map's origin no precision is left within a cell.
MAX_COORDINATE = float(1 << 45)


# 32 x 32 cells: measured best of 16, 32 and 64 for 2D scans at 0.05 m. 8^3 in 3D.
TILE_SIDE = {2: 32, 3: 8}

_NO_LIMIT = 1 << 62
_LEAST_BUDGET = 32_000_000


def in_metres(length: float) -> str:
    """A length in four digits, for messages: 14560, not 1.456e+04."""
    return f"{float(f'{length:.4g}'):.7g}"


def memory_limit() -> int:
    """Bytes that one map may use: 80 % of what the process may have.

    That is the machine's memory, or less where a container (cgroup v1 or v2) or `ulimit` says so.
    """
    return int(0.8 * min(_machine_memory(), _container_memory(), _ulimit_memory()))


def default_budget() -> int:
    """Bytes that a map takes before parts of it are kept on the disk, where nobody says it.

    Half of what is free when this is asked, and no more than half of `memory_limit`; 32 MB where
    that is less.
    """
    return max(_LEAST_BUDGET, min(memory_limit(), _available_memory()) // 2)


def bytes_of(memory: int | str) -> int:
    """A budget of memory in bytes.

    Args:
        memory: bytes, or a number with its unit, as "4GB", "500 MB" or "4 GiB".

    Raises:
        ConfigError: it is none, or below 32 MB, of which no scan leaves much.
    """
    found = re.fullmatch(r"\s*(\d+(?:\.\d*)?)\s*([kMGT]i?B)\s*", str(memory), re.IGNORECASE)
    if isinstance(memory, int) and not isinstance(memory, bool):
        size = memory
    elif found is None:
        raise ConfigError(f"memory is a number with its unit, as 4GB or 500MB, got {shown(memory)}")
    else:
        power = "kmgt".index(found[2][0].lower()) + 1
        size = int(float(found[1]) * (1024 if "i" in found[2].lower() else 1000) ** power)
    if size < _LEAST_BUDGET:
        raise ConfigError(f"memory: at least 32MB are needed, got {shown(memory)}")
    return size


def check_content_size(where: object, size: int, what: str) -> None:
    """Refuse a file's content that memory could not hold, before it is read or decompressed.

    Raises:
        InputError: `size` bytes are more than half of `memory_limit`: readers hold it twice.
    """
    limit = memory_limit() // 2
    if size > limit:
        raise InputError(
            f"{where}: {what} takes {size / 1e9:.3g} GB, at most {limit / 1e9:.3g} GB fit in "
            "memory here: split the file, or read it on a machine with more memory"
        )


@contextmanager
def memory_for(what: str, advice: str) -> Iterator[None]:
    """Say in one line where memory, or what `ulimit` leaves of it, does not hold something.

    Args:
        what: what it was to hold.
        advice: what to do.

    Raises:
        MapTooLargeError: in place of any MemoryError.
    """
    try:
        yield
    except OddsmapError:
        raise
    except MemoryError:
        raise MapTooLargeError(f"no memory for {what}: {advice}") from None


@cache
def _machine_memory() -> int:
    if sys.platform == "win32":
        return _NO_LIMIT
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError):  # a system without these names
        return _NO_LIMIT


def _available_memory(facts: Path = Path("/proc/meminfo")) -> int:
    """Bytes that are free now, or would be for who asks, as Linux estimates it."""
    try:
        lines = facts.read_text(encoding="ascii").splitlines()
        return 1024 * next(
            int(line.split()[1]) for line in lines if line.startswith("MemAvailable")
        )
    except (OSError, ValueError, LookupError, StopIteration):
        return _NO_LIMIT


@cache
def _container_memory(
    groups: Path = Path("/proc/self/cgroup"), mounted: Path = Path("/sys/fs/cgroup")
) -> int:
    """The smallest limit of the control groups that the process is in, and of their parents.

    Args:
        groups: lines "0::/path" (version 2) and "4:memory:/path" (version 1).
        mounted: where their files are. In a container the path may be one of the host's: then the
            container's own group is mounted at the root, which is the last parent looked at.
    """
    limits = [_NO_LIMIT]
    try:
        lines = groups.read_text(encoding="ascii", errors="replace").splitlines()
    except OSError:
        return _NO_LIMIT
    for line in lines:
        _, controllers, path = [*line.split(":", 2), "", ""][:3]
        if not controllers:
            root, name = mounted, "memory.max"
        elif "memory" in controllers.split(","):
            root, name = mounted / "memory", "memory.limit_in_bytes"
        else:
            continue
        group = root / path.lstrip("/")
        for folder in (group, *group.parents):
            limits.append(_read_limit(folder / name))
            if folder == root:
                break
    return min(limits)


def _read_limit(path: Path) -> int:
    try:
        limit = int(path.read_text(encoding="ascii"))
    except (OSError, ValueError):  # no such group, or "max"
        return _NO_LIMIT
    return limit if limit > 0 else _NO_LIMIT


def _ulimit_memory() -> int:
    """What `ulimit -v` and `-d` leave beside the interpreter and its libraries."""
    if sys.platform == "win32":
        return _NO_LIMIT
    import resource

    limits = [_NO_LIMIT]
    for name in ("RLIMIT_AS", "RLIMIT_DATA"):
        kind = getattr(resource, name, None)
        if kind is not None:
            soft, _ = resource.getrlimit(kind)
            if soft != resource.RLIM_INFINITY:
                limits.append(max(0, soft - _address_space()))
    return min(limits)


@cache
def _address_space() -> int:
    """Bytes of addresses taken when it is first asked for: programs and libraries, mostly."""
    if sys.platform != "linux":
        return 0
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        return pages * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):  # no /proc in this container
        return 0
