# SPDX-License-Identifier: Apache-2.0
"""OctoMap scan graphs (`.graph`): clouds in the sensor frame, each with its pose.

All numbers are little-endian; coordinates are doubles that OctoMap has rounded to floats.

    u32 nodes, then for each node:
        u32 points, then for each point: i32 3, f64 x y z
        i32 3, f64 x y z            position
        i32 4, f64 w x y z          rotation, a unit quaternion
        u32 id
    u32 edges, then for each edge: u32, u32, a pose as above, f64 weight

Edges are constraints between poses for SLAM; they are not read.

Source: OctoMap 1.10, ScanGraph::writeBinary, Pointcloud::writeBinary, Pose6D::writeBinary.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.readers.compression import TRUNCATED, Source
from oddsmap.readers.options import ReadOptions
from oddsmap.scans.lazy_log import LazyLog
from oddsmap.scans.note import Note
from oddsmap.scans.scan import Scan

__all__ = ["matches", "open_octomap_graph"]

_POINT = np.dtype([("size", "<i4"), ("xyz", "<f8", 3)])
_NODE_END = struct.Struct("<i3di4dI")


def matches(head: bytes) -> bool:
    """Whether a file that starts like this is a scan graph, by the sizes before its vectors."""
    if len(head) < 40:
        return False
    nodes, points, first = struct.unpack_from("<IIi", head)
    (second,) = struct.unpack_from("<i", head, 36)
    return bool(nodes > 0 and first == 3 and second == (3 if points else 4))


@dataclass(frozen=True, slots=True)
class _Node:
    start: int
    point_count: int


def open_octomap_graph(source: Source, options: ReadOptions) -> LazyLog:
    """Open a scan graph; its clouds are decoded one by one.

    Raises:
        InputError: the file is truncated or corrupt (with `skip_bad`, the nodes before the damage
            are used), or has no scans.
    """
    options.refuse(source.path, "an OctoMap scan graph", "poses", "times", "camera")
    options.refuse(
        source.path,
        "an OctoMap scan graph",
        "points_in",
        "origin",
        "columns",
        "depth_scale",
        "deskew",
    )
    skipped, notes = source.initial_skipped(), source.initial_notes()
    (promised,) = struct.unpack_from("<I", source.content)
    nodes, end = _find_nodes(source.content, promised)
    if len(nodes) < promised:
        if not options.skip_bad or not nodes:
            raise InputError(
                f"{source.path}: the header promises {promised} scans, the file holds "
                f"{len(nodes)} whole ones: copy the file again"
            )
        skipped[TRUNCATED] = 1
        notes.append(
            Note(
                f"{promised} scans are promised, {len(nodes)} whole ones were found and used",
                code="container.truncated",
                severity="warning",
            )
        )
    elif len(source.content) >= end + 4 and (
        edges := struct.unpack_from("<I", source.content, end)[0]
    ):
        notes.append(
            Note(f"{edges} edges (constraints between poses) were not read", code="graph.edges")
        )

    def read_scan(i: int) -> Scan:
        return _read_node(source, i, nodes[i], options)

    return LazyLog(
        path=source.path,
        format="OctoMap scan graph",
        scan_count=len(nodes),
        read_scan=read_scan,
        skip_bad=options.skip_bad,
        opening_notes=tuple(notes),
        opening_skipped=skipped,
    )


def _find_nodes(content: bytes, promised: int) -> tuple[list[_Node], int]:
    """Where each whole node is, and the end of the last one."""
    nodes: list[_Node] = []
    position = 4
    while len(nodes) < promised and position + 4 <= len(content):
        (count,) = struct.unpack_from("<I", content, position)
        end = position + 4 + count * _POINT.itemsize + _NODE_END.size
        if end > len(content):
            break
        nodes.append(_Node(position + 4, count))
        position = end
    return nodes, position


def _read_node(source: Source, i: int, node: _Node, options: ReadOptions) -> Scan:
    where = f"{source.path}: scan {i + 1}"
    points = np.frombuffer(source.content, _POINT, node.point_count, node.start)
    end = _NODE_END.unpack_from(source.content, node.start + points.nbytes)
    three, x, y, z, four, qw, qx, qy, qz, _ = end
    if three != 3 or four != 4 or (points["size"] != 3).any():
        raise InputError(f"{where}: corrupt scan graph: copy the file again")
    if not np.isfinite(end).all():
        raise InputError(f"{where}: its pose is not finite: take the scan out")
    try:
        map_from_body = Pose3.from_quaternion_xyzw((x, y, z), (qx, qy, qz, qw))
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    return Scan.from_points(options.sensor_pose(map_from_body), points["xyz"])
