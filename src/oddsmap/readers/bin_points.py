# SPDX-License-Identifier: Apache-2.0
"""`.bin` scans: float32 columns, little-endian, and nothing else: x, y, z [m] and what follows.

KITTI has four columns (intensity), nuScenes five (intensity, ring). Nothing in such a file says
what it is, so `.bin` files are read only as scans in a folder (`bin_columns.py` counts columns).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from oddsmap.errors import InputError
from oddsmap.readers.compression import Source
from oddsmap.readers.point_cloud import Cloud

__all__ = ["KITTI_COLUMNS", "read_bin_points"]

KITTI_COLUMNS = ("x", "y", "z", "intensity")


def read_bin_points(source: Source, columns: Sequence[str] = KITTI_COLUMNS) -> Cloud:
    """Read a scan.

    Args:
        source: the file.
        columns: what its columns are; x, y and z are among them.

    Raises:
        InputError: the size is not a multiple of that of a point.
    """
    size, record = len(source.content), 4 * len(columns)
    if size % record:
        raise InputError(
            f"{source.path}: {size} bytes, which is not a multiple of {record} (float32 "
            f"{' '.join(columns)}): copy the file again, or say its columns with --columns "
            "(columns=)"
        )
    records = np.frombuffer(source.content, "<f4").reshape(-1, len(columns))
    places = [columns.index(axis) for axis in "xyz"]
    with np.errstate(invalid="ignore"):  # a signalling NaN, which some bytes are
        return Cloud(records[:, places].astype(np.float64))
