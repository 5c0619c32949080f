# SPDX-License-Identifier: Apache-2.0
"""A drive with all that a recording can get wrong, in files of several chunks each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader

from tests.recordings.bags import Messages, Said
from tests.recordings.plain_mcap import PlainMcap

__all__ = ["FILES", "troubled_drive", "write_troubled"]

FILES = ("bag", "sqlite3", "mcap", "mcap in chunks")
SECOND = 10**9
START = 1_700_000_000 * SECOND
SCANS = 104
CHUNK_BYTES = 6000


def troubled_drive(messages: Messages) -> list[Said]:
    """A laser in front and one behind, of other limits; what is wrong with which is listed below.

    0 to 2 and 100 on: no transforms; 9: no laser's; 13: another range_max; 31: it leans, between
    two scans that are looked at before mapping; 40 and 41: the same scan twice; 50 and 53: each in
    the place of the other; both lasers in turns that differ.
    """
    rng = np.random.default_rng(0)
    said: list[Said] = []
    for name, place, yaw in (("laser", (0.2, 0.0, 0.3), 0.0), ("rear", (-0.2, 0.0, 0.3), 3.0)):
        fixed = messages.transform(START, "base", name, place, yaw)
        said.append(("/tf_static", START, messages.tf(fixed)))
    scans: list[list[Said]] = []
    for k in range(SCANS):
        now = START + k * SECOND // 10
        if 3 <= k < 100:
            moved = messages.transform(now, "map", "base", (0.05 * k, 0.01 * k, 0.0), 0.02 * k)
            if k == 31:
                moved.transform.rotation = messages.make(
                    "geometry_msgs/Quaternion", 0.1, 0.0, 0.0, 0.995
                )
            said.append(("/tf", now, messages.tf(moved)))
        front = messages.laser(now, "laser", rng.uniform(3.0, 5.0, 40), 0.0, 0.1, 1e-4)
        if k == 9:
            front.angle_increment = float("nan")
        if k == 13:
            front.range_max = 25.0
        own = [("/scan", now, front)]
        for part in range(k % 3):
            rear = messages.laser(now + part, "rear", rng.uniform(0.6, 4.9, 20))
            rear.range_max = 5.0
            own.append(("/rear", now, rear))
        scans.append(own)
    scans[41] = scans[40]
    scans[50], scans[53] = scans[53], scans[50]
    moves = iter(said[2:])
    mixed = said[:2]
    for k, own in enumerate(scans):
        mixed += [next(moves)] if 3 <= k < 100 else []
        mixed += own
    return mixed


def write_troubled(kind: str, folder: Path, *, spoilt: int = -1) -> Path:
    """The drive in one of `FILES`; one of its messages may be cut off."""
    messages = Messages(kind.split()[0])
    said = troubled_drive(messages)
    path = messages.write(folder / "run", said, chunk_bytes=CHUNK_BYTES, spoilt=spoilt)
    if kind != "mcap in chunks":
        return path
    packed = folder / "packed.mcap"
    out, known = PlainMcap(packed, chunk_size=CHUNK_BYTES), set[str]()
    with next(path.glob("*.mcap")).open("rb") as file:
        found: Any = make_reader(file).iter_messages(log_time_order=False)
        for schema, channel, message in found:
            if channel.topic not in known:
                known.add(channel.topic)
                out.channel(channel.topic, schema.name, "cdr", schema.encoding, schema.data)
            out.write(channel.topic, message.log_time, message.data)
    out.close()
    return packed
