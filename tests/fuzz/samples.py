# SPDX-License-Identifier: Apache-2.0
"""A small valid file or folder for each reader, made by code."""

from __future__ import annotations

import bz2
import gzip
import io
import math
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

import oddsmap
from oddsmap.array_types import FloatArray
from oddsmap.landmarks import read_observations
from oddsmap.maps.voxel_map import VoxelMap
from tests.full_map.kit import SONAR, room
from tests.fuzz.mutant import Files
from tests.fuzz.npz_changes import npz
from tests.kit import random_scans
from tests.readers.argoverse_files import argoverse_log
from tests.readers.clouds import graph_bytes, pcd_bytes, ply_bytes
from tests.readers.rawlogs import rawlog
from tests.readers.setups import Setup, e57_file, ptx_text

__all__ = ["GRIDS", "SAMPLES", "SCANS", "SCANS_3D", "folder_files"]

_POINTS = np.round(np.random.default_rng(7).uniform(1.0, 4.0, (40, 3)), 3)
_IDENTITY_ROW = "1 0 0 {} 0 1 0 0 0 0 1 0\n"
_MATRIX = "1 0 0 {}\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"


# What maps are made of to try settings.
SCANS = [
    oddsmap.Scan(scan.map_from_sensor, scan.directions, scan.ranges, i * 10**9)
    for i, scan in enumerate(random_scans(1, 2, beams=12))
]
SCANS_3D = [oddsmap.Scan.from_points(oddsmap.Pose3(np.zeros(3), np.eye(3)), _POINTS, 0)]
GRIDS = [oddsmap.GridScan(oddsmap.Pose2(1.0, 0.0, 0.3), np.eye(4), 0.25, (-0.5, -0.5), 0)]


def folder_files(folder: Path) -> Files:
    """All files below a folder, by path."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def _carmen(kind: str = "FLASER") -> bytes:
    rows = ["# CARMEN Logfile", "PARAM robot_frontlaser_offset 0.0"]
    for i in range(4):
        ranges = " ".join(f"{3 + 0.01 * ((7 * j + i) % 20):.2f}" for j in range(18))
        pose, end = f"{0.2 * i:.3f} 0.100 {0.1 * i:.3f}", f"{10 + i}.5 host {i}.5"
        if kind == "FLASER":
            rows.append(f"FLASER 18 {ranges} {pose} {pose} {end}")
        else:
            fan = f"0 -1.57 3.14 {math.pi / 18:.6f} 80.0 0.01 0"
            rows.append(f"ROBOTLASER1 {fan} 18 {ranges} 0 {pose} {pose} 0.1 0.2 0.3 0.4 0 {end}")
    return "\n".join([*rows, ""]).encode()


def _beams(d: int, offset: float = 0.0, **more: object) -> bytes:
    count = 24
    rng = np.random.default_rng(d)
    positions = np.repeat(np.round(rng.uniform(-1, 1, (3, d)) + offset, 2), count // 3, axis=0)
    angles = np.linspace(0.0, 6.0, count)
    if d == 3:
        ways = np.stack([np.cos(angles), np.sin(angles), np.zeros(count)], axis=1)
    else:
        ways = angles[:, None]
    ranges = np.round(rng.uniform(1.0, 3.0, count), 2)
    return npz(
        {
            "beams": np.hstack([positions, ways, ranges[:, None]]),
            "range_max": np.array(10.0),
            "stamp_ns": np.repeat(np.arange(3) * 10**9, count // 3),
            **more,
        }
    )


def _grids() -> bytes:
    grids = np.random.default_rng(2).choice(np.array([0, 1, 255], np.uint8), (3, 6, 6))
    poses = np.array([[0.0, 0, 0], [1, 0, 0.5], [2, 1, 1]])
    return npz(
        {"grids": grids, "poses": poses, "pixel": np.array(0.25), "corner": np.array([-1.0, -1.0])}
    )


def _landmark_rows() -> FloatArray:
    rows = []
    for i in range(6):
        for name, (x, y) in enumerate(((4.0, 1.0), (3.0, -2.0), (6.0, 3.0))):
            away = x - 0.3 * i, y
            bearing = math.atan2(away[1], away[0]) + 0.001 * ((i + name) % 3)
            rows.append((0.3 * i, 0.0, 0.0, round(math.hypot(*away), 3), round(bearing, 4), name))
    return np.array(rows)


_COLUMNS = ("x", "y", "theta", "range", "bearing", "id")


def _landmark_csv() -> bytes:
    rows = [",".join(f"{v:g}" for v in row) for row in _landmark_rows()]
    return "\n".join([",".join(_COLUMNS), *rows, ""]).encode()


def _landmark_npz() -> bytes:
    return npz(dict(zip(_COLUMNS, _landmark_rows().T, strict=True)))


def _landmark_json() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "a.csv"
        table.write_bytes(_landmark_csv())
        marks = oddsmap.LandmarkMap()
        for seen in read_observations(table).scans(sigma_range=0.1, sigma_bearing=0.02):
            marks.add(seen)
        return marks.save(Path(folder) / "a.json").read_bytes()


def _kitti(poses: str, times: str | None = "0\n1\n2\n") -> Files:
    clouds = {
        f"{i:06d}.bin": np.hstack([_POINTS + i, np.ones((40, 1))]).astype("<f4").tobytes()
        for i in range(3)
    }
    return clouds | {"poses.txt": poses.encode()} | ({"times.txt": times.encode()} if times else {})


def _tum_poses() -> str:
    return "# t x y z qx qy qz qw\n" + "".join(
        f"{i:.2f} {0.1 * i:.2f} 0 0 0 0 0 1\n" for i in range(3)
    )


def _image(pixels: npt.NDArray[Any], form: str = "PNG") -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, form)
    return file.getvalue()


def _depth(units: float) -> bytes:
    return _image((np.random.default_rng(5).uniform(1.0, 3.0, (12, 16)) * units).astype(np.uint16))


_INTRINSICS = b"10 0 7.5\n0 10 5.5\n0 0 1\n"


def _seven_scenes() -> Files:
    files: dict[str, bytes] = {"camera-intrinsics.txt": _INTRINSICS}
    for i in range(2):
        files[f"frame-{i:06d}.depth.png"] = _depth(1000.0)
        files[f"frame-{i:06d}.pose.txt"] = _MATRIX.format(0.1 * i).encode()
    return files


def _tum() -> Files:
    files: dict[str, bytes] = {"camera-intrinsics.txt": _INTRINSICS}
    for i in range(2):
        files[f"depth/{i}.png"] = _depth(5000.0)
    files["depth.txt"] = b"# stamp file\n0.00 depth/0.png\n1.00 depth/1.png\n"
    files["groundtruth.txt"] = _tum_poses().encode()
    return files


def _octomap(suffix: str, dense: bool = False) -> bytes:
    rng = np.random.default_rng(3)
    if dense:
        index = np.stack(np.meshgrid(*[np.arange(-4, 4)] * 3), axis=-1).reshape(-1, 3)
        log_odds = np.where(index[:, 2] < 0, -1.0, 1.0)
    else:
        index = np.unique(rng.integers(-20, 20, (60, 3)), axis=0)
        log_odds = np.round(rng.uniform(-2, 2, len(index)), 2)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a{suffix}"
        VoxelMap(index.astype(np.int64), log_odds, 0.1).save_octomap(path)
        return path.read_bytes()


_GREYS = np.random.default_rng(7).choice(np.array([0, 205, 254], np.uint8), (12, 15))
_YAML = (
    "image: m.{}\nmode: trinary\nresolution: 0.05\norigin: [-1.0, -2.0, 0.0]\n"
    "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
)


def _ros(form: str) -> Files:
    image = b"P5\n15 12\n255\n" + _GREYS.tobytes() if form == "pgm" else _image(_GREYS)
    return {"m.yaml": _YAML.format(form).encode(), f"m.{form}": image}


_TOML = b"""[map]
resolution = 0.1
votes = "beam"
half_life = 100.0
[sensor]
kind = "beam"
range_min = 0.1
range_max = 30.0
clear_range = 10.0
hit_width = 0.2
share_hit = true
fade = 0.5
p_hit = 0.7
p_miss = 0.4
detection = 0.9
p_random = 0.02
p_dropout = 0.02
[posterior]
prior = 0.3
free = 0.196
occupied = 0.65
"""

_TOML_CONES = b"""[map]
resolution = 0.1
[sensor]
kind = "cone"
cone_deg = 20.0
range_min = 0.1
range_max = 4.0
[posterior]
prior = 0.3
"""


_TOML_3D = b"""[map]
resolution = 0.2
votes = "scan"
[sensor]
kind = "beam"
range_min = 0.1
range_max = 30.0
clear_range = 10.0
sigma = 0.05
mark_z_min = -1.0
mark_z_max = 2.0
body_min = [-0.3, -0.2, -0.5]
body_max = [0.3, 0.2, 0.5]
"""

_TOML_OVERHEAD = b"""[map]
resolution = 0.2
[sensor]
kind = "overhead"
[posterior]
prior = 0.3
"""

# Without the fields that say how long to go on.
_TOML_FULL_MAP = b"""[map]
resolution = 0.2
[sensor]
kind = "cone"
cone_deg = 20.0
range_max = 4.0
p_random = 0.02
p_dropout = 0.02
[full_map]
method = "sum-product"
prior = 0.4
coupling = 0.8
tolerance = 0.1
schedule = "chunks"
chunk = 64
seed = 3
"""


def _zarr(kind: str) -> Files:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.zarr"
        if kind == "full":
            oddsmap.build_full_map(room(3), 0.2, sensor=SONAR).save(path)
        else:
            log = Path(folder) / "a.npz"
            # All on one side of the origin: few shards, which take most of the time.
            log.write_bytes(_beams(2 if kind == "2d" else 3, offset=5.0))
            oddsmap.build_map(oddsmap.open_log(log), 0.2).save(path)
        return {f"a.zarr/{name}": content for name, content in folder_files(path).items()}


def _csv_poses() -> str:
    """As pandas exports odometry."""
    names = ",Time,header.stamp.secs,header.stamp.nsecs,header.frame_id,"
    names += ",".join(f"pose.pose.orientation.{n}" for n in "wxyz") + ","
    names += ",".join(f"pose.pose.position.{n}" for n in "xyz") + ",pose.covariance\n"
    rows = [f'{i},9.5,{i},0,odom,1,0,0,0,0.{i},0,0,"(0.1, 0.2)"\n' for i in range(3)]
    return names + "".join(rows)


def _kitti_raw() -> Files:
    rows = "".join(f"1 0 0 0 0 1 0 0 0 0 1 {i}\n" for i in range(3))
    calib = "calib_time: 15-Mar-2012\nR: 0 -1 0 0 0 -1 1 0 0\nT: 0.1 -0.2 -0.3\ndelta_f: 0 0\n"
    return {**_kitti(rows), "calib_velo_to_cam.txt": calib.encode()}


def _las(name: str, form: int) -> Files:
    import laspy

    header = laspy.LasHeader(point_format=form, version="1.4")
    header.scales = np.full(3, 0.001)
    header.creation_date = None
    data = laspy.LasData(header)
    data.x, data.y, data.z = _POINTS.T
    data.gps_time = 1000.0 + np.arange(len(_POINTS)) * 0.01
    rows = "".join(f"{1000 + i / 10:.1f},0,0,{3 + 0.1 * i:.1f}\n" for i in range(6))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        data.write(path)
        return {name: path.read_bytes(), "track.csv": f"t,x,y,z\n{rows}".encode()}


def _gpx() -> Files:
    """Points in UTM, which the header says, and a track of GPS above them."""
    import laspy
    import pyproj

    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales, header.offsets = np.full(3, 0.001), np.array([500_000.0, 5_400_000.0, 0.0])
    header.creation_date = None
    header.add_crs(pyproj.CRS(32632))
    data = laspy.LasData(header)
    data.x, data.y, data.z = (_POINTS + header.offsets).T
    data.gps_time = 1_269_777_618.0 + np.arange(len(_POINTS)) * 0.01
    back = pyproj.Transformer.from_crs(32632, 4326, always_xy=True)
    lon, lat = back.transform(500_000.0, 5_400_000.0)
    rows = "".join(
        f'<trkpt lat="{lat:.8f}" lon="{lon:.8f}"><ele>5</ele>'
        f"<time>2020-04-01T12:00:0{i}Z</time></trkpt>\n"
        for i in range(3)
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.las"
        data.write(path)
        track = f'<gpx version="1.1"><trk><trkseg>{rows}</trkseg></trk></gpx>'
        return {"a.las": path.read_bytes(), "t.gpx": track.encode()}


def _e57() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        pose = oddsmap.Pose3(np.array([0.5, 0.25, 0.0]), np.eye(3))
        invalid = np.arange(len(_POINTS)) % 10 == 3
        setups = [Setup(_POINTS, pose, invalid=invalid.astype(np.int64)), Setup(_POINTS, pose)]
        return e57_file(Path(folder) / "a.e57", setups).read_bytes()


def _argoverse() -> Files:
    with tempfile.TemporaryDirectory() as folder:
        return folder_files(argoverse_log(Path(folder) / "log", sweeps=1))


def _one(name: str, content: bytes) -> Files:
    return {name: content}


def _recording(kind: str) -> Files:
    """Three scans on a way, and a cloud, written by rosbags, or by mcap as JSON."""
    from tests.recordings.fuzz_samples import recording_bytes

    suffix = {"bag": "bag", "bag-lz4": "bag", "sqlite3": "db3"}.get(kind, "mcap")
    return _one(f"a.{suffix}", recording_bytes(kind))


SAMPLES: dict[str, Callable[[], Files]] = {
    "carmen": lambda: _one("a.log", _carmen()),
    "carmen-robotlaser": lambda: _one("a.log", _carmen("ROBOTLASER1")),
    "carmen-gz": lambda: _one("a.log.gz", gzip.compress(_carmen(), mtime=0)),
    "carmen-bz2": lambda: _one("a.log.bz2", bz2.compress(_carmen())),
    "carmen-two-members": lambda: _one(
        "a.gz", gzip.compress(_carmen()[:500], mtime=0) + gzip.compress(_carmen()[500:], mtime=0)
    ),
    "npz-beams2": lambda: _one("a.npz", _beams(2)),
    "npz-beams3": lambda: _one("a.npz", _beams(3)),
    "npz-cones": lambda: _one(
        "a.npz", _beams(2, cone_deg=np.array(15.0), p_random=np.array(0.02), scan=np.arange(24))
    ),
    "npz-grids": lambda: _one("a.npz", _grids()),
    "landmark-csv": lambda: _one("a.csv", _landmark_csv()),
    "landmark-npz": lambda: _one("a.npz", _landmark_npz()),
    "landmark-json": lambda: _one("a.json", _landmark_json()),
    "pcd-ascii": lambda: _one("a.pcd", pcd_bytes(_POINTS, "ascii")),
    "pcd-binary": lambda: _one("a.pcd", pcd_bytes(_POINTS, "binary")),
    "pcd-binary_compressed": lambda: _one("a.pcd", pcd_bytes(_POINTS, "binary_compressed")),
    "ply-ascii": lambda: _one("a.ply", ply_bytes(_POINTS, "ascii")),
    "ply-binary_little_endian": lambda: _one("a.ply", ply_bytes(_POINTS)),
    "ply-binary_big_endian": lambda: _one("a.ply", ply_bytes(_POINTS, "binary_big_endian")),
    "kitti-bin": lambda: _kitti("".join(_IDENTITY_ROW.format(i) for i in range(3))),
    "poses-kitti": lambda: _kitti("".join(_IDENTITY_ROW.format(i) for i in range(3))),
    "poses-tum": lambda: _kitti(_tum_poses()),
    "poses-csv": lambda: _kitti(_csv_poses()),
    "kitti-raw": _kitti_raw,
    "ptx": lambda: _one("a.ptx", ptx_text(_POINTS, oddsmap.Pose3(np.ones(3), np.eye(3))).encode()),
    "rawlog": lambda: _one("a.rawlog", rawlog()),
    "las": lambda: _las("a.las", 1),
    "laz": lambda: _las("a.laz", 1),
    "laz-layers": lambda: _las("a.laz", 6),
    "gpx": _gpx,
    "e57": lambda: _one("a.e57", _e57()),
    "argoverse-sweep": _argoverse,
    "argoverse-poses": _argoverse,
    "rgbd-7scenes": _seven_scenes,
    "rgbd-tum": _tum,
    "recording-bag": lambda: _recording("bag"),
    "recording-bag-lz4": lambda: _recording("bag-lz4"),
    "recording-sqlite3": lambda: _recording("sqlite3"),
    "recording-mcap": lambda: _recording("mcap"),
    "recording-mcap-json": lambda: _recording("mcap-json"),
    "octomap-graph": lambda: _one(
        "a.graph",
        graph_bytes([(_POINTS, (1, 2, 3, 1, 0, 0, 0)), (_POINTS, (0, 0, 0, 0, 0, 0, 1))], 1),
    ),
    "octomap-bt": lambda: _one("a.bt", _octomap(".bt")),
    "octomap-bt-dense": lambda: _one("a.bt", _octomap(".bt", dense=True)),
    "octomap-ot": lambda: _one("a.ot", _octomap(".ot")),
    "ros-yaml": lambda: _ros("pgm"),
    "ros-pgm": lambda: _ros("pgm"),
    "ros-png": lambda: _ros("png"),
    "toml": lambda: _one("a.toml", _TOML),
    "toml-cones": lambda: _one("a.toml", _TOML_CONES),
    "toml-3d": lambda: _one("a.toml", _TOML_3D),
    "toml-overhead": lambda: _one("a.toml", _TOML_OVERHEAD),
    "toml-full-map": lambda: _one("a.toml", _TOML_FULL_MAP),
    "zarr-2d": lambda: _zarr("2d"),
    "zarr-3d": lambda: _zarr("3d"),
    "zarr-full": lambda: _zarr("full"),
}
