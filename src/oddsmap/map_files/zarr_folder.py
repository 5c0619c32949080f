# SPDX-License-Identifier: Apache-2.0
"""The folder that maps are saved in: which files there are, and what seals them.

A plain Zarr group, format 3, with sharded arrays that cover one box of cells; any Zarr reader opens
it. Every save has an id, `save`, in the group and in each array; `digest` covers what the group
says of the map and what Zarr knows of the arrays. The bytes of the cells have checksums of their
own: zstd's in each chunk, CRC-32C in each shard's index. docs/formats.md has it all.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from oddsmap.atomic_write import atomic_output, check_output
from oddsmap.errors import OutputError
from oddsmap.map_files.shard_bytes import pack_axis, pack_shard, shard_checksum
from oddsmap.map_files.zarr_metadata import AXES, array_json, axis_json, group_json

if TYPE_CHECKING:
    import numpy.typing as npt

    from oddsmap.array_types import IntArray

__all__ = [
    "ARRAYS",
    "CHUNK",
    "EVIDENCE_MAP",
    "FORMAT_VERSION",
    "FULL_MAP",
    "SHARD",
    "NewFolder",
    "check_map_output",
    "digest_of",
    "format_of",
    "new_folder",
    "read_json",
    "shard_files",
    "why_no_map",
]

EVIDENCE_MAP = "oddsmap evidence map"
FULL_MAP = "oddsmap full map"
FORMAT_VERSION = 1

ARRAYS = {EVIDENCE_MAP: ("hits", "passes", "lengths"), FULL_MAP: ("log_odds", "marks")}
"""Names of the arrays of each kind of map."""
CHUNK = {2: 128, 3: 32}
"""Side of a chunk [cells], the unit of compression."""
SHARD = {2: 1024, 3: 128}
CHUNKS_IN_SHARD = {d: (SHARD[d] // CHUNK[d]) ** d for d in SHARD}
"""Side of a shard [cells], which is one file."""

# Coordinates of more cells are not written, or two far cells would make a map of gigabytes.
_LONGEST_AXIS = 1 << 22

# What `digest` covers; `checksums` came later. Other attributes are other people's.
_OF_GROUP = (
    "format", "format_version", "resolution", "origin", "origin_cell", "known_cells_lo",
    "known_cells_hi", "votes", "sweeps", "residual", "converged", "config", "provenance", "shards",
    "save",
)  # fmt: skip
_OF_ARRAY = ("description", "weight_unit", "save")
_OF_ZARR = ("shape", "data_type", "chunk_grid", "chunk_key_encoding", "fill_value", "codecs")
# A million shards are listed in 70 MB; more is no map's.
_MAX_JSON = 5 << 24
# What systems put into folders by themselves.
_STRAY = {".DS_Store", "Thumbs.db", "desktop.ini"}


class NewFolder:
    """A map's folder that is being written.

    Args:
        path: the folder to make.
        shape: of its arrays, whole shards, (ny, nx) or (nz, ny, nx).
    """

    def __init__(self, path: Path, shape: tuple[int, ...]) -> None:
        self.path, self.shape = path, shape
        self.save = secrets.token_hex(16)
        self._fills: dict[str, float] = {}
        self._checksums: dict[tuple[str, tuple[int, ...]], int] = {}
        self._made: set[Path] = set()
        path.mkdir()

    def create(
        self,
        name: str,
        dtype: npt.DTypeLike,
        fill_value: float,
        attributes: Mapping[str, Any],
    ) -> None:
        """Make an array, which is filled shard by shard."""
        d = len(self.shape)
        self._fills[name] = fill_value
        own = {**attributes, "save": self.save}
        text = array_json(self.shape, SHARD[d], CHUNK[d], dtype, fill_value, own)
        (self.path / name).mkdir()
        (self.path / name / "zarr.json").write_text(text, encoding="ascii")

    def write(
        self, name: str, place: tuple[int, ...], numbers: IntArray, chunks: npt.NDArray[Any]
    ) -> None:
        """Write a shard of an array; one that is empty has no file. Threads may write several.

        Args:
            name: of the array.
            place: of the shard, in shards, z before y before x.
            numbers: of its chunks that may hold something, in ascending order, x fastest, shape
                (n,).
            chunks: their cells, of the array's type, shape (n, chunk^d), x fastest.
        """
        d = len(self.shape)
        count = CHUNKS_IN_SHARD[d]
        content = pack_shard(numbers, chunks, count, self._fills[name])
        if content is not None:
            file = self.path.joinpath(name, "c", *map(str, place))
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
            self._checksums[name, tuple(place)] = shard_checksum(content, count)

    def take_over(
        self, name: str, place: tuple[int, ...], file: Path, checksum: int | None
    ) -> bool:
        """Take a shard as it is in another map's folder, which is not to be written to in place.

        Args:
            name: of the array.
            place: of the shard here.
            file: there.
            checksum: its `shard_checksum`; None: nobody knows.

        Returns:
            Whether the two are one file now: a hard link. Where the file system has none (FAT,
            some network folders), or this user may not make one, it is copied.
        """
        own = self.path.joinpath(name, "c", *map(str, place))
        if own.parent not in self._made:
            own.parent.mkdir(parents=True, exist_ok=True)
            self._made.add(own.parent)
        if checksum is not None:
            self._checksums[name, tuple(place)] = checksum
        try:
            os.link(file, own)
        except OSError:
            shutil.copyfile(file, own)
            return False
        return True

    def _write_axes(self, origin_cell: list[int], resolution: float) -> None:
        """Write where the cells' centres lie, for readers that know coordinates (xarray)."""
        for name, first, count in zip(AXES[::-1], origin_cell, self.shape[::-1], strict=False):
            if count <= _LONGEST_AXIS:
                centres = (np.arange(first, first + count) + 0.5) * resolution
                (self.path / name / "c").mkdir(parents=True)
                text = axis_json(name, count, {"units": "m", "long_name": f"{name} of the centre"})
                (self.path / name / "zarr.json").write_text(text, encoding="ascii")
                (self.path / name / "c" / "0").write_bytes(pack_axis(centres))

    def seal(
        self,
        attributes: Mapping[str, Any],
        written: Mapping[str, Mapping[tuple[int, ...], int]] | None = None,
    ) -> None:
        """Write the group, once all shards are written, and the coordinates.

        Args:
            attributes: of the group.
            written: places of the shards of each array, z before y before x, and the
                `shard_checksum` of each; None: those that are in the folder.
        """
        d = len(self.shape)
        self._write_axes(attributes["origin_cell"], attributes["resolution"])
        shards: Mapping[str, list[Any]]
        if written is None:
            shards = {name: shard_files(self.path, name, d) for name in self._fills}
            known = self._checksums
        else:
            shards = {name: sorted(files) for name, files in written.items()}
            known = {(name, at): n for name, files in written.items() for at, n in files.items()}
        checksums = {
            name: _listed([known.get((name, tuple(place))) for place in places])
            for name, places in shards.items()
        }
        # As a reader will have them: a tuple is a list there.
        own = json.loads(json.dumps({**attributes, "shards": shards, "save": self.save}))
        own.pop("checksums", None)
        if None not in checksums.values():  # of maps of before there were any some are not known
            own["checksums"] = checksums
        arrays = {name: read_json(self.path / name / "zarr.json") for name in self._fills}
        text = group_json({**own, "digest": digest_of(own, arrays)})
        if len(text) > _MAX_JSON:  # nobody would read it
            count = sum(map(len, shards.values()))
            raise OutputError(
                f"{self.path.name}: {count} files of cells are more than a map lists: make "
                "one map of each region, or use a coarser resolution"
            )
        (self.path / "zarr.json").write_text(text, encoding="ascii")


def _listed(checksums: list[int | None]) -> str | None:
    """Checksums one after the other, eight digits each; None where one is not known."""
    if None in checksums:
        return None
    return "".join(f"{each:08x}" for each in checksums)


@contextmanager
def new_folder(
    path: Path,
    shape: tuple[int, ...],
    *,
    force: bool,
    check: Callable[[], None] = lambda: None,
) -> Iterator[NewFolder]:
    """Write a map; the old one stays in place until the new one is complete.

    Args:
        path: the folder to make.
        shape: see `NewFolder`.
        force: True if an existing map may be replaced.
        check: called before an existing map is replaced, which what it raises prevents.

    Raises:
        OutputError: see `check_map_output`; also where writing fails.
    """

    def why_not(old: Path) -> str | None:
        reason = why_no_map(old)
        check()
        return reason

    with atomic_output(path, force=force, why_not=why_not) as part:
        yield NewFolder(part, shape)


def check_map_output(path: Path, *, force: bool = False) -> None:
    """Refuse a map's folder before any work is done for it: see `atomic_write.check_output`.

    Raises:
        OutputError: it exists and `force` is False, it is no map of ours, or one with other
            people's files in it, or its folder is missing or not writable.
    """
    check_output(path, force=force, why_not=why_no_map)


def why_no_map(path: Path) -> str | None:
    """Why a map does not take the place of what is there: the least that is not ours."""
    if not path.is_dir():
        empty = path.is_file() and path.stat().st_size == 0
        return None if empty else "is a file, and a map is a folder"
    if not any(path.iterdir()):
        return None
    kind = format_of(path)
    if kind not in ARRAYS:
        zarr = "a Zarr folder of another program" if (path / "zarr.json").exists() else "a folder"
        return f"is {zarr} and no map of oddsmap"
    for file in sorted(path.rglob("*")):
        if file.is_dir() and not file.is_symlink():
            continue
        if not _is_part(file.relative_to(path).parts, ARRAYS[kind]):
            return f"holds {file.relative_to(path)}, which is no part of the map"
    return None


def _is_part(parts: tuple[str, ...], arrays: tuple[str, ...]) -> bool:
    name = parts[-1]
    if name in _STRAY or name.endswith(".partial"):  # what a killed writer of Zarr leaves
        return True
    if parts == ("zarr.json",):
        return True
    if parts[0] in AXES:
        return parts[1:] in (("zarr.json",), ("c", "0"))
    if parts[0] not in arrays:
        return False
    return parts[1:] == ("zarr.json",) or (
        len(parts) in (4, 5) and parts[1] == "c" and all(part.isdecimal() for part in parts[2:])
    )


def format_of(path: Path) -> str | None:
    """What a folder says it is: its attribute `format`; None where it says nothing."""
    try:
        found = read_json(path / "zarr.json")["attributes"]["format"]
    except (OSError, ValueError, LookupError, TypeError, RuntimeError):
        return None
    return found if isinstance(found, str) else None


def read_json(file: Path) -> dict[str, Any]:
    """Read one of Zarr's JSON files.

    Raises:
        OSError: it cannot be read.
        ValueError: it is no JSON object, or too large for one.
        RecursionError: it is nested too deeply.
    """
    if (size := file.stat().st_size) > _MAX_JSON:
        raise ValueError(f"{file.name} of {size} bytes: no map's is as large")
    content = json.loads(file.read_bytes())
    if not isinstance(content, dict):
        raise ValueError(f"{file.name} is not a JSON object")
    return content


def digest_of(attributes: Mapping[str, Any], arrays: Mapping[str, Mapping[str, Any]]) -> str:
    """SHA-256 of what a map says of itself, in hexadecimal.

    Args:
        attributes: of the group.
        arrays: the `zarr.json` of each array, by its name.
    """
    whole = {
        "group": _chosen(attributes, _OF_GROUP),
        "arrays": {
            name: {
                "zarr": _chosen(metadata, _OF_ZARR),
                "attributes": _chosen(metadata.get("attributes", {}), _OF_ARRAY),
            }
            for name, metadata in arrays.items()
        },
    }
    text = json.dumps(whole, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _chosen(values: Mapping[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
    return {name: values[name] for name in names if name in values}


def shard_files(path: Path, name: str, d: int) -> list[list[int]]:
    """Place of each file of an array, in shards, z and y before x; an empty file counts as none."""
    found: list[list[int]] = []

    def look_in(folder: str, place: list[int]) -> None:
        with os.scandir(folder) as entries:
            for entry in entries:
                if not entry.name.isdecimal():
                    continue
                here = [*place, int(entry.name)]
                if len(here) < d and entry.is_dir():
                    look_in(entry.path, here)
                elif len(here) == d and entry.stat().st_size:
                    found.append(here)

    # By strings: a path object a file takes four times as long, of maps with thousands.
    with suppress(FileNotFoundError):
        look_in(os.fspath(path / name / "c"), [])
    return sorted(found)
