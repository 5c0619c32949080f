# SPDX-License-Identifier: Apache-2.0
"""Writers of small E57 and PTX files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from oddsmap.array_types import FloatArray, IntArray
from oddsmap.poses.pose import Pose3, quaternion_xyzw

__all__ = ["Setup", "e57_file", "ptx_text"]


@dataclass(frozen=True, eq=False)
class Setup:
    """A scan of an E57 file; without a pose, or with parts of one."""

    points: FloatArray
    pose: Pose3 | None
    parts: tuple[str, ...] = ("rotation", "translation")
    invalid: IntArray | None = None
    spherical: bool = False


def e57_file(path: Path, setups: Sequence[Setup]) -> Path:
    """Write an E57 file with libE57Format."""
    import pye57

    with pye57.E57(str(path), mode="w") as file:
        for setup in setups:
            _add(pye57.libe57, file, setup)
    return path


def _add(e57: Any, file: Any, setup: Setup) -> None:
    image = file.image_file
    scan = e57.StructureNode(image)
    scan.set("guid", e57.StringNode(image, "{0}"))
    if setup.pose is not None:
        pose = e57.StructureNode(image)
        x, y, z, w = quaternion_xyzw(setup.pose.rotation)
        if "rotation" in setup.parts:
            pose.set("rotation", _numbers(e57, image, "wxyz", (w, x, y, z)))
        if "translation" in setup.parts:
            pose.set("translation", _numbers(e57, image, "xyz", setup.pose.translation.tolist()))
        scan.set("pose", pose)
    names = ["cartesianX", "cartesianY", "cartesianZ"]
    columns = list(setup.points.T)
    if setup.spherical:
        reach = np.linalg.norm(setup.points, axis=1)
        x, y, z = setup.points.T
        names = ["sphericalRange", "sphericalAzimuth", "sphericalElevation"]
        columns = [reach, np.arctan2(y, x), np.arcsin(z / np.maximum(reach, 1e-9))]
    prototype = e57.StructureNode(image)
    for name in names:
        prototype.set(name, e57.FloatNode(image, 0.0))
    if setup.invalid is not None:
        names.append("cartesianInvalidState")
        columns.append(setup.invalid)
        prototype.set("cartesianInvalidState", e57.IntegerNode(image, 0, 0, 2))
    points = e57.CompressedVectorNode(image, prototype, e57.VectorNode(image, True))
    scan.set("points", points)
    file.data3d.append(scan)
    arrays, buffers = file.make_buffers(names, len(setup.points))
    for name, column in zip(names, columns, strict=True):
        arrays[name][:] = column
    writer = points.writer(buffers)
    writer.write(len(setup.points))
    writer.close()


def _numbers(e57: Any, image: Any, names: str, values: Sequence[float]) -> Any:
    node = e57.StructureNode(image)
    for name, value in zip(names, values, strict=True):
        node.set(name, e57.FloatNode(image, value))
    return node


def ptx_text(
    points: FloatArray, pose: Pose3, tail: str = " 0.5", place: FloatArray | None = None
) -> str:
    """One setup of PTX, in two columns; the matrix is for points as rows."""
    place = pose.translation if place is None else place
    matrix = np.eye(4)
    matrix[:3, :3], matrix[3, :3] = pose.rotation.T, pose.translation
    rows = [place, *pose.rotation.T, *np.round(matrix, 12)]
    head = [str(2), str(len(points) // 2), *(" ".join(f"{v:.12g}" for v in row) for row in rows)]
    body = [" ".join(f"{v:.12g}" for v in point) + tail for point in points]
    return "\n".join([*head, *body, ""])
