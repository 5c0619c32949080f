# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap.poses.pose import Pose2
from oddsmap.readers.carmen_messages import (
    BadLineError,
    LaserLine,
    beam_directions,
    parse_flaser_text,
    parse_laser_line,
)


def parse(text: str) -> LaserLine:
    """As any line is read; the way for most lines must say the same, or nothing."""
    fields = text.encode().split()
    quick = parse_flaser_text(text.encode()) if fields[0] in (b"FLASER", b"RLASER") else None
    try:
        line = parse_laser_line(fields[0].decode(), fields)
    except BadLineError:
        assert quick is None
        raise
    assert quick is None or said(quick) == said(line)
    return line


def said(line: LaserLine) -> tuple[object, ...]:
    pose = line.map_from_sensor
    place = (pose.x.hex(), pose.y.hex(), pose.theta.hex())
    return line.kind, line.ranges.tobytes(), line.start, line.step, line.stamp_ns, place


def flaser(
    ranges: list[str], *, count: int | str | None = None, pose: str = "3 4 0.5", ipc: str = "10.5"
) -> str:
    n = len(ranges) if count is None else count
    return f"FLASER {n} {' '.join(ranges)} {pose} 7 8 0.9 {ipc} host 11"


def robotlaser(
    ranges: list[str],
    *,
    geometry: str = "-1.0 2.0 0.25",
    maximum: str = "81.9",
    count: int | None = None,
    remissions: str = "0",
    end: str = "10.5 host 11",
) -> str:
    n = len(ranges) if count is None else count
    return (
        f"ROBOTLASER1 0 {geometry} {maximum} 0.01 0 {n} {' '.join(ranges)} {remissions} "
        f"3 4 0.5 7 8 0.9 0.1 0.2 0.3 0.4 100000 {end}"
    )


def rejected(text: str) -> tuple[str, str]:
    with pytest.raises(BadLineError) as caught:
        parse(text)
    return caught.value.reason, str(caught.value)


def angles_deg(line: LaserLine) -> list[float]:
    directions = beam_directions(line.start, line.step, len(line.ranges))
    np.testing.assert_allclose(np.hypot(*directions.T), 1.0, rtol=1e-15)
    return [float(a) for a in np.degrees(np.arctan2(directions[:, 1], directions[:, 0]))]


@pytest.mark.parametrize("kind", ["FLASER", "RLASER"])
def test_flaser_uses_the_laser_pose_not_the_odometry(kind: str) -> None:
    line = parse(flaser(["1.25", "2"]).replace("FLASER", kind))
    assert line.kind == kind
    assert line.map_from_sensor == Pose2(3.0, 4.0, 0.5)
    assert line.ranges.tolist() == [1.25, 2.0]
    assert line.stamp_ns == 10_500_000_000
    assert line.maximum_range is None


@pytest.mark.parametrize(
    ("n", "first", "last", "step"),
    [
        (180, -90, 89, 1),
        (181, -90, 90, 1),
        (360, -90, 89.5, 0.5),
        (361, -90, 90, 0.5),
        (4, -90, 45, 45),
        (3, -90, 90, 90),
    ],
)
def test_an_even_count_leaves_out_the_last_end_and_an_odd_one_has_both(
    n: int, first: float, last: float, step: float
) -> None:
    angles = angles_deg(parse(flaser(["1"] * n)))
    assert angles[0] == pytest.approx(first)
    assert angles[-1] == pytest.approx(last)
    np.testing.assert_allclose(np.diff(angles), step, rtol=1e-9)


def test_a_single_beam_looks_ahead() -> None:
    assert angles_deg(parse(flaser(["1"]))) == [0.0]


def test_equal_geometry_shares_one_array() -> None:
    assert beam_directions(-1.0, 0.5, 9) is beam_directions(-1.0, 0.5, 9)
    assert beam_directions(-1.0, 0.5, 9) is not beam_directions(-1.0, 0.5, 8)


def test_nan_and_infinite_readings_survive() -> None:
    ranges = parse(flaser(["nan", "inf", "-inf", "1.5"])).ranges
    np.testing.assert_array_equal(ranges, [np.nan, np.inf, -np.inf, 1.5])


@pytest.mark.parametrize("pose", ["nan 4 0.5", "3 inf 0.5", "3 4 -inf"])
def test_a_pose_that_is_not_finite_is_counted(pose: str) -> None:
    reason, message = rejected(flaser(["1", "2"], pose=pose))
    assert reason == "scan.nan_pose"
    assert "FLASER" in message


def test_nan_odometry_does_no_harm() -> None:
    line = parse("FLASER 1 2.5 3 4 0.5 nan nan nan 10.5 host 11")
    assert line.map_from_sensor == Pose2(3.0, 4.0, 0.5)


def test_one_range_too_few() -> None:
    assert rejected(flaser(["1"] * 179, count=180)) == (
        "line.short",
        "FLASER announces 180 ranges, the line has 179",
    )


@pytest.mark.parametrize("text", ["FLASER", "FLASER 180", "FLASER 180 1 2 3"])
def test_a_line_that_ends_early(text: str) -> None:
    assert rejected(text)[0] == "line.short"


def test_one_range_too_many_would_shift_the_pose() -> None:
    assert rejected(flaser(["1"] * 181, count=180)) == (
        "line.long",
        "FLASER announces 180 ranges, the line has 1 fields too many",
    )


def test_columns_added_at_the_end_do_no_harm() -> None:
    line = parse(flaser(["1", "2"]) + " 5 extra")
    assert line.map_from_sensor == Pose2(3.0, 4.0, 0.5)


def test_a_host_may_be_a_number_where_the_count_fits() -> None:
    assert len(parse(flaser(["1", "2"]).replace("host", "127001")).ranges) == 2


@pytest.mark.parametrize("bad", ["abc", "1,5", "1_0", "--", "1.2.3"])
def test_what_is_not_a_number_is_named(bad: str) -> None:
    reason, message = rejected(flaser(["1", bad, "2"]))
    assert reason == "line.malformed"
    assert message == f"FLASER needs numbers, got '{bad}'"
    assert rejected(flaser(["1"], pose=f"3 {bad} 0.5"))[0] == "line.malformed"


@pytest.mark.parametrize("count", ["x", "-3", "2.0", "1_0", "9" * 5000])
def test_a_count_that_is_no_count(count: str) -> None:
    reason, message = rejected(flaser(["1", "2"], count=count))
    assert reason == "line.malformed"
    assert message.startswith("FLASER needs a number of ranges in field 1, got '")
    assert len(message) < 100


def test_no_ranges_is_an_empty_scan() -> None:
    assert rejected("FLASER 0 3 4 0.5 7 8 0.9 10.5 host 11")[0] == "scan.empty"


@pytest.mark.parametrize(
    ("text", "stamp_ns"),
    [
        ("0", 0),
        ("1071078718.462369", 1_071_078_718_462_369_000),
        ("1.01893e+09", 1_018_930_000_000_000_000),
        ("-1", None),
        ("nan", None),
        ("inf", None),
        ("1e300", None),
        ("9223372037", None),
        ("late", None),
    ],
)
def test_a_stamp_is_exact_or_absent(text: str, stamp_ns: int | None) -> None:
    assert parse(flaser(["1"], ipc=text)).stamp_ns == stamp_ns


def test_robotlaser_says_its_geometry() -> None:
    line = parse(robotlaser(["1", "2", "3"], remissions="2 50 60"))
    assert line.map_from_sensor == Pose2(3.0, 4.0, 0.5)
    assert line.ranges.tolist() == [1.0, 2.0, 3.0]
    assert line.stamp_ns == 10_500_000_000
    assert line.maximum_range == 81.9
    np.testing.assert_allclose(np.radians(angles_deg(line)), [-1.0, -0.75, -0.5])


def test_robotlaser2_is_read_alike() -> None:
    line = parse(robotlaser(["1"]).replace("ROBOTLASER1", "ROBOTLASER2"))
    assert line.kind == "ROBOTLASER2"
    assert math.isclose(line.start, -1.0)


@pytest.mark.parametrize("resolution", ["0", "nan", "inf", "0.0"])
def test_a_missing_resolution_follows_from_the_field_of_view(resolution: str) -> None:
    line = parse(robotlaser(["1"] * 5, geometry=f"-1.0 2.0 {resolution}"))
    np.testing.assert_allclose(np.radians(angles_deg(line)), [-1, -0.5, 0, 0.5, 1], atol=1e-15)


@pytest.mark.parametrize("geometry", ["nan 2 0.25", "-1 0 0", "-1 nan nan", "inf 2 0.25"])
def test_robotlaser_without_geometry_is_malformed(geometry: str) -> None:
    reason, message = rejected(robotlaser(["1", "2"], geometry=geometry))
    assert reason == "line.malformed"
    assert "angular resolution" in message


@pytest.mark.parametrize("maximum", ["0", "-1", "nan", "inf"])
def test_a_maximum_range_that_says_nothing_is_none(maximum: str) -> None:
    assert parse(robotlaser(["1"], maximum=maximum)).maximum_range is None


def test_robotlaser_lengths() -> None:
    assert rejected(robotlaser(["1"] * 4, count=5)) == (
        "line.short",
        "ROBOTLASER1 announces 5 ranges, the line has 4",
    )
    reason, message = rejected(robotlaser(["1"] * 4, remissions="3 1 2"))
    assert reason == "line.short"
    assert message.startswith("ROBOTLASER1 announces 4 ranges and 3 remissions, which make 31 ")
    assert message.endswith("the line has 30")
    assert rejected(robotlaser(["1"] * 4, remissions="0 7"))[0] == "line.long"
    # The fifth range stands where the number of remissions should.
    reason, message = rejected(robotlaser(["1.5"] * 5, count=4))
    assert reason == "line.malformed"
    assert message == "ROBOTLASER1 needs a number of remissions in field 13, got '1.5'"
    assert len(parse(robotlaser(["1"], end="10.5 host 11 more")).ranges) == 1


def test_robotlaser_not_numbers() -> None:
    assert rejected(robotlaser(["1", "x"]))[0] == "line.malformed"
    assert rejected(robotlaser(["1"], geometry="-1 2 wide"))[0] == "line.malformed"
    assert rejected(robotlaser(["1"], remissions="1.5"))[0] == "line.malformed"


# What happens to lines: words lost, doubled, put in and spoilt.
WORDS = [
    "1.5",
    "-0",
    "3",
    "",
    "  ",
    "\t",
    "nan",
    "inf",
    "1e-3",
    "host",
    "1_0",
    "4.",
    ".5",
    "9" * 20,
]


@given(
    st.integers(0, 5),
    st.lists(st.tuples(st.integers(0, 16), st.integers(0, 2), st.sampled_from(WORDS)), max_size=3),
)
@settings(max_examples=500)
def test_both_ways_to_read_a_line_agree(n: int, damage: list[tuple[int, int, str]]) -> None:
    words = flaser([f"{k}.25" for k in range(n)]).split()
    for place, lost, put in damage:
        at = min(place, len(words))
        words[at : at + lost] = [put]
    with contextlib.suppress(BadLineError):
        parse("FLASER " + " ".join(words[1:]))


def test_most_lines_go_the_quick_way() -> None:
    line = parse_flaser_text(flaser(["1.25", "81.83", "0.50"]).encode())
    assert line is not None
    assert line.ranges.tolist() == [1.25, 81.83, 0.5]
