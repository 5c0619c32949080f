# SPDX-License-Identifier: Apache-2.0
"""A folder behind a simulated network: requests wait, some at a time, and bytes come at a rate.

`register` makes fsspec know it as slow://, in this process and, by `client.run`, in workers; the
URL's options are `request_s` and `mb_s`. The waiting is that of each worker for itself, as if each
had a line of its own to the store.
"""

from __future__ import annotations

import time
from typing import Any

import fsspec
from fsspec.implementations.local import LocalFileSystem

__all__ = ["AT_ONCE", "SlowStore", "register"]

AT_ONCE = 16
"""Requests that wait at the same time; fsspec's object stores have more."""


class SlowStore(LocalFileSystem):  # type: ignore[misc]  # fsspec has no types
    """Files of this machine that take their time.

    Args:
        request_s: how long each request waits [s].
        mb_s: megabytes a second, both ways.
    """

    protocol = "slow"

    def __init__(self, request_s: float = 0.0, mb_s: float = 1e9, **options: Any) -> None:
        super().__init__(**options)
        self.request_s, self.mb_s = request_s, mb_s

    @classmethod
    def _strip_protocol(cls, path: Any) -> Any:
        whole = str(path)
        return super()._strip_protocol(whole.removeprefix("slow://"))

    def _wait(self, sizes: list[int]) -> None:
        time.sleep(-(-len(sizes) // AT_ONCE) * self.request_s + sum(sizes) / 1e6 / self.mb_s)

    def pipe(self, path: dict[str, bytes], value: None = None, **options: Any) -> None:
        """Write."""
        self._wait([len(content) for content in path.values()])
        for name, content in path.items():
            self.pipe_file(name, content, **options)

    def cat_ranges(
        self, paths: list[str], starts: list[int], ends: list[int], **options: Any
    ) -> list[bytes]:
        """Read."""
        self._wait([end - start for start, end in zip(starts, ends, strict=True)])
        found: list[bytes] = super().cat_ranges(paths, starts, ends, **options)
        return found


def register() -> None:
    """Let fsspec know of it."""
    fsspec.register_implementation("slow", SlowStore, clobber=True)
