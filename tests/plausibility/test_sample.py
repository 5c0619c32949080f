# SPDX-License-Identifier: Apache-2.0
"""A sample takes what passes by, once, and keeps little of it."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from oddsmap.plausibility.doubts import WatchedLog, check_log, doubts_of_sample
from oddsmap.plausibility.sample import Sample, sample_of
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.scans.depth_image import DepthScan, PinholeCamera
from oddsmap.scans.lazy_log import LazyLog
from oddsmap.scans.scan import Scan
from tests.plausibility.faults import headings_in_degrees, in_units, office, spoilt


def scan(number: int, beams: int = 4) -> Scan:
    pose = Pose2(float(number), 0.0, 0.0)
    return Scan(pose, np.tile([1.0, 0.0], (beams, 1)), np.full(beams, 2.0))


def test_it_hands_on_the_scans_and_keeps_a_few_whatever_their_number() -> None:
    for expected, count in ((None, 20_000), (20_000, 20_000), (10, 3_000), (3_000, 10), (None, 0)):
        sample = Sample(expected)
        scans = [scan(i) for i in range(count)]
        assert list(sample.watch(scans)) == scans
        assert len(sample.glances) <= 192
        starts = [int(earlier.pose.translation[0]) for earlier, _ in sample.pairs()]
        gaps = {int((b.pose.translation - a.pose.translation)[0]) for a, b in sample.pairs()}
        if count >= 3_000:
            assert gaps == {1, 4, 16}
            assert min(starts) == 0
            assert max(starts) >= 0.8 * count
            assert len(set(starts)) >= 12


def test_a_long_scan_is_thinned() -> None:
    sample = sample_of([scan(0, beams=100_000)])
    assert 400 <= len(sample.glances[0].points) <= 1024
    camera = PinholeCamera(300.0, 300.0, 160.0, 120.0, 320, 240)
    depth = np.full((240, 320), 2.0, np.float32)
    depth[:, :160] = 0.0  # nothing known
    pose = Pose3(np.zeros(3), np.eye(3))
    image = sample_of([DepthScan(pose, depth, camera)]).glances[0]
    assert 200 <= len(image.points) <= 1024
    np.testing.assert_allclose(image.points[:, 2], 2.0)
    assert (image.points[:, 0] >= 0).all()


def test_what_is_no_return_is_left_out_unless_all_are() -> None:
    ranges = np.array([1.0, 2.0, 30.0, np.inf, np.nan, -1.0, 0.0])
    directions = np.tile([0.0, 1.0], (7, 1))
    some = Scan(Pose2(0.0, 0.0, 0.0), directions, ranges)
    assert sample_of([some], range_max=30.0).glances[0].points[:, 1].tolist() == [1.0, 2.0]
    assert sample_of([some], range_max=31.0).glances[0].points[:, 1].tolist() == [1.0, 2.0, 30.0]
    assert sample_of([some], range_max=0.5).glances[0].typical_range == 2.0
    nothing = Scan(Pose2(0.0, 0.0, 0.0), directions[:1], ranges[3:4])
    assert math.isnan(sample_of([nothing]).glances[0].typical_range)
    assert check_log([nothing] * 5) == ()


def test_scans_without_a_pose_are_left_out() -> None:
    nowhere = Scan(Pose2(math.nan, 0.0, 0.0), np.array([[1.0, 0.0]]), np.ones(1))
    assert sample_of([nowhere]).glances == []
    assert check_log([]) == ()


def test_absurd_numbers_raise_nothing() -> None:
    pose = Pose2(1e300, -1e308, 1e200)
    far = [Scan(pose, np.tile([1.0, 0.0], (20, 1)), np.full(20, 1e308)) for _ in range(30)]
    codes = [doubt.code for doubt in check_log(far)]
    assert codes == ["range.unit"]


def test_of_a_log_that_reads_on_demand_few_scans_are_read() -> None:
    read: list[int] = []

    def read_scan(number: int) -> Scan:
        read.append(number)
        return scan(number)

    log = LazyLog(path="far", format="toy", scan_count=10_000, read_scan=read_scan)
    assert check_log(log) == ()
    assert len(read) == len(set(read)) <= 104
    assert max(read) >= 9_000


def test_a_watched_log_is_read_once_and_is_the_log() -> None:
    log = LazyLog(path="some", format="toy", scan_count=30, read_scan=scan, sensor={"range_max": 9})
    watched = WatchedLog(log, Sample(log.scan_count))
    assert (watched.path, watched.format, len(watched)) == ("some", "toy", 30)
    assert watched.sensor == {"range_max": 9}
    numbers = [s.map_from_sensor.translation[0] for s in watched]
    assert numbers == list(range(30))
    first = len(watched.sample.glances)
    assert list(watched) is not None
    assert len(watched.sample.glances) == first  # the second reading takes the place of the first


def test_doubts_are_those_of_what_was_read_so_far() -> None:
    log = spoilt(office(), in_units(1000))
    sample = Sample(len(log))
    watching: Iterator[object] = sample.watch(log)
    for _ in range(60):
        next(watching)
    assert [doubt.code for doubt in doubts_of_sample(sample)] == ["pose.unit"]


def test_a_log_of_both_kinds_is_left_to_those_who_refuse_it() -> None:
    space = Scan(Pose3(np.zeros(3), np.eye(3)), np.eye(3), np.ones(3))
    assert check_log([*spoilt(office(), headings_in_degrees), space]) == ()
