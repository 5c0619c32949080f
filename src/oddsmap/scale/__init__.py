# SPDX-License-Identifier: Apache-2.0
"""Maps larger than memory, by parts; `build` maps logs on a cluster, with the same bits."""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False
if TYPE_CHECKING:
    from oddsmap.scale.dask_build import Built, build

__all__ = ["Built", "build"]


def __getattr__(name: str) -> object:
    if name not in __all__:
        raise AttributeError(f"module 'oddsmap.scale' has no attribute {name!r}")
    value = getattr(import_module("oddsmap.scale.dask_build"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
