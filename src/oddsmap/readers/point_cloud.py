# SPDX-License-Identifier: Apache-2.0
"""What a point cloud file holds, and the checks that its formats share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from oddsmap.array_types import FloatArray
from oddsmap.errors import InputError
from oddsmap.scans.note import Note

__all__ = ["Cloud", "check_size", "pick_columns", "unpack_column", "unpack_points"]


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """Points in the sensor frame.

    Args:
        points: points [m], shape (n, 3); those that are not finite are kept, to be counted.
        viewpoint: PCD's sensor pose, x y z qw qx qy qz, as it stands in the file; None where the
            format has none.
        notes: what is odd about the file.
        times: when each point was taken, in the unit and from the time that the file has them,
            shape (n,); None where it has none.
    """

    points: FloatArray
    viewpoint: tuple[float, ...] | None = None
    notes: tuple[Note, ...] = ()
    times: npt.NDArray[Any] | None = None


def check_size(path: str, promised: int, held: int) -> None:
    """Raise InputError where a header's count of points is not what the file holds."""
    if promised != held:
        raise InputError(
            f"{path}: the header promises {promised} points, the file holds {held}: "
            "copy or write the file again"
        )


def unpack_points(
    path: str, body: bytes, count: int, offsets: list[int], types: list[str], stride: int
) -> FloatArray:
    """Take x, y and z out of binary records.

    Args:
        path: what messages start with.
        body: the records, `stride` bytes each; less than one record may follow them.
        count: how many records the header promises.
        offsets: first byte of x, y and z in a record.
        types: NumPy type of each, byte order included.
        stride: bytes of a record.
    """
    check_size(path, count, len(body) // stride)
    if count == 0:  # then nothing bounds the length of a record, which NumPy may not take
        return np.empty((0, 3))
    dtype = np.dtype(
        {"names": ["x", "y", "z"], "formats": types, "offsets": offsets, "itemsize": stride}
    )
    records = np.frombuffer(body, dtype, count)
    points = np.empty((count, 3))
    with np.errstate(invalid="ignore"):  # a signalling NaN, which some bytes are
        for axis, name in enumerate("xyz"):
            points[:, axis] = records[name]
    return points


def unpack_column(body: bytes, count: int, offset: int, kind: str, stride: int) -> npt.NDArray[Any]:
    """Take one field out of the binary records that `unpack_points` has taken points out of."""
    if count == 0:
        return np.empty(0)
    dtype = np.dtype({"names": ["t"], "formats": [kind], "offsets": [offset], "itemsize": stride})
    return np.ascontiguousarray(np.frombuffer(body, dtype, count)["t"])


def pick_columns(table: FloatArray, columns: list[int], types: list[str]) -> FloatArray:
    """Take x, y and z out of a table read from text.

    In the precision the header states: a cloud is the same in each of its encodings.
    """
    points = np.empty((len(table), 3))
    with np.errstate(over="ignore"):
        for axis, (column, kind) in enumerate(zip(columns, types, strict=True)):
            points[:, axis] = table[:, column].astype(kind)
    return points
