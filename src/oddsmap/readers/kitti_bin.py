# SPDX-License-Identifier: Apache-2.0
"""KITTI velodyne scans: float32 x, y, z [m] and intensity, little-endian, and nothing else.

Nothing in such a file says what it is, so `.bin` files are read only as scans in a folder.
"""

from __future__ import annotations

import numpy as np

from oddsmap.errors import InputError
from oddsmap.readers.compression import Source
from oddsmap.readers.point_cloud import Cloud

__all__ = ["read_kitti_bin"]

_RECORD = 16


def read_kitti_bin(source: Source) -> Cloud:
    """Read a KITTI scan.

    Raises:
        InputError: the size is not a multiple of 16 bytes.
    """
    size = len(source.content)
    if size % _RECORD:
        raise InputError(
            f"{source.path}: {size} bytes, which is not a multiple of {_RECORD} (float32 x y z "
            "intensity): copy the file again, or convert it if its points have other fields"
        )
    records = np.frombuffer(source.content, "<f4").reshape(-1, 4)
    return Cloud(records[:, :3].astype(np.float64))
