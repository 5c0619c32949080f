# SPDX-License-Identifier: Apache-2.0
"""How fast clouds are read from recordings, next to rosbags alone; and in how much memory.

python benchmarks/recordings.py                    # 200 MB and a tenth of it, some minutes
python benchmarks/recordings.py --clouds 100 --json result.json

Made recordings of PointCloud2 (65,536 points of x, y, z, intensity: 1 MB each) with a pose for each
on /tf. Both read the same file in turns; the answers are compared before any time is taken. Times
are of the processor. Memory is the peak of a process that maps the file at 1 m, above that of one
that maps a file of a tenth.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import numpy as np
from rosbags.highlevel import AnyReader

from oddsmap.recordings.ros_recording import open_ros_recording
from tests.recordings.bags import Messages, Said

KINDS = {"bag": "bag", "bag, bz2": "bag", "bag, lz4": "bag", "sqlite3": "sqlite3", "mcap": "mcap"}
KINDS |= {"mcap, zstd": "mcap"}
POINTS = 65_536
ROUNDS = 3
START = 1_700_000_000 * 10**9


def said(messages: Messages, count: int) -> Iterator[Said]:
    """Clouds of a hall of some 20 m, and where the robot was."""
    rng = np.random.default_rng(1)
    table = np.zeros(POINTS, [(name, "<f4") for name in ("x", "y", "z", "intensity")])
    angles = np.linspace(0.0, 2 * np.pi, POINTS, dtype=np.float32)
    table["intensity"] = rng.integers(0, 255, POINTS)
    for k in range(count):
        now = START + k * 10**8
        reach = rng.uniform(9.9, 10.1, POINTS)
        table["x"], table["y"] = reach * np.cos(angles), reach * np.sin(angles)
        table["z"] = rng.uniform(-1.0, 1.0, POINTS)
        moved = messages.transform(now, "map", "lidar", (0.01 * k, 0.0, 0.0), 0.001 * k)
        yield "/tf", now, messages.tf(moved)
        yield "/points", now, messages.cloud(now, "lidar", table)


def write(kind: str, folder: Path, count: int) -> Path:
    """A recording, compressed as its name says."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2

    messages = Messages(KINDS[kind])
    path = folder / f"{kind.replace(', ', '_')}_{count}"
    writer: Any
    if messages.first:
        path = path.with_suffix(".bag")
        writer = Writer1(path)
        if "," in kind:
            writer.set_compression(Writer1.CompressionFormat[kind.split(", ")[1].upper()])
        serialize = messages.store.serialize_ros1
    else:
        writer = Writer2(path, version=9, storage_plugin=StoragePlugin[KINDS[kind].upper()])
        if "," in kind:
            writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        serialize = messages.store.serialize_cdr
    with writer:
        topics: dict[str, Any] = {}
        for topic, now, message in said(messages, count):
            name = message.__msgtype__
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, name, typestore=messages.store)
            writer.write(topics[topic], now, serialize(message, name))
    return path


def by_rosbags(path: Path) -> Iterator[tuple[str, int, Any]]:
    """Messages as rosbags alone gives them."""
    with AnyReader([path]) as reader:
        for connection, now, raw in reader.messages():
            yield connection.topic, now, reader.deserialize(raw, connection.msgtype)


def by_oddsmap(path: Path) -> Iterator[tuple[str, int, Any]]:
    """The same messages."""
    recording = open_ros_recording(str(path))
    for message in recording.messages(recording.topics):
        yield message.topic, message.log_ns, message.data


def check(path: Path) -> int:
    """Compare all messages; returns how many there are."""
    count = 0
    for one, other in zip(by_rosbags(path), by_oddsmap(path), strict=True):
        assert one[:2] == other[:2]
        if one[0] == "/points":
            assert one[2].data.tobytes() == other[2].data.tobytes()
        else:
            assert repr(one[2]) == repr(other[2])
        count += 1
    return count


def seconds(read: Any, path: Path) -> float:
    """Time of the processor that reading all messages takes."""
    started = time.process_time()
    for _ in read(path):
        pass
    return time.process_time() - started


def peak(path: Path) -> float:
    """The most memory that a process takes that maps a recording [MB]."""
    program = (
        "import sys, resource, oddsmap\n"
        "log = oddsmap.open_log(sys.argv[1])\n"
        "oddsmap.build_map(log, 1.0, threads=2)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, str(path)],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONPATH": str(ROOT / "src"), "PATH": "/usr/bin:/bin"},
    )
    return int(done.stdout) / 1e3


def main() -> None:
    """Write, check, measure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--clouds", type=int, default=200)
    parser.add_argument("--kind", action="append", choices=list(KINDS))
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    found: dict[str, dict[str, float]] = {}
    print(
        f"{'':12} {'MB':>6} {'rosbags s':>10} {'oddsmap s':>10} {'ratio':>6} {'MB':>6} {'MB/10':>6}"
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind in options.kind or KINDS:
            large = write(kind, folder, options.clouds)
            small = write(kind, folder, max(2, options.clouds // 10))
            check(small)
            times: dict[Any, list[float]] = {by_rosbags: [], by_oddsmap: []}
            for _ in range(ROUNDS):
                for read, taken in times.items():
                    taken.append(seconds(read, large))
            theirs, ours = min(times[by_rosbags]), min(times[by_oddsmap])
            files = [large] if large.is_file() else list(large.iterdir())
            size = sum(file.stat().st_size for file in files) / 1e6
            row = {"size": size, "rosbags": theirs, "oddsmap": ours, "ratio": theirs / ours}
            row |= {"peak": peak(large), "peak of a tenth": peak(small)}
            found[kind] = row
            print(
                f"{kind:12} {size:6.0f} {theirs:10.2f} {ours:10.2f} {row['ratio']:6.2f} "
                f"{row['peak']:6.0f} {row['peak of a tenth']:6.0f}",
                flush=True,
            )
            for file in files:
                file.unlink()
    if options.json:
        options.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
