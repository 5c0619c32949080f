# SPDX-License-Identifier: Apache-2.0
"""The map that workers write: what they made takes its place when it is complete."""

from __future__ import annotations

import os
import tempfile
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from oddsmap.atomic_write import atomic_output
from oddsmap.errors import OutputError
from oddsmap.map_files.zarr_folder import NewFolder, check_map_output, why_no_map
from oddsmap.scale.map_places import LocalPlace, Place, UrlPlace, is_url

__all__ = ["ClusterOutput", "check_output_place", "cluster_output"]


@dataclass(frozen=True, slots=True)
class ClusterOutput:
    """Where a map is being made.

    Args:
        place: what workers write to.
        folder: the beginning of the names of the map's files in it.
        parts: likewise of what is needed until the map is complete.
    """

    place: Place
    folder: str
    parts: str

    @contextmanager
    def new_map(self, shape: tuple[int, ...]) -> Iterator[NewFolder]:
        """What the map says of itself; it is written when the block ends, and the last of all.

        Args:
            shape: of its arrays, whole shards, (ny, nx) or (nz, ny, nx).
        """
        if isinstance(self.place, LocalPlace):
            yield NewFolder(Path(self.place.folder, self.folder), shape)
            return
        with tempfile.TemporaryDirectory() as made:
            folder = NewFolder(Path(made, "map"), shape)
            yield folder
            files = [path for path in folder.path.rglob("*") if path.is_file()]
            # What makes a map of them comes last.
            for file in sorted(files, key=lambda file: (file.parent == folder.path, file)):
                name = file.relative_to(folder.path).as_posix()
                self.place.put(f"{self.folder}/{name}", file.read_bytes())


def check_output_place(
    output: str | os.PathLike[str], *, force: bool, options: Mapping[str, Any] | None = None
) -> None:
    """Refuse an output before any work is done for it.

    Raises:
        OutputError: see `check_map_output`; or a URL where there is something.
        InputError: no such kind of URL is known, or it cannot be reached.
    """
    if not is_url(output):
        check_map_output(Path(output), force=force)
        return
    place, name = _at_url(output, options)
    try:
        exists = place.exists(name)
    except OSError as error:
        raise OutputError(f"{output}: cannot be looked at ({error})") from None
    if exists:
        raise OutputError(
            f"{output}: exists already, and a map at a URL cannot be replaced in one step: give "
            "another name, or remove it first"
        )


@contextmanager
def cluster_output(
    output: str | os.PathLike[str], *, force: bool, options: Mapping[str, Any] | None = None
) -> Iterator[ClusterOutput]:
    """Make a map; an old one stays until the new one is complete.

    Args:
        output: a folder, which all workers see at the same path, or a URL.
        force: True if an existing map may be replaced; not at a URL.
        options: for fsspec.

    Raises:
        OutputError: see `check_output_place`; also where writing fails.
    """
    check_output_place(output, force=force, options=options)
    if not is_url(output):
        path = Path(output).absolute()
        with atomic_output(path, force=force, why_not=why_no_map) as part:
            parts = f"{path.name}.parts"
            yield ClusterOutput(LocalPlace(str(part.parent), f"{parts}/writing"), path.name, parts)
        return
    place, name = _at_url(output, options)
    parts, done = f"{name}.{uuid.uuid4().hex[:12]}.parts", False
    try:
        yield ClusterOutput(place, name, parts)
        done = True
    except OSError as error:
        raise OutputError(f"{output}: cannot be written: {error}") from error
    finally:
        with suppress(OSError):
            place.remove(parts)
            if not done:
                place.remove(name)


def _at_url(
    output: str | os.PathLike[str], options: Mapping[str, Any] | None
) -> tuple[UrlPlace, str]:
    scheme, _, rest = os.fspath(output).partition("://")
    parent, _, name = rest.rstrip("/").rpartition("/")
    if not name:
        raise OutputError(f"{os.fspath(output)}: give the name of a map in it")
    return UrlPlace(f"{scheme}://{parent}", dict(options or {})), name
