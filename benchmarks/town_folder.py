# SPDX-License-Identifier: Apache-2.0
"""The simulated town of lidar3d.py as files: PCD scans in the sensor frame, and KITTI poses.

python benchmarks/town_folder.py FOLDER        # 100 scans of 62,000 points, 74 MB
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import numpy as np

from benchmarks import lidar3d

HEADER = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS x y z
SIZE 4 4 4
TYPE F F F
COUNT 1 1 1
WIDTH {0}
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS {0}
DATA binary
"""


def main() -> None:
    """Write the returns of each scan."""
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    file = lidar3d.town_scans(ROOT / "benchmarks" / ".cache")
    poses = []
    for number, scan in enumerate(lidar3d.load_scans(file, lidar3d.SCANS)):
        seen = np.isfinite(scan.ranges)
        points = (scan.directions[seen] * scan.ranges[seen, None]).astype("<f4")
        header = HEADER.format(len(points)).encode()
        (folder / f"{number:06d}.pcd").write_bytes(header + points.tobytes())
        pose = scan.map_from_sensor
        poses.append(np.column_stack([pose.rotation, pose.translation]).ravel())
    np.savetxt(folder / "poses_kitti.txt", np.array(poses), fmt="%.17g")


if __name__ == "__main__":
    main()
