# SPDX-License-Identifier: Apache-2.0
"""OctoMap from files to a file, as a program of its own: PCD scans and KITTI poses to a `.bt`.

    python benchmarks/peers/octomap_command.py FOLDER POSES RESOLUTION OUT.bt
    python benchmarks/peers/octomap_command.py FOLDER POSES RESOLUTION OUT.bt --fast

The first inserts with all of OctoMap's defaults; `--fast` leaves inner nodes for the end
(`lazy_eval`, then `updateInnerOccupancy`). Scans are read as `oddsmap` would read them, by the
shortest way there is: binary PCD of 4-byte floats that begin with x, y and z.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import octomap


def main() -> None:
    """Map a folder."""
    folder, poses, resolution, out = sys.argv[1:5]
    fast = "--fast" in sys.argv[5:]
    matrices = np.loadtxt(poses).reshape(-1, 3, 4)
    tree = octomap.OcTree(float(resolution))
    for path, matrix in zip(sorted(Path(folder).glob("*.pcd")), matrices, strict=True):
        points = read_pcd(path) @ matrix[:, :3].T + matrix[:, 3]
        points = points[np.isfinite(points).all(axis=1)]
        tree.insertPointCloud(points, matrix[:, 3].copy(), lazy_eval=fast)
    if fast:
        tree.updateInnerOccupancy()
    tree.writeBinary(out.encode())


def read_pcd(path: Path) -> np.ndarray:
    """The points of a binary PCD file [m], shape (n, 3)."""
    content = path.read_bytes()
    body = content.index(b"DATA binary\n") + len(b"DATA binary\n")
    header = dict(line.split(None, 1) for line in content[:body].decode().splitlines() if line)
    sizes = [int(size) for size in header["SIZE"].split()]
    counts = [int(count) for count in header.get("COUNT", " ".join("1" * len(sizes))).split()]
    if header["FIELDS"].split()[:3] != ["x", "y", "z"] or sizes[:3] != [4, 4, 4]:
        raise SystemExit(f"{path}: this reader takes x, y and z first, as 4-byte floats")
    stride = sum(size * count for size, count in zip(sizes, counts, strict=True))
    count = int(header["POINTS"])
    records = np.frombuffer(content, np.uint8, count * stride, body).reshape(count, stride)
    return np.ascontiguousarray(records[:, :12]).view("<f4").astype(np.float64)


if __name__ == "__main__":
    main()
