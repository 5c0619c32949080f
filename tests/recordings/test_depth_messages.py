# SPDX-License-Identifier: Apache-2.0
"""Images of depth with their intrinsics."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap import BeamSensor, build_map, open_log
from oddsmap.errors import InputError
from oddsmap.recordings.depth_messages import camera_of
from oddsmap.recordings.scan_messages import IMAGE, beams_of
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from tests.recordings.bags import CONTAINERS, Messages, Said
from tests.recordings.test_recorded_log import SECOND, START

K = (40.0, 41.0, 15.5, 11.5)
SIZE = (32, 24)
OPTICAL = "cam_depth_optical_frame"


@pytest.fixture
def ros() -> Messages:
    return Messages("mcap")


def wall(metres: float = 2.0) -> npt.NDArray[np.float32]:
    return np.full(SIZE[::-1], metres, np.float32)


def first(log: Iterable[Any]) -> Any:
    return next(iter(log))


def looking_ahead(messages: Messages, stamp_ns: int, parent: str, child: str) -> Any:
    """The optical frame of a camera that looks along x, half a metre up."""
    fixed = messages.transform(stamp_ns, parent, child, (0.1, 0.0, 0.5), 0.0)
    turn = fixed.transform.rotation
    turn.x, turn.y, turn.z, turn.w = -0.5, 0.5, -0.5, 0.5
    return messages.tf(fixed)


def filmed(
    messages: Messages,
    pixels: npt.NDArray[np.generic],
    encoding: str,
    *,
    frame: str = OPTICAL,
    info: str | None = "/cam/depth/camera_info",
) -> list[Said]:
    said: list[Said] = [("/tf_static", START, looking_ahead(messages, START, "base", frame))]
    for k in range(4):
        now = START + k * SECOND // 10
        moved = messages.transform(now, "map", "base", (0.2 * k, 0.0, 0.0), 0.0)
        said.append(("/tf", now, messages.tf(moved)))
        if info is not None:
            said.append((info, now, messages.camera(now, frame, SIZE, K)))
        image = messages.image(now, frame, pixels, encoding)
        said.append(("/cam/depth/image_raw", now, image))
        colour = np.zeros((*SIZE[::-1], 3), np.uint8)
        said.append(("/cam/color/image_raw", now, messages.image(now, frame, colour, "rgb8")))
    return said


@pytest.mark.parametrize("container", CONTAINERS)
def test_from_file_to_evidence(container: str, tmp_path: Path) -> None:
    messages = Messages(container)
    pixels = wall(2.0)
    pixels[0, 0], pixels[0, 1] = np.nan, np.inf
    # The topic of colour is no candidate.
    log = open_log(messages.write(tmp_path / "run", filmed(messages, pixels, "32FC1")))
    scans = list(log)
    assert len(log) == len(scans) == 4
    camera = PinholeCamera(*K, *SIZE)
    for k, scan in enumerate(scans):
        assert isinstance(scan, DepthScan)
        assert scan.camera == camera
        np.testing.assert_allclose(scan.map_from_sensor.translation, [0.2 * k + 0.1, 0.0, 0.5])
        ends = scan.to_scan()
        points = scan.map_from_sensor.transform(ends.directions * ends.ranges[:, None])
        np.testing.assert_allclose(points[2:, 0], 0.2 * k + 2.1)
    assert log.notes == ()
    made = build_map(log, 0.1, sensor=BeamSensor(range_max=10.0))
    assert made.ndim == 3


def test_millimetres_in_any_byte_order_and_rows_with_padding(ros: Messages) -> None:
    for kind in ("<u2", ">u2"):
        pixels = np.array([[0, 1234], [65535, 2]], kind)
        beams = beams_of(IMAGE, ros.image(START, "/cam", pixels, "16UC1", padding=6))
        want = np.array([[0.0, 1.234], [np.nan, 0.002]], np.float32)
        np.testing.assert_array_equal(beams.depth, want)
        assert beams.frame == "cam"


def test_units_that_the_caller_states(ros: Messages, tmp_path: Path) -> None:
    pixels = np.full(SIZE[::-1], 8000, "<u2")
    path = ros.write(tmp_path / "run", filmed(ros, pixels, "16UC1"))
    assert first(open_log(path)).depth.max() == 8.0
    assert first(open_log(path, depth_scale=4000.0)).depth.max() == 2.0
    metres = ros.write(tmp_path / "metres", filmed(ros, wall(), "32FC1"))
    with pytest.raises(InputError, match="depths of 32FC1 are metres: leave `depth_scale` out"):
        open_log(metres, depth_scale=1000.0)


def test_mono16_is_doubted(ros: Messages, tmp_path: Path) -> None:
    path = ros.write(tmp_path / "run", filmed(ros, np.full(SIZE[::-1], 2000, "<u2"), "mono16"))
    (note,) = open_log(path).notes
    assert (note.code, note.severity) == ("depth.encoding", "warning")


@pytest.mark.parametrize(("name", "value"), [("width", 10**9), ("step", 4), ("height", 2**31)])
def test_an_image_that_contradicts_itself(name: str, value: int, ros: Messages) -> None:
    image = ros.image(START, "cam", wall(), "32FC1")
    setattr(image, name, value)
    with pytest.raises(InputError, match="an image of "):
        beams_of(IMAGE, image)


def test_a_topic_of_colour(ros: Messages, tmp_path: Path) -> None:
    path = ros.write(tmp_path / "run", filmed(ros, wall(), "32FC1"))
    with pytest.raises(InputError, match="/cam/color/image_raw is of images without depth"):
        open_log(path, scans="/cam/color/image_raw")


def test_intrinsics_elsewhere(ros: Messages, tmp_path: Path) -> None:
    """By their frame and size where there are none beside the images; else the caller states."""
    path = ros.write(tmp_path / "run", filmed(ros, wall(), "32FC1", info="/info"))
    assert first(open_log(path)).camera.fx == K[0]
    path = ros.write(tmp_path / "none", filmed(ros, wall(), "32FC1", info=None))
    with pytest.raises(InputError, match="no intrinsics for /cam/depth/image_raw: /cam/depth/cam"):
        open_log(path)
    stated = PinholeCamera(30.0, 30.0, 16.0, 12.0, *SIZE)
    assert first(open_log(path, camera=stated)).camera == stated


def test_a_rectified_image_is_described_by_p(ros: Messages) -> None:
    info = ros.camera(START, OPTICAL, SIZE, K, p=(50.0, 50.0, 16.0, 12.0), distortion=[0.5])
    rectified, doubts = camera_of(info, "/cam/image_rect_raw")
    assert (rectified.fx, rectified.cx, doubts) == (50.0, 16.0, [])
    assert camera_of(info, "/cam/image_raw")[0].fx == K[0]


def test_distortion_is_doubted_where_it_moves_pixels(ros: Messages) -> None:
    info = ros.camera(START, OPTICAL, SIZE, K, distortion=[0.1, 0.0, 0.0, 0.0, 0.0])
    (note,) = camera_of(info, "/cam/image_raw")[1]
    # The corner at (32, 24): x = 16.5 / 40, y = 12.5 / 41, r2 = .2631; moved by k1 r2 of itself.
    far = 0.1 * 0.26310 * math.hypot(16.5, 12.5)
    assert f"the lens moves pixels by up to {far:.1f} pixels (plumb_bob)" in note
    slight = ros.camera(START, OPTICAL, SIZE, K, distortion=[0.01, 0.0, 0.0, 0.0, 0.0])
    assert camera_of(slight, "/cam/image_raw")[1] == []


def test_a_camera_that_is_not_calibrated(ros: Messages) -> None:
    info = ros.camera(START, OPTICAL, SIZE, (0.0, 0.0, 0.0, 0.0))
    with pytest.raises(InputError, match=r"not calibrated \(a focal length of 0\): state"):
        camera_of(info, "/cam/image_raw")


def test_half_the_pixels_of_a_part_of_the_image(ros: Messages) -> None:
    info = ros.camera(START, OPTICAL, (64, 48), (80.0, 82.0, 31.0, 23.0))
    info.binning_x = info.binning_y = 2
    info.roi.x_offset, info.roi.width = 8, 40
    camera = camera_of(info, "/cam/image_raw")[0]
    assert camera == PinholeCamera(40.0, 41.0, 11.5, 11.5, 20, 24)


def test_a_frame_that_is_not_optical_is_doubted(ros: Messages, tmp_path: Path) -> None:
    said = filmed(ros, wall(), "32FC1", frame="cam_link")
    turn = said[0][2].transforms[0].transform.rotation
    turn.x, turn.y, turn.z, turn.w = 0.0, 0.0, 0.0, 1.0
    (note,) = open_log(ros.write(tmp_path / "run", said)).notes
    assert note.code == "camera.not_optical"
    assert "points up in the map: is that the frame of the camera's body?" in note


def test_transforms_that_end_at_the_camera_s_body(ros: Messages, tmp_path: Path) -> None:
    said = filmed(ros, wall(), "32FC1")
    said[0][2].transforms[0].child_frame_id = "cam_depth_frame"
    path = ros.write(tmp_path / "run", said)
    with pytest.raises(InputError, match="only to 'cam_depth_frame', which is not the optical fra"):
        open_log(path)
