# SPDX-License-Identifier: Apache-2.0
"""Small recordings to damage, one of each kind of container."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType
from rosbags.rosbag1 import Writer as Writer1

from tests.recordings.bags import Messages, Said
from tests.recordings.plain_mcap import write_json

__all__ = ["recording_bytes"]

_START = 1_700_000_000 * 10**9


def recording_bytes(kind: str) -> bytes:
    """A recording of a laser that moves: "bag", "bag-lz4", "sqlite3", "mcap" or "mcap-json"."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if kind == "mcap-json":
            path = write_json(
                folder / "a.mcap", _json(), compression=CompressionType.NONE, crcs=False
            )
        elif kind == "bag-lz4":
            path = _bag(Messages("bag"), folder / "a.bag")
        else:
            messages = Messages(kind)
            path = messages.write(folder / "a", _said(messages))
        file = path if path.is_file() else next(path.glob("a.*"))
        return file.read_bytes()


def _said(messages: Messages) -> list[Said]:
    said: list[Said] = []
    for k in range(3):
        now = _START + k * 10**8
        moved = messages.transform(now, "map", "laser", (0.1 * k, 0.0, 0.0), 0.1 * k)
        said.append(("/tf", now, messages.tf(moved)))
        said.append(("/scan", now, messages.laser(now, "laser", np.full(12, 2.0 + 0.1 * k))))
    return said


def _bag(messages: Messages, path: Path) -> Path:
    writer = Writer1(path)
    writer.set_compression(Writer1.CompressionFormat.LZ4)
    with writer:
        topics: dict[str, Any] = {}
        for topic, now, message in _said(messages):
            kind = message.__msgtype__
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=messages.store)
            writer.write(topics[topic], now, messages.store.serialize_ros1(message, kind))
    return path


def _json() -> list[tuple[str, int, str, Any]]:
    said: list[tuple[str, int, str, Any]] = []
    for k in range(3):
        now = _START + k * 10**8
        stamp = {"sec": now // 10**9, "nsec": now % 10**9}
        moved = {
            "timestamp": stamp,
            "parent_frame_id": "map",
            "child_frame_id": "laser",
            "translation": {"x": 0.1 * k, "y": 0.0, "z": 0.0},
            "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        }
        scan = {
            "timestamp": stamp,
            "frame_id": "laser",
            "start_angle": 0.0,
            "end_angle": 1.1,
            "ranges": [2.0 + 0.1 * k] * 12,
        }
        said.append(("/tf", now, "foxglove.FrameTransform", moved))
        said.append(("/scan", now, "foxglove.LaserScan", scan))
    return said
