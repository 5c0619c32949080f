# SPDX-License-Identifier: Apache-2.0
"""The files of a recording: one, or those of a folder in the order of their times."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from oddsmap.decoding import decoding
from oddsmap.errors import InputError, shown
from oddsmap.recordings.bag_file import BagFile
from oddsmap.recordings.container import Container, megabytes
from oddsmap.recordings.mcap_file import McapFile
from oddsmap.recordings.sqlite_file import SqliteFile

__all__ = ["Folder", "is_recording_file", "is_recording_folder", "open_container", "open_folder"]

_MAGIC: dict[bytes, type[BagFile] | type[SqliteFile] | type[McapFile]] = {
    b"#ROSBAG V": BagFile,
    b"SQLite format 3\0": SqliteFile,
    b"\x89MCAP0\r\n": McapFile,
}
_SUFFIXES = (".bag", ".db3", ".mcap")
_OTHER_SCANS = (".pcd", ".ply", ".bin", ".png")
_ZSTD = b"\x28\xb5\x2f\xfd"
# A metadata.yaml lists topics, some hundred bytes each.
_LARGEST_METADATA = 16 * 1024 * 1024
# A compressed file that holds more than this many times its size is made to fill a disk.
_MAX_RATIO = 100


@dataclass(frozen=True, slots=True, eq=False)
class Folder:
    """The files of a folder.

    Args:
        files: in the order of their times.
        per_message: each message is compressed by zstd.
        messages: how many messages there should be; None where nothing says it.
        end_ns: when the last was written [ns]; None where nothing says it.
        temporary: where files are that had to be decompressed.
    """

    files: list[Container]
    per_message: bool = False
    messages: int | None = None
    end_ns: int | None = None
    temporary: TemporaryDirectory[str] | None = None


def is_recording_file(head: bytes) -> bool:
    """Whether a file that starts like this may be a recording."""
    return any(head.startswith(magic) for magic in _MAGIC)


def is_recording_folder(path: Path) -> bool:
    """Whether a folder holds a recording: files of messages, and no clouds or images."""
    names = [each.name.lower() for each in path.iterdir()]
    if not any(_is_named_so(name) for name in names):
        return False
    return "metadata.yaml" in names or not any(name.endswith(_OTHER_SCANS) for name in names)


def _is_named_so(name: str) -> bool:
    return name.removesuffix(".zstd").endswith(_SUFFIXES)


def open_container(path: str, *, skip_bad: bool, name: str | None = None) -> Container:
    """One file of messages.

    Args:
        path: the file.
        skip_bad: read what there is of a damaged file, in place of raising.
        name: what messages call it, where that is not its path.

    Raises:
        InputError: it is none, or it is damaged.
    """
    try:
        with Path(path).open("rb") as file:
            head = file.read(16)
    except OSError as error:
        raise InputError(f"{name or path}: cannot be read ({error.strerror})") from None
    for magic, kind in _MAGIC.items():
        if head.startswith(magic):
            return kind(path, skip_bad=skip_bad, name=name)
    raise InputError(f"{name or path}: no bag, SQLite file or MCAP (it starts with {head!r})")


def open_folder(name: str, *, skip_bad: bool) -> Folder:
    """The files of a folder: those that metadata.yaml lists, else all.

    Raises:
        InputError: one is missing or damaged, or of another kind than the rest.
    """
    folder = Path(name)
    said = _metadata(folder / "metadata.yaml", skip_bad=skip_bad)
    listed = said.get("relative_file_paths")
    if isinstance(listed, list):
        paths = [folder / Path(str(each)).name for each in listed]
        missing = [each.name for each in paths if not each.is_file()]
        if missing and not skip_bad:
            raise InputError(
                f"{name}: {', '.join(missing[:3])} is missing, which metadata.yaml lists: copy "
                "the recording again, or read the rest of it with --skip-bad (skip_bad=True)"
            )
        paths = [each for each in paths if each.is_file()]
    else:
        paths = sorted(each for each in folder.iterdir() if _is_named_so(each.name.lower()))
    kinds = {path.name.removesuffix(".zstd").rsplit(".", 1)[-1] for path in paths}
    if len(kinds) > 1:
        raise InputError(
            f"{name}: files of {' and '.join(sorted(kinds))} in one folder: leave one kind in it"
        )
    temporary = None
    files: list[Container] = []
    for path in paths:
        if path.suffix == ".zstd":
            temporary = temporary or TemporaryDirectory(prefix="oddsmap-")
            plain = _decompress(path, Path(temporary.name) / path.stem, skip_bad=skip_bad)
            files.append(open_container(str(plain), skip_bad=skip_bad, name=str(path)))
        else:
            files.append(open_container(str(path), skip_bad=skip_bad))
    if not files:
        raise InputError(f"{name}: none of the recording's files is there")
    if not isinstance(listed, list):
        files.sort(key=lambda file: file.span_ns or (1 << 63, 0))
    return Folder(
        files,
        str(said.get("compression_mode", "")).lower() == "message",
        said.get("message_count") if isinstance(said.get("message_count"), int) else None,
        _end_of(said),
        temporary,
    )


def _metadata(path: Path, *, skip_bad: bool) -> dict[str, Any]:
    """What metadata.yaml says; nothing where there is none."""
    import yaml

    if not path.is_file():
        return {}
    if path.stat().st_size > _LARGEST_METADATA:
        raise InputError(f"{path}: {megabytes(path.stat().st_size)} of metadata are none")
    try:
        advice = "repair or remove it"
        with decoding(path, "the metadata cannot be read", advice):
            said = yaml.safe_load(path.read_bytes())
            found = said["rosbag2_bagfile_information"]
            if not isinstance(found, dict):
                raise InputError(f"{path}: it lists {shown(found)} in place of files: {advice}")
    except InputError:
        if skip_bad:
            return {}
        raise
    mode, how = found.get("compression_mode"), found.get("compression_format")
    if mode and str(mode).lower() != "none" and how != "zstd":
        raise InputError(f"{path}: files compressed by {shown(how)} are not read")
    return found


def _end_of(said: dict[str, Any]) -> int | None:
    try:
        start = said["starting_time"]["nanoseconds_since_epoch"]
        return int(start) + int(said["duration"]["nanoseconds"])
    except (KeyError, TypeError, ValueError):
        return None


def _decompress(path: Path, target: Path, *, skip_bad: bool) -> Path:
    """A file as it was before it was compressed."""
    try:
        import zstandard
    except ImportError:
        raise InputError(f'{path}: zstd is read with pip install "oddsmap[ros]"') from None
    most = max(1 << 28, _MAX_RATIO * path.stat().st_size)
    with (
        path.open("rb") as file,
        target.open("wb") as out,
        zstandard.ZstdDecompressor().stream_reader(file, read_across_frames=True) as reader,
    ):
        try:
            while piece := reader.read(1 << 20):
                out.write(piece)
                if out.tell() > most:
                    raise InputError(
                        f"{path}: it holds more than {megabytes(most)}, as no recording does: "
                        "decompress it first if it is right"
                    )
        except zstandard.ZstdError as error:
            if not skip_bad:
                raise InputError(
                    f"{path}: damaged ({error}): copy the recording again, or read what there is "
                    "of it with --skip-bad (skip_bad=True)"
                ) from None
        if out.tell() == 0:
            raise InputError(f"{path}: nothing of it can be decompressed: copy the recording again")
    return target
