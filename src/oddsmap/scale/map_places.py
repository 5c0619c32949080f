# SPDX-License-Identifier: Apache-2.0
"""Where workers write: a folder that all of them see, or any other store that fsspec knows."""

from __future__ import annotations

import os
import re
import shutil
import uuid
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

from oddsmap.errors import InputError

__all__ = ["LocalPlace", "Place", "UrlPlace", "is_url", "url_of"]

# One letter is a drive of Windows.
_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")


def is_url(path: str | os.PathLike[str]) -> bool:
    """Whether an output is named by a URL, like s3://bucket/city.zarr, and not by a path."""
    return _URL.match(os.fspath(path)) is not None


def url_of(path: Path) -> str | None:
    """The URL that was made a path of, which took one of its slashes; None: it was none."""
    found = re.match(r"([A-Za-z][A-Za-z0-9+.-]+):/(?=[^/])", path.as_posix())
    if found is None:
        return None
    scheme, rest = found[1], path.as_posix()[found.end() :]
    return f"{scheme}://{'/' if scheme in ('file', 'local') else ''}{rest}"


class Place(Protocol):
    """Named contents; goes to workers, who write and read the same ones."""

    def put(self, name: str, content: bytes) -> None:
        """Write a whole content, or none of it; the same name may be written again.

        Raises:
            OSError: it cannot be written.
        """

    def put_all(self, contents: Mapping[str, bytes]) -> None:
        """Write several, by their names; where there is a network between, at the same time.

        Raises:
            OSError: one cannot be written; others may have been.
        """

    def get(self, name: str, offset: int, length: int) -> bytes:
        """Read a part of a content.

        Raises:
            OSError: there is no such content, or it is shorter.
        """

    def get_all(self, parts: Sequence[tuple[str, int, int]]) -> list[bytes]:
        """Read several, each by name, offset and length; likewise."""

    def remove(self, name: str) -> None:
        """Remove a content, or all whose names begin with this and a slash."""


@dataclass(frozen=True, slots=True)
class LocalPlace:
    """A folder; satisfies `Place`.

    Args:
        folder: its path, the same on all workers.
        scratch: a name in it under which contents are written before they are complete.
    """

    folder: str
    scratch: str

    def __str__(self) -> str:
        return self.folder

    def put(self, name: str, content: bytes) -> None:
        """Write beside, and rename."""
        base = Path(self.folder)
        if not base.is_dir():  # the run is over: nothing must come after it
            raise FileNotFoundError(f"the folder {self.folder} is not there")
        part, whole = base / self.scratch / uuid.uuid4().hex, base / name
        for path in (part, whole):
            path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(content)
        part.replace(whole)

    def put_all(self, contents: Mapping[str, bytes]) -> None:
        """Write one after the other."""
        for name, content in contents.items():
            self.put(name, content)

    def get_all(self, parts: Sequence[tuple[str, int, int]]) -> list[bytes]:
        """Read one after the other."""
        return [self.get(*part) for part in parts]

    def get(self, name: str, offset: int, length: int) -> bytes:
        """Read a part of a file."""
        with Path(self.folder, name).open("rb") as file:
            file.seek(offset)
            return _whole(file.read(length), length, name)

    def remove(self, name: str) -> None:
        """Remove a file or a folder."""
        path = Path(self.folder, name)
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)


@dataclass(frozen=True)
class UrlPlace:
    """What fsspec reaches; satisfies `Place`.

    Args:
        url: s3://bucket/maps, memory://maps, ...
        options: for fsspec: credentials, endpoints.
    """

    url: str
    options: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.url

    @cached_property
    def _files(self) -> tuple[Any, str]:
        from fsspec.core import url_to_fs

        try:
            files, root = url_to_fs(self.url, **self.options)
        except (ImportError, ValueError) as error:
            raise InputError(f"{self.url}: cannot be reached ({error})") from None
        # Listings may be kept for long, and others write.
        files.use_listings_cache = False
        return files, str(root).rstrip("/")

    def __getstate__(self) -> dict[str, Any]:
        """What goes to workers: each opens its own."""
        return {"url": self.url, "options": dict(self.options)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """The inverse."""
        self.__dict__.update(state)

    def put(self, name: str, content: bytes) -> None:
        """Write in one request; where there are folders, they are made."""
        self.put_all({name: content})

    def put_all(self, contents: Mapping[str, bytes]) -> None:
        """Write each in one request, as many at the same time as fsspec sees fit."""
        files, root = self._files
        paths = {f"{root}/{name}": content for name, content in contents.items()}
        with suppress(NotImplementedError):  # a store of objects has no folders
            for folder in sorted({path.rpartition("/")[0] for path in paths}):
                files.makedirs(folder, exist_ok=True)
        if paths:
            files.pipe(paths)

    def get_all(self, parts: Sequence[tuple[str, int, int]]) -> list[bytes]:
        """Read ranges of bytes, as many at the same time as fsspec sees fit."""
        files, root = self._files
        found: list[bytes] = files.cat_ranges(
            [f"{root}/{name}" for name, _, _ in parts],
            [offset for _, offset, _ in parts],
            [offset + length for _, offset, length in parts],
            on_error="raise",
        )
        return [
            _whole(content, length, name)
            for content, (name, _, length) in zip(found, parts, strict=True)
        ]

    def get(self, name: str, offset: int, length: int) -> bytes:
        """Read a range of bytes."""
        return self.get_all([(name, offset, length)])[0]

    def exists(self, name: str) -> bool:
        """Whether there is such a content, or any whose name begins with this and a slash."""
        files, root = self._files
        files.invalidate_cache()
        return bool(files.exists(f"{root}/{name}"))

    def remove(self, name: str) -> None:
        """Remove what there is of it."""
        files, root = self._files
        files.invalidate_cache()
        with suppress(FileNotFoundError):
            files.rm(f"{root}/{name}", recursive=True)


def _whole(content: bytes, length: int, name: str) -> bytes:
    if len(content) != length:
        raise OSError(f"{name}: {len(content)} bytes where {length} were written")
    return content
