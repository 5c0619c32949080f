# SPDX-License-Identifier: Apache-2.0
"""What has to be the same on all machines, so that a scan gives the same bits on each."""

from __future__ import annotations

import platform
from dataclasses import dataclass, fields

import numpy as np

from oddsmap.errors import InputError
from oddsmap.version import __version__

__all__ = ["Versions", "check_versions", "versions_here"]


@dataclass(frozen=True, slots=True)
class Versions:
    """What is installed on a machine.

    Args:
        oddsmap: its version.
        kernels: a digest of the sources of its kernels, which tells working copies apart.
        numba: version of what compiles them.
        numpy: version of what takes sines and cosines.
        machine: its kind of processor, whose compiled code may round otherwise.
    """

    oddsmap: str
    kernels: str
    numba: str
    numpy: str
    machine: str


def versions_here() -> Versions:
    """What is installed in this process."""
    import numba

    from oddsmap.kernels.stored_code import sources_digest

    return Versions(
        oddsmap=__version__,
        kernels=sources_digest()[:12],
        numba=numba.__version__,
        numpy=np.__version__,
        machine=platform.machine(),
    )


def check_versions(theirs: Versions, ours: Versions, who: str) -> None:
    """Refuse a worker that might give other bits.

    Args:
        theirs: what the worker has.
        ours: what whoever builds the map has.
        who: the worker's address.

    Raises:
        InputError: they differ.
    """
    differ = [
        f"{field.name} {getattr(theirs, field.name)} (here {getattr(ours, field.name)})"
        for field in fields(Versions)
        if getattr(theirs, field.name) != getattr(ours, field.name)
    ]
    if differ:
        raise InputError(
            f"worker {who} has {', '.join(differ)}: it may give other bits; install the same there"
        )
