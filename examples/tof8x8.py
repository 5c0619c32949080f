# SPDX-License-Identifier: Apache-2.0
"""A time-of-flight sensor of 8 x 8 zones on a drone, with motion-capture poses, to an NPZ beam log.

python examples/tof8x8.py FOLDER tof.npz
oddsmap build tof.npz --resolution 0.05 -o tof.zarr
oddsmap export tof.zarr tof.png --z-min 0.2 --z-max 0.7

FOLDER has `state_ToF.csv`, blocks of 65 rows: `t,0,0` [ms], then 64 of `distance [mm], targets,
status`; and `state_Vicon.csv`: name, t [ms], position [m], quaternion w x y z. Zones are rows of
columns; a zone's distance is forward depth. A zone is of use with one target and status 5 or 9; the
others carry no information, which is not the same as nothing seen.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt

from oddsmap.poses.pose import Pose3
from oddsmap.poses.trajectory import Trajectory

FIELD_DEG, ZONES = 45.0, 8
RANGE_MAX = 4.0


def zone_rays() -> npt.NDArray[np.float64]:
    """Points one metre ahead, through the middle of each zone, shape (64, 3): x forward, z up."""
    slopes = np.tan(np.deg2rad((np.arange(ZONES) - (ZONES - 1) / 2) * FIELD_DEG / ZONES))
    row, column = np.meshgrid(slopes, slopes, indexing="ij")
    return np.stack([np.ones_like(row), -column, -row], axis=-1).reshape(-1, 3)


def drone_poses(file: Path) -> Trajectory:
    """The motion capture's poses of the drone."""
    with file.open(newline="", encoding="utf-8") as table:
        rows = [row[1:] for row in csv.reader(table) if row[0] == "Drone"]
    numbers = np.array(rows, float)
    _, first = np.unique(numbers[:, 0], return_index=True)  # some stamps occur twice
    numbers = numbers[first]
    quaternions_xyzw = numbers[:, [5, 6, 7, 4]]
    poses = [
        Pose3.from_quaternion_xyzw(position, xyzw / np.linalg.norm(xyzw))
        for position, xyzw in zip(numbers[:, 1:4], quaternions_xyzw, strict=True)
    ]
    stamps_ns = (numbers[:, 0] * 1e6).astype(np.int64)
    return Trajectory(numbers[:, 1:4], np.array([p.rotation for p in poses]), stamps_ns, str(file))


def main(folder: str, output: str) -> None:
    """Read the two files and write the beams of all zones with a reading, in the room's frame."""
    frames = np.loadtxt(Path(folder) / "state_ToF.csv", delimiter=",").reshape(-1, 65, 3)
    poses = drone_poses(Path(folder) / "state_Vicon.csv")
    rays = zone_rays()
    lengths = np.linalg.norm(rays, axis=1)
    beams, scans = [], []
    for number, frame in enumerate(frames):
        room_from_drone = poses.at(int(frame[0, 0] * 1e6), tolerance_ns=100_000_000)
        depth, targets, status = frame[1:].T
        good = (targets == 1) & np.isin(status, (5, 9))
        axes = (rays / lengths[:, None])[good] @ room_from_drone.rotation.T
        ranges = (depth / 1000 * lengths)[good, None]
        origin = np.broadcast_to(room_from_drone.translation, axes.shape)
        beams.append(np.concatenate([origin, axes, ranges], axis=1))
        scans.append(np.full(len(axes), number))
    np.savez_compressed(
        output,
        beams=np.concatenate(beams),
        scan=np.concatenate(scans),
        cone_deg=FIELD_DEG / ZONES,
        range_max=RANGE_MAX,
    )
    print(f"{len(frames)} frames, {sum(map(len, beams))} beams: {output}")


if __name__ == "__main__":
    main(*sys.argv[1:])
