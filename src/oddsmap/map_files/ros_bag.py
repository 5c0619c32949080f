# SPDX-License-Identifier: Apache-2.0
"""Messages of a map in a file: MCAP, the folder of a ROS 2 bag, or a ROS 1 bag.

All topics are latched: who subscribes after the map was played gets it, too (in ROS 2 with the
durability "transient local", which RViz has for maps).

Source: the package rosbags, https://ternaris.gitlab.io/rosbags/
"""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from oddsmap.atomic_write import atomic_output, check_output, why_no_file
from oddsmap.errors import ConfigError
from oddsmap.map_files.ros_messages import MapHeader, RosMessages, TopicMessage

if TYPE_CHECKING:
    from rosbags.interfaces import Qos

__all__ = ["BagKind", "check_bag_output", "kind_of_bag", "save_bag"]

BagKind = Literal["mcap", "ros2-bag", "bag"]
"""A file of ROS 2, a folder of ROS 2, a file of ROS 1."""

_METADATA = "metadata.yaml"
# Stands in the metadata of our bags: --force replaces no recording of anyone's robot.
_OURS = ("made_by", "oddsmap export")
_VERSION: Literal[8] = 8  # of rosbag2's metadata: what Humble to Rolling read


def save_bag(
    make: Callable[[RosMessages], Iterable[TopicMessage]],
    path: str | Path,
    kind: BagKind,
    *,
    header: MapHeader | None = None,
    force: bool = False,
) -> Path:
    """Write messages that are made one after the other.

    Args:
        make: gives them.
        path: the file or folder to write.
        kind: which: "mcap" needs nothing beside it, "ros2-bag" is a folder with metadata.yaml and
            an SQLite file, "bag" is ROS 1.
        header: frame and time of the map; by default "map" and 0.
        force: True where an existing output may be replaced; of folders only bags of maps.

    Returns:
        The path written.

    Raises:
        ConfigError: rosbags is not installed, or the header cannot be written.
        OutputError: the output exists already or cannot be written.
    """
    path = Path(path)
    header = header or MapHeader()
    messages = RosMessages(1 if kind == "bag" else 2, header)
    check_bag_output(path, kind, force=force)
    why_not = _why_no_bag if kind == "ros2-bag" else why_no_file
    with atomic_output(path, force=force, why_not=why_not) as part:
        if kind == "bag":
            _write_first(make(messages), messages, part, header.stamp_ns)
        elif kind == "ros2-bag":
            _write_second(make(messages), messages, part, header.stamp_ns, mcap=False)
        else:
            # The file of a bag of this name, which needs no metadata.yaml beside it.
            folder = part.parent / "bag" / part.stem
            folder.parent.mkdir()
            _write_second(make(messages), messages, folder, header.stamp_ns, mcap=True)
            (folder / f"{folder.name}.mcap").replace(part)
            shutil.rmtree(folder.parent)
    return path


def kind_of_bag(path: Path) -> BagKind:
    """What a name says: `.mcap`, `.bag`, or without a suffix the folder of ROS 2.

    Raises:
        ConfigError: another suffix.
    """
    kinds: dict[str, BagKind] = {".mcap": "mcap", ".bag": "bag", "": "ros2-bag"}
    if path.suffix.lower() not in kinds:
        raise ConfigError(
            f"{path}: messages of ROS are named .mcap, .bag (ROS 1), or without a suffix (a folder)"
        )
    return kinds[path.suffix.lower()]


def check_bag_output(path: Path, kind: BagKind, *, force: bool) -> None:
    """As `check_output`, for a kind of bag."""
    why_not = _why_no_bag if kind == "ros2-bag" else why_no_file
    check_output(path, force=force, why_not=why_not)


def _write_second(
    made: Iterable[TopicMessage], messages: RosMessages, path: Path, stamp_ns: int, *, mcap: bool
) -> None:
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    writer = Writer(path, version=_VERSION, storage_plugin=plugin)
    writer.set_custom_data(*_OURS)
    if mcap:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    try:
        with writer:
            for each in made:
                connection = writer.add_connection(
                    each.topic, each.type, typestore=messages.store,
                    offered_qos_profiles=[_latched()],
                )  # fmt: skip
                writer.write(connection, stamp_ns, messages.serialized(each))
    except sqlite3.Error as error:  # the disk is full
        raise OSError(str(error)) from None


def _write_first(
    made: Iterable[TopicMessage], messages: RosMessages, path: Path, stamp_ns: int
) -> None:
    from rosbags.rosbag1 import Writer

    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat.LZ4)
    with writer:
        for each in made:
            connection = writer.add_connection(
                each.topic, each.type, typestore=messages.store, latching=1
            )
            writer.write(connection, stamp_ns, messages.serialized(each))


def _latched() -> Qos:
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    default = QosTime(0, 0)
    return Qos(
        QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL, default,
        default, QosLiveliness.AUTOMATIC, default, False,
    )  # fmt: skip


def _why_no_bag(path: Path) -> str | None:
    """Why a folder is no bag that was made of a map; None: it is one, or empty."""
    if not path.is_dir():
        return "is no folder, and a ROS 2 bag is one"
    names = {entry.name for entry in path.iterdir()}
    if not names:
        return None
    try:
        said = (path / _METADATA).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return "is a folder, and no bag that oddsmap made"
    if f"{_OURS[0]}: {_OURS[1]}" not in said or names != {_METADATA, f"{path.name}.db3"}:
        return "is a folder, and no bag that oddsmap made"
    return None
