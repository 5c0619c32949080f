# SPDX-License-Identifier: Apache-2.0
"""A folder behind a simulated network: each request waits, and bytes come at a rate.

`register` makes fsspec know it as slow://, in this process and, by `client.run`, in workers; the
URL's options are `request_s` and `mb_s`. The waiting is that of each worker for itself, as if each
had a line of its own to the store.
"""

from __future__ import annotations

import time
from typing import Any

import fsspec
from fsspec.implementations.local import LocalFileSystem

__all__ = ["SlowStore", "register"]


class SlowStore(LocalFileSystem):  # type: ignore[misc]
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

    def _wait(self, size: int) -> None:
        time.sleep(self.request_s + size / 1e6 / self.mb_s)

    def pipe_file(self, path: str, value: bytes, **options: Any) -> None:
        """Write."""
        self._wait(len(value))
        super().pipe_file(path, value, **options)

    def cat_file(self, path: str, start: int | None = None, end: int | None = None) -> bytes:
        """Read."""
        content: bytes = super().cat_file(path, start, end)
        self._wait(len(content))
        return content


def register() -> None:
    """Let fsspec know of it."""
    fsspec.register_implementation("slow", SlowStore, clobber=True)
