# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.readers import open_log
from oddsmap.scans.depth_image import PinholeCamera
from oddsmap.scans.lazy_log import DepthLog
from tests.test_image_file import png_of

CAMERA = PinholeCamera(2.0, 2.0, 1.0, 0.5, width=3, height=2)
UNITS = np.array([[0, 1000, 65535], [2000, 5000, 1]], np.uint16)
POSE = "1 0 0 {}\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
K = "2 0 1\n0 2 0.5\n0 0 1\n"


def write_png(path: Path, units: np.ndarray = UNITS) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(units).save(path)


def seven_scenes(folder: Path, n: int = 3) -> None:
    for i in range(n):
        write_png(folder / f"frame-{i:06d}.depth.png")
        (folder / f"frame-{i:06d}.pose.txt").write_text(POSE.format(i))
        (folder / f"frame-{i:06d}.color.png").write_bytes(b"")


def tum(folder: Path) -> None:
    for i in (1, 2):
        write_png(folder / "depth" / f"{i}.png")
    (folder / "depth.txt").write_text("# stamp file\n1.00 depth/1.png\n2.01 depth/2.png\n")
    rows = "".join(f"{t} {t} 0 0 0 0 0 1\n" for t in (1.00, 2.00, 2.02))
    (folder / "groundtruth.txt").write_text(rows)


def open_depth(folder: Path, **options: object) -> DepthLog:
    log = open_log(folder, **options)  # type: ignore[arg-type]
    assert isinstance(log, DepthLog)
    return log


def test_seven_scenes_is_in_millimetres_and_has_two_invalid_values(tmp_path: Path) -> None:
    seven_scenes(tmp_path)
    (tmp_path / "camera-intrinsics.txt").write_text(K)
    log = open_depth(tmp_path)
    assert log.format == "7-Scenes depth images"
    assert log.camera == CAMERA
    assert log.notes == ()
    for _ in range(2):
        scans = list(log)
        assert [float(s.map_from_sensor.translation[0]) for s in scans] == [0, 1, 2]
    depth = scans[0].depth
    assert depth.dtype == np.float32
    np.testing.assert_array_equal(depth, np.array([[0, 1, 0], [2, 5, 0.001]], np.float32))
    as_beams = next(iter(log)).to_scan()
    assert np.isnan(as_beams.ranges).tolist() == [True, False, True, False, False, False]


def test_a_camera_given_by_hand_wins_and_extrinsics_apply(tmp_path: Path) -> None:
    seven_scenes(tmp_path)
    (tmp_path / "camera-intrinsics.txt").write_text("9 0 9\n0 9 9\n0 0 1\n")
    body_from_sensor = Pose3(np.array([0.0, 0, 7]), np.eye(3))
    log = open_depth(tmp_path, camera=CAMERA, body_from_sensor=body_from_sensor)
    assert log.camera is CAMERA
    last = list(log)[2]
    np.testing.assert_array_equal(last.map_from_sensor.translation, [2, 0, 7])


def test_poses_in_one_file(tmp_path: Path) -> None:
    seven_scenes(tmp_path)
    poses = tmp_path / "all.txt"
    poses.write_text("1 0 0 5 0 1 0 0 0 0 1 0\n" * 3)
    log = open_depth(tmp_path, camera=CAMERA, poses=poses)
    assert [s.map_from_sensor.translation[0] for s in log] == [5, 5, 5]
    poses.write_text("1 0 0 5 0 1 0 0 0 0 1 0\n" * 2)
    with pytest.raises(InputError, match="3 scans and 2 poses in"):
        open_log(tmp_path, camera=CAMERA, poses=poses)


def test_an_image_without_pose_says_both_numbers_or_is_counted(tmp_path: Path) -> None:
    seven_scenes(tmp_path)
    (tmp_path / "frame-000001.pose.txt").unlink()
    with pytest.raises(
        InputError, match=r"3 depth images and 2 pose files for them; frame-000001\.depth\.png is"
    ):
        open_log(tmp_path, camera=CAMERA)
    log = open_log(tmp_path, camera=CAMERA, skip_bad=True)
    assert [s.map_from_sensor.translation[0] for s in log] == [0, 2]
    assert log.skipped == {"scan.no_pose": 1}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\x89PNG\r\n\x1a\n nothing", "the PNG is cut off"),
        (png_of(2**31 - 1, 2**31 - 1), r"not an image that can be read \(Image size"),
        (np.zeros((3, 2), np.uint16), "depth image is 2 x 3 pixels, the intrinsics are for 3 x 2"),
        (np.zeros((2, 3), np.uint8), "a L image: depth images are gray with 16 bits"),
    ],
)
def test_a_broken_image_is_an_error_or_a_counted_skip(
    tmp_path: Path, content: bytes | np.ndarray, message: str
) -> None:
    seven_scenes(tmp_path)
    path = tmp_path / "frame-000001.depth.png"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        write_png(path, content)
    with pytest.raises(InputError, match=message) as caught:
        list(open_log(tmp_path, camera=CAMERA))
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)
    log = open_depth(tmp_path, camera=CAMERA, skip_bad=True)
    assert len(list(log)) == 2
    assert log.skipped == {"scan.unreadable": 1}


def test_intrinsics(tmp_path: Path) -> None:
    seven_scenes(tmp_path)
    with pytest.raises(InputError, match="images are 3 x 2 pixels and there are no intrinsics"):
        open_log(tmp_path)
    for text, message in (
        ("2 0 1\n0 2 0.5\n", "a matrix of 3 x 3 numbers"),
        ("2 1 1\n0 2 0.5\n0 0 1\n", r"other than \[fx 0 cx"),
        ("2 0 nan\n0 2 0.5\n0 0 1\n", r"txt:1: 'nan' is not a finite"),
    ):
        (tmp_path / "camera-intrinsics.txt").write_text(text)
        with pytest.raises(InputError, match=message):
            open_log(tmp_path)
    for image in tmp_path.glob("*.depth.png"):
        image.write_bytes(b"x")
    with pytest.raises(InputError, match="none of the 3 depth images can be read"):
        open_log(tmp_path)


def test_a_rotation_that_is_none_names_its_file(tmp_path: Path) -> None:
    seven_scenes(tmp_path)
    (tmp_path / "frame-000000.pose.txt").write_text(POSE.format(0).replace("1", "2"))
    with pytest.raises(InputError, match=r"frame-000000\.pose\.txt: a rotation matrix is not"):
        list(open_log(tmp_path, camera=CAMERA))


def test_tum_has_5000_units_a_metre_and_poses_by_stamp(tmp_path: Path) -> None:
    tum(tmp_path)
    log = open_depth(tmp_path, camera=CAMERA)
    assert log.format == "TUM RGB-D depth images"
    first, second = log
    np.testing.assert_array_equal(first.depth[1], np.array([0.4, 1.0, 0.0002], np.float32))
    assert first.depth[0, 2] == np.float32(65535 / 5000)
    assert first.stamp_ns == 1_000_000_000
    assert second.map_from_sensor.translation[0] == pytest.approx(2.01, abs=1e-12)
    with pytest.raises(InputError, match=r"no pose within 0\.005 s of stamp 2\.01"):
        list(open_log(tmp_path, camera=CAMERA, tolerance_s=0.005))


def test_tum_by_associations_in_either_order(tmp_path: Path) -> None:
    tum(tmp_path)
    (tmp_path / "depth.txt").unlink()
    list_file = tmp_path / "associations.txt"
    for row in ("1.5 rgb/1.png 2.0 depth/1.png\n", "2.0 depth/1.png 1.5 rgb/1.png\n"):
        list_file.write_text(row)
        assert [s.stamp_ns for s in open_log(tmp_path, camera=CAMERA)] == [2_000_000_000]
    for row, message in (
        ("2.0 a/1.png 1.5 b/1.png\n", r"associations\.txt:1: which file is the depth image"),
        ("2.0 depth/1.png 1.5\n", r"associations\.txt:1: 3 words"),
        ("# none\n", "no images are listed"),
        ("x depth/1.png\n", r"associations\.txt:1: 'x' is not a time"),
    ):
        list_file.write_text(row)
        with pytest.raises(InputError, match=message):
            open_log(tmp_path, camera=CAMERA)


def test_tum_without_poses(tmp_path: Path) -> None:
    tum(tmp_path)
    (tmp_path / "groundtruth.txt").rename(tmp_path / "gt.txt")
    with pytest.raises(InputError, match=r"2 depth images without poses \(groundtruth\.txt would"):
        open_log(tmp_path, camera=CAMERA)
    assert len(list(open_log(tmp_path, camera=CAMERA, poses=tmp_path / "gt.txt"))) == 2


@pytest.mark.realdata
def test_real_seven_scenes(data_folder: Path) -> None:
    log = open_depth(data_folder / "rgbd" / "7scenes")
    assert log.camera == PinholeCamera(585.0, 585.0, 320.0, 240.0, 640, 480)
    assert len(log) == 84
    invalid = sum(int((scan.depth == 0).sum()) for scan in log)
    assert invalid == 2_872_410  # of 25,804,800 pixels
    assert not log.skipped


@pytest.mark.realdata
def test_real_tum_frames_agree_with_each_other(data_folder: Path) -> None:
    folder = data_folder / "rgbd" / "tum_format_iclnuim3"
    log = open_depth(folder)
    assert log.notes[0].startswith("no intrinsics (camera-intrinsics.txt): fx 525, fy 525")
    # ICL-NUIM's own intrinsics: seen from frame 3, frame 1 lies where frame 3 measured.
    errors = {}
    for fy in (480.0, -480.0):
        camera = PinholeCamera(481.2, fy, 319.5, 239.5, 640, 480)
        first, _, third = open_depth(folder, camera=camera)
        beams = first.to_scan()
        points = first.map_from_sensor.transform(beams.directions * beams.ranges[:, None])
        x, y, z = third.map_from_sensor.inverse().transform(points).T
        u = np.rint(x / z * camera.fx + camera.cx).astype(int)
        v = np.rint(y / z * camera.fy + camera.cy).astype(int)
        seen = (u >= 0) & (u < 640) & (v >= 0) & (v < 480)
        errors[fy] = float(np.mean(np.abs(third.depth[v[seen], u[seen]] - z[seen])))
    assert errors[-480.0] < 0.003 < 0.01 < errors[480.0]


@pytest.mark.parametrize(
    ("layout", "camera"),
    [
        (seven_scenes, PinholeCamera(585.0, 585.0, 320.0, 240.0, width=640, height=480)),
        (tum, PinholeCamera(525.0, 525.0, 319.5, 239.5, width=640, height=480)),
    ],
)
def test_intrinsics_of_the_layout_where_none_are_given(
    tmp_path: Path, layout: Callable[[Path], None], camera: PinholeCamera
) -> None:
    """Those of docs/formats.md."""
    layout(tmp_path)
    for image in tmp_path.rglob("*.png"):
        if image.stat().st_size:
            write_png(image, np.full((480, 640), 1000, np.uint16))
    log = open_depth(tmp_path)
    assert log.camera == camera
    assert any("are assumed" in note for note in log.notes)
