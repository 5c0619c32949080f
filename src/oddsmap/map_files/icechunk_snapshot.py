# SPDX-License-Identifier: Apache-2.0
"""The files of one commit of an Icechunk repository.

Each commit is a Zarr hierarchy, complete and never changed again; one that changes a few shards
shares all others with the one before it. Files of shards are packed and unpacked as in a saved map
(`oddsmap.map_files.shard_bytes`), and given to Icechunk as they are.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

__all__ = ["Snapshot"]

T = TypeVar("T")


class Snapshot:
    """The files of one commit; those of a new one while it is made.

    Args:
        session: of Icechunk.
    """

    def __init__(self, session: Any) -> None:
        self._session = session

    def read(self, keys: Sequence[str]) -> list[bytes | None]:
        """Contents of some files, all asked for at once; None where there is none."""

        async def read() -> list[bytes | None]:
            from zarr.buffer import default_buffer_prototype

            kind, store = default_buffer_prototype(), self._session.store
            found = await asyncio.gather(*(store.get(key, kind) for key in keys))
            return [None if each is None else each.to_bytes() for each in found]

        return _run(read())

    def places(self, array: str) -> list[tuple[int, ...]]:
        """Of the shards that an array has, in order."""

        async def places() -> list[tuple[int, ...]]:
            return sorted([tuple(at) async for at in self._session.chunk_coordinates(f"/{array}")])

        return _run(places())

    def write(self, files: Mapping[str, bytes | None]) -> None:
        """Set the contents of some files; None: there is no such file any more."""

        async def write() -> None:
            from zarr.buffer import default_buffer_prototype

            kind, store = default_buffer_prototype().buffer, self._session.store
            # Icechunk takes no shard of an array that it does not know yet.
            for key in sorted(files, key=lambda key: (key.count("/"), key)):
                content = files[key]
                if content is None:
                    await store.delete(key)
                else:
                    await store.set(key, kind.from_bytes(content))

        _run(write())

    def commit(self, message: str, facts: Mapping[str, Any]) -> str | None:
        """Make what was written a commit after the newest there is.

        Returns:
            Its id; None where a commit made meanwhile has changed one of the same files.
        """
        from icechunk import ConflictDetector, ConflictError, RebaseFailedError

        try:
            made: str = self._session.commit(
                message, metadata=dict(facts), rebase_with=ConflictDetector()
            )
        except (ConflictError, RebaseFailedError):
            return None
        return made


def _run(work: Coroutine[Any, Any, T]) -> T:
    """Run it in a thread of its own: in a notebook this one has a loop that is running."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asyncio.run, work).result()
