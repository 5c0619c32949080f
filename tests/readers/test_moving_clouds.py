# SPDX-License-Identifier: Apache-2.0
"""Folders of clouds whose points have times, with poses over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import Pose3, Scan, build_map, open_log
from oddsmap.errors import InputError
from oddsmap.readers.compression import open_source
from oddsmap.readers.pcd import read_pcd
from oddsmap.readers.ply import read_ply
from tests.kit import votes_of
from tests.readers.clouds import lzf_literals

MS = 10**6
START = 1_600_000_000 * 10**9
COUNT = 40


def pose_at(time_ns: int) -> Pose3:
    t = (time_ns - START) / 1e9
    yaw = 1.2 * t
    return Pose3.from_quaternion_xyzw(
        (2.0 * t, -t, 0.3), (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    )


def tum(every: int = 20 * MS, until: int = 900 * MS) -> str:
    rows = []
    for now in range(START, START + until, every):
        x, y, z = pose_at(now).translation.tolist()
        yaw = 1.2 * (now - START) / 1e9
        turn = f"0 0 {math.sin(yaw / 2)!r} {math.cos(yaw / 2)!r}"
        rows.append(f"{now // 10**9}.{now % 10**9:09d} {x!r} {y!r} {z!r} {turn}\n")
    return "".join(rows)


KINDS = {"u4": ("U", 4, "uint"), "f4": ("F", 4, "float"), "f8": ("F", 8, "double")}


def pcd(table: np.ndarray[Any, Any], encoding: str = "binary") -> bytes:
    names = table.dtype.names or ()
    kinds = [KINDS[table.dtype[name].str[1:]] for name in names]
    head = [
        "VERSION 0.7", f"FIELDS {' '.join(names)}", f"SIZE {' '.join(str(k[1]) for k in kinds)}",
        f"TYPE {' '.join(k[0] for k in kinds)}", f"COUNT {' '.join('1' for _ in kinds)}",
        f"WIDTH {len(table)}", "HEIGHT 1", f"POINTS {len(table)}", f"DATA {encoding}", "",
    ]  # fmt: skip
    if encoding == "ascii":
        return "\n".join([*head[:-1], *rows_of(table), ""]).encode()
    body = table.tobytes()
    if encoding == "binary_compressed":
        plain = b"".join(np.ascontiguousarray(table[name]).tobytes() for name in names)
        packed = lzf_literals(plain)
        sizes = np.array([len(packed), len(plain)], "<u4").tobytes()
        body = sizes + packed
    return "\n".join(head).encode() + body


def ply(table: np.ndarray[Any, Any], encoding: str = "binary_little_endian") -> bytes:
    names = table.dtype.names or ()
    lines = [f"property {KINDS[table.dtype[name].str[1:]][2]} {name}" for name in names]
    head = ["ply", f"format {encoding} 1.0", f"element vertex {len(table)}", *lines, "end_header"]
    if encoding == "ascii":
        return "\n".join([*head, *rows_of(table), ""]).encode()
    return ("\n".join(head) + "\n").encode() + table.tobytes()


def rows_of(table: np.ndarray[Any, Any]) -> list[str]:
    return [" ".join(repr(value.item()) for value in row) for row in table]


def cloud(seed: int, kind: str = "u4", name: str = "t", stamp: int = 0) -> np.ndarray[Any, Any]:
    """Points over 78 ms, in nanoseconds or seconds after the stamp, or in seconds since 1970."""
    rng = np.random.default_rng(seed)
    fields = [("x", "<f8"), ("intensity", "<f4"), ("y", "<f8"), (name, f"<{kind}"), ("z", "<f8")]
    table = np.zeros(COUNT, fields)
    for axis in "xyz":
        table[axis] = rng.uniform(-5, 5, COUNT)
    after = rng.permutation(COUNT) * 2 * MS
    table[name] = after if kind == "u4" else (stamp + after) / 1e9
    return table


def write(folder: Path, suffix: str, files: Sequence[bytes], poses: str) -> Path:
    folder.mkdir()
    for k, content in enumerate(files):
        now = START + (50 + 100 * k) * MS
        (folder / f"{now // 10**9}.{now % 10**9:09d}.{suffix}").write_bytes(content)
    (folder / "poses.txt").write_text(poses)
    return folder


@pytest.mark.parametrize("writes", ["pcd", "ply"])
@pytest.mark.parametrize("encoding", ["binary", "ascii", "binary_compressed"])
@pytest.mark.parametrize(
    ("kind", "name", "since"), [("u4", "t", 0), ("f4", "time", 0), ("f8", "timestamp", START)]
)
def test_points_start_where_the_sensor_was(
    writes: str, encoding: str, kind: str, name: str, since: int, tmp_path: Path
) -> None:
    if writes == "ply" and encoding == "binary_compressed":
        encoding = "binary_little_endian"
    make: Any = pcd if writes == "pcd" else ply
    encoding = "binary_little_endian" if (writes, encoding) == ("ply", "binary") else encoding
    stamps = [START + (50 + 100 * k) * MS for k in range(3)]
    tables = [cloud(k, kind, name, stamp if since else 0) for k, stamp in enumerate(stamps)]
    files = [make(table, encoding) for table in tables]
    log = open_log(write(tmp_path / "run", writes, files, tum()))
    got = build_map(log, 0.2, votes="beam")
    assert "log.deskewed" in [note.code for note in log.notes]
    assert log.skipped == {}
    beams = []
    for table, stamp in zip(tables, stamps, strict=True):
        for row in table:
            time = int(row[name]) if kind == "u4" else round((row[name] - (stamp / 1e9 if since
                else 0)) * 1e9)  # fmt: skip
            point = np.array([[row["x"], row["y"], row["z"]]])
            beams.append(Scan.from_points(pose_at(stamp + time), point))
    want = votes_of(build_map(beams, 0.2, votes="beam"))
    # Poses are of a file with 9 digits and turn between samples of it: a cell or two differ.
    have = votes_of(got)
    differ = [cell for cell in want.keys() | have.keys()
              if want.get(cell) != have.get(cell)]  # fmt: skip
    assert len(differ) <= len(want) // 100
    at_once = votes_of(build_map(open_log(tmp_path / "run", deskew=False), 0.2, votes="beam"))
    assert len([cell for cell in want if want[cell] != at_once.get(cell)]) > len(want) // 4


def test_times_are_read_by_name_and_type(tmp_path: Path) -> None:
    table = cloud(0)
    for name, content, read in (("a.pcd", pcd(table), read_pcd), ("a.ply", ply(table), read_ply)):
        (tmp_path / name).write_bytes(content)
        times = read(open_source(tmp_path / name)).times
        assert times is not None
        np.testing.assert_array_equal(times, table["t"])
    (tmp_path / "b.pcd").write_bytes(pcd(table).replace(b"SIZE 8 4 8 4 8", b"SIZE 8 4 8 2 8"))
    assert b"SIZE 8 4 8 2 8" in (tmp_path / "b.pcd").read_bytes()


def test_points_without_a_pose_are_left_out_and_counted_once(tmp_path: Path) -> None:
    files = [pcd(cloud(k)) for k in range(3)]
    folder = write(tmp_path / "run", "pcd", files, tum(until=281 * MS))  # the last scan: to 328 ms
    log = open_log(folder)
    for _ in range(2):
        assert [scan.size for scan in log] == [40, 40, 16]
        assert log.skipped == {"beam.no_pose": 24}
    assert log.notes[-1].code == "beam.no_pose"
    table = cloud(0)
    table["t"] += np.uint32(85 * MS)  # no pose for any of them, but one for their stamp
    late = write(tmp_path / "late", "pcd", [pcd(table)] * 2, tum(until=161 * MS))
    log = open_log(late, deskew=True)
    assert [scan.size for scan in log] == [13, 0]
    assert log.skipped == {"beam.no_pose": 67}


def test_one_pose_for_each_scan_is_enough(tmp_path: Path) -> None:
    files = [pcd(cloud(k)) for k in range(4)]
    folder = write(tmp_path / "run", "pcd", files, tum(every=50 * MS))
    stamps = [START / 1e9 + 0.05 + 0.1 * k for k in range(4)]
    (folder / "times.txt").write_text("".join(f"{stamp:.9f}\n" for stamp in stamps))
    rows = [pose_at(START + (50 + 100 * k) * MS) for k in range(4)]
    (folder / "poses.txt").write_text(
        "".join(
            " ".join(repr(float(v)) for v in np.c_[p.rotation, p.translation].ravel()) + "\n"
            for p in rows
        )
    )
    log = open_log(folder)
    assert log.notes[-1].code == "log.deskewed"
    assert "poses come every 100 ms" in log.notes[-1]
    assert [scan.size for scan in log] == [40, 40, 40, 1]


def test_what_cannot_be_deskewed(tmp_path: Path) -> None:
    plain = np.zeros(3, [("x", "<f8"), ("y", "<f8"), ("z", "<f8")])
    without = write(tmp_path / "without", "pcd", [pcd(plain)] * 2, tum())
    assert [note.code for note in open_log(without).notes] == []
    with pytest.raises(InputError, match="nothing says when each beam was taken"):
        open_log(without, deskew=True)
    sparse = write(tmp_path / "sparse", "pcd", [pcd(cloud(0))] * 2, tum(every=150 * MS))
    log = open_log(sparse, tolerance_s=0.2)
    assert [note.code for note in log.notes] == ["log.not_deskewed"]
    assert [scan.beam_origins for scan in log] == [None, None]
    with pytest.raises(InputError, match="leave `deskew` out, or points_in"):
        open_log(without, deskew=True, points_in="map")
    (without / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 2)
    for k, path in enumerate(sorted(without.glob("*.pcd"))):
        path.rename(without / f"scan{k}.pcd")
    with pytest.raises(InputError, match="deskewing needs the times of scans and poses"):
        open_log(without, deskew=True)
