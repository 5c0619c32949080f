# SPDX-License-Identifier: Apache-2.0
"""Writers of small files in the formats of point clouds, written from their descriptions."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

Points = npt.NDArray[np.float64]


def lzf_literals(data: bytes) -> bytes:
    """LZF in runs of literals, which is legal and compresses nothing."""
    runs = [data[i : i + 32] for i in range(0, len(data), 32)]
    return b"".join(bytes([len(run) - 1]) + run for run in runs)


def pcd_bytes(
    points: Points,
    encoding: str = "binary",
    *,
    fields: Sequence[tuple[str, str, int, int]] = (
        ("x", "F", 4, 1),
        ("y", "F", 4, 1),
        ("z", "F", 4, 1),
    ),
    viewpoint: str | None = "0 0 0 1 0 0 0",
    promised: int | None = None,
    newline: str = "\n",
) -> bytes:
    """A PCD file; fields other than x, y and z hold the number 7."""
    n = len(points) if promised is None else promised
    head = ["# .PCD v0.7 - Point Cloud Data file format", "VERSION 0.7"]
    for i, name in enumerate(("FIELDS", "TYPE", "SIZE", "COUNT")):
        head.append(f"{name} " + " ".join(str(entry[i]) for entry in fields))
    head += [f"WIDTH {n}", "HEIGHT 1"]
    head += [] if viewpoint is None else [f"VIEWPOINT {viewpoint}"]
    head += [f"POINTS {n}", f"DATA {encoding}"]
    columns: list[npt.NDArray[Any]] = []
    for name, kind, size, count in fields:
        dtype = f"<{kind.lower()}{size}"
        if name in "xyz":
            columns.append(points[:, ["xyz".index(name)]].astype(dtype))
        else:
            columns.append(np.full((len(points), count), 7).astype(dtype))
    if encoding == "ascii":
        rows = (
            " ".join(repr(v.item()) for column in columns for v in column[i])
            for i in range(len(points))
        )
        body = "".join(row + newline for row in rows).encode()
    elif encoding == "binary":
        body = b"".join(column[i].tobytes() for i in range(len(points)) for column in columns)
    else:
        plain = b"".join(column.tobytes() for column in columns)
        packed = lzf_literals(plain)
        body = struct.pack("<II", len(packed), len(plain)) + packed
    return newline.join([*head, ""]).encode() + body


def ply_bytes(
    points: Points, encoding: str = "binary_little_endian", *, promised: int | None = None
) -> bytes:
    """A PLY file: an element before the vertices, red x y z nx as properties, and faces."""
    n = len(points) if promised is None else promised
    head = f"""ply
format {encoding} 1.0
comment element vertex 5 is not meant
element camera 2
property double focus
element vertex {n}
property uchar red
property float x
property double y
property float z
property short nx
element face 3
property list uchar int vertex_indices
end_header
"""
    order = ">" if "big" in encoding else "<"
    if encoding == "ascii":
        body = "1.5\n2.5\n"
        body += "".join(f"200 {x!r} {y!r} {z!r} -3\n" for x, y, z in points.tolist())
        return (head + body + "3 0 1 2\n" * 3).encode()
    cameras = struct.pack(f"{order}2d", 1.5, 2.5)
    vertices = b"".join(struct.pack(f"{order}Bfdfh", 200, *p, -3) for p in points.tolist())
    return head.encode() + cameras + vertices + struct.pack(f"{order}B3i", 3, 0, 1, 2) * 3


def graph_bytes(
    scans: Sequence[tuple[Points, Sequence[float]]] = ((np.ones((2, 3)), (1, 2, 3, 1, 0, 0, 0)),),
    edges: int = 0,
) -> bytes:
    """An OctoMap scan graph of clouds and poses x y z qw qx qy qz."""
    out = struct.pack("<I", len(scans))
    for i, (points, pose) in enumerate(scans):
        out += struct.pack("<I", len(points))
        out += b"".join(struct.pack("<i3d", 3, *p) for p in points.tolist())
        out += struct.pack("<i3di4dI", 3, *pose[:3], 4, *pose[3:], i)
    edge = struct.pack("<II", 0, 0) + struct.pack("<i3di4d", 3, 0, 0, 0, 4, 1, 0, 0, 0)
    return out + struct.pack("<I", edges) + (edge + struct.pack("<d", 1.0)) * edges


def end_points(scan: Any) -> Points:
    """The points of a scan in the sensor frame."""
    return np.asarray(scan.directions * scan.ranges[:, None])
