# SPDX-License-Identifier: Apache-2.0
"""Poses as other programs export them: found by the names of their columns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from oddsmap.errors import InputError
from oddsmap.poses.pose import Pose3
from oddsmap.readers.pose_file import PoseFile, read_pose_file

# Half a turn about z, and a quarter; the last one turned about x and y, too.
PLACES = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
TURNS = [[0.0, 0.0, 1.0, 0.0], [0.1, 0.2, 0.3, 0.9273618495495703]]
MATRICES = [Pose3.from_quaternion_xyzw(np.zeros(3), turn).rotation for turn in TURNS]
STAMPS = [1600000000_020000000, 1600000000_120000005]


def file_of(folder: Path, *lines: str, positions_do: bool = False) -> PoseFile:
    path = folder / "p.csv"
    path.write_text("\n".join(lines) + "\n")
    return read_pose_file(path, positions_do=positions_do)


def check(file: PoseFile, stamps: list[int] | None = STAMPS) -> None:
    np.testing.assert_array_equal(file.trajectory.positions, PLACES)
    np.testing.assert_allclose(file.trajectory.rotations, MATRICES, atol=1e-7)
    found = file.trajectory.stamps_ns
    assert (None if found is None else found.tolist()) == stamps


def words(i: int) -> str:
    return ",".join(str(v) for v in (*PLACES[i], *TURNS[i]))


def test_rostopic_echo(tmp_path: Path) -> None:
    """The stamp of the header counts, not the time of writing; twists are not poses."""
    header = "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.child_frame_id,"
    header += ",".join(f"field.pose.pose.position{n}" for n in (".x", ".y", ".z"))
    header += "," + ",".join(f"field.pose.pose.orientation.{n}" for n in "xyzw")
    header += ",field.pose.covariance0,field.twist.twist.linear.x,field.twist.twist.angular.x"
    rows = [f"{STAMPS[i] + 7},{i},{STAMPS[i]},odom,base,{words(i)},0.1,9,9" for i in range(2)]
    file = file_of(tmp_path, header, *rows)
    check(file)
    assert file.notes == ()


def test_rostopic_echo_in_simulated_time(tmp_path: Path) -> None:
    """Few digits, and still nanoseconds."""
    names = [f"field.pose.position.{n}" for n in "xyz"]
    names += [f"field.pose.orientation.{n}" for n in "xyzw"]
    rows = [f"99,{stamp},{words(i)}" for i, stamp in enumerate((12, 500))]
    check(file_of(tmp_path, f"%time,field.header.stamp,{','.join(names)}", *rows), [12, 500])


def test_pandas(tmp_path: Path) -> None:
    """A nameless index, quoted lists with commas, two columns for a stamp, w first."""
    names = ["", "Time", "header.seq", "header.stamp.secs", "header.stamp.nsecs"]
    names += ["header.frame_id", "pose.pose.orientation.w"]
    names += [f"pose.pose.orientation.{n}" for n in "xyz"]
    names += [f"pose.pose.position.{n}" for n in "xyz"] + ["pose.covariance", "twist.linear.x"]
    rows = []
    for i in range(2):
        values = words(i).split(",")
        place, turn = values[:3], values[3:]
        row = [str(i), "17.5", str(i), *map(str, divmod(STAMPS[i], 10**9)), "the map"]
        row += [turn[3], *turn[:3], *place, '"(0.1, 0.0, 0.2)"', "9"]
        rows.append(",".join(row))
    file = file_of(tmp_path, ",".join(names), *rows)
    check(file)
    assert "its quaternions are qw qx qy qz" in file.notes[0]


def test_plotjuggler(tmp_path: Path) -> None:
    names = ["__time", *[f"/odom/pose/pose/position/{n}" for n in "xyz"]]
    names += [f"/odom/pose/pose/orientation/{n}" for n in "xyzw"]
    rows = [f"{i}.5,{words(i)}" for i in range(2)]
    check(file_of(tmp_path, ",".join(names), *rows), [500_000_000, 1_500_000_000])


@pytest.mark.parametrize("frames", ["odom", "odom,base_link"])
def test_ros2_topic_echo_without_a_header(tmp_path: Path, frames: str) -> None:
    rows = []
    for i in range(2):
        seconds, nanoseconds = divmod(STAMPS[i], 10**9)
        rows.append(f"{seconds},{nanoseconds},{frames},{words(i)},0.0,0.1")
    file = file_of(tmp_path, *rows)
    check(file)
    assert "taken for those of ros2 topic echo --csv" in file.notes[0]


PLANE = [[[0, -1, 0], [1, 0, 0], [0, 0, 1]], [[-1, 0, 0], [0, -1, 0], [0, 0, 1]]]
HALF_PI, PI = str(np.pi / 2), str(np.pi)


@pytest.mark.parametrize(
    ("lines", "doubt"),
    [
        ([f"0.5 1 2 {HALF_PI}", f"1.5 4 5 {PI}"], "4 numbers are taken for t x y theta [rad]"),
        (["t x y theta", f"0.5 1 2 {HALF_PI}", f"1.5 4 5 {PI}"], ""),
        (["time,x,y,yaw", f"0.5,1,2,{HALF_PI}", f"1.5,4,5,{PI}"], ""),
        (["t,x [m],y [m],theta [deg]", "0.5,1,2,90", "1.5,4,5,180"], ""),
        (["# x y yaw_deg t", "1 2 90 0.5", "4 5 180 1.5"], ""),
    ],
)
def test_a_robot_in_the_plane(tmp_path: Path, lines: list[str], doubt: str) -> None:
    file = file_of(tmp_path, *lines)
    np.testing.assert_array_equal(file.trajectory.positions, [[1, 2, 0], [4, 5, 0]])
    np.testing.assert_allclose(file.trajectory.rotations, PLANE, atol=1e-9)
    assert file.trajectory.stamps_ns is not None
    assert file.trajectory.stamps_ns.tolist() == [500_000_000, 1_500_000_000]
    assert doubt in "".join(file.notes)
    assert bool(file.notes) == bool(doubt)


def test_four_numbers_that_are_no_angle(tmp_path: Path) -> None:
    message = r"p\.csv:2: 4 numbers, of which '90' is no angle in radians: write a header .*\[deg\]"
    with pytest.raises(InputError, match=message):
        file_of(tmp_path, "0.5 1 2 3", "1.5 4 5 90")


@pytest.mark.parametrize(
    ("name", "first", "stamp"),
    [
        ("timestamp_s", "1600000000.25", 1600000000_250000000),
        ("time [s]", "0.5", 500_000_000),
        ("Time[s]", "0.5", 500_000_000),
        ("timestamp [ms]", "1600000000250.5", 1600000000_250500000),
        ("t_ms", "1500", 1_500_000_000),
        ("utime", "1600000000250001", 1600000000_250001000),
        ("timestamp_us", "1600000000250001", 1600000000_250001000),
        ("#timestamp [us]", "7", 7000),
        ("timestamp_ns", "1600000000250001002", 1600000000_250001002),
        ("#timestamp [ns]", "12", 12),
    ],
)
def test_units_of_stamps(tmp_path: Path, name: str, first: str, stamp: int) -> None:
    file = file_of(tmp_path, f"{name},x,y,z,qx,qy,qz,qw", f"{first},1,2,3,0,0,0,1")
    assert file.trajectory.stamps_ns is not None
    assert file.trajectory.stamps_ns.tolist() == [stamp]
    assert file.notes == ()


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("t [days],x,y,z,qx,qy,qz,qw", "t is in days: write stamps in s, ms, us or ns"),
        ("t,x [mm],y [mm],z [mm],qx,qy,qz,qw", "x is in mm: write positions in metres"),
        ("t,x,y,yaw [gon]", "yaw is in gon: write it in rad or deg"),
    ],
)
def test_units_that_are_not_read(tmp_path: Path, header: str, message: str) -> None:
    row = ",".join(["1", "1", "2", "3", "0", "0", "0", "1"][: header.count(",") + 1])
    with pytest.raises(InputError, match=rf"p\.csv: {message}"):
        file_of(tmp_path, header, row)


def test_a_stamp_by_a_name_that_is_not_known(tmp_path: Path) -> None:
    (note,) = file_of(tmp_path, "when,x,y,z,qx,qy,qz,qw", "5,1,2,3,0,0,0,1").notes
    assert "the header names no stamp, and 'when' is not known as one" in note
    assert note.severity == "warning"


def test_angles_beyond_a_turn_may_be_degrees(tmp_path: Path) -> None:
    lines = ["t x y theta", "0.5 1 2 90", "1.5 4 5 359"]
    (note,) = file_of(tmp_path, *lines).notes
    assert "angles of up to 359 are taken for radians: if they are degrees" in note
    assert note.severity == "warning"


def test_survey_coordinates_are_exact(tmp_path: Path) -> None:
    """UTM: a northing of millions of metres, in doubles, keeps each micrometre."""
    lines = [
        "easting,northing,height,qw,qx,qy,qz,t",
        "448262.123456,5412345.654321,312.25,1,0,0,0,1",
    ]
    file = file_of(tmp_path, *lines)
    place = [448262.123456, 5412345.654321, 312.25]
    assert file.trajectory.positions.tolist() == [place]


@pytest.mark.parametrize(
    "header", ["t x y z", "GPSTime,X,Y,Z,roll,pitch,heading", "t,easting,northing,altitude"]
)
def test_positions_alone(tmp_path: Path, header: str) -> None:
    count = len(header.replace(",", " ").split())
    lines = [header, ",".join(["0.5", "1", "2", "3", "7", "8", "9"][:count])]
    lines = lines if "," in header else [line.replace(",", " ") for line in lines]
    file = file_of(tmp_path, *lines, positions_do=True)
    assert file.trajectory.positions.tolist() == [[1, 2, 3]]
    assert "positions without rotations" in file.notes[0]
    with pytest.raises(InputError, match=r"the columns are positions, x y z, without rotations"):
        file_of(tmp_path, *lines)


@pytest.mark.parametrize(
    "lines",
    [
        ["%time,field.header.stamp,field.latitude,field.longitude,field.altitude", "1,1,47,8,400"],
        ["lat lon", "47 8"],
        ['<?xml version="1.0"?>', '<gpx version="1.1"><trk>', "</trk></gpx>"],
    ],
)
def test_fixes_of_gps_are_no_poses(tmp_path: Path, lines: list[str]) -> None:
    for positions_do in (False, True):
        with pytest.raises(InputError, match=r"of GPS does not say where (the|a) sensor looks"):
            file_of(tmp_path, *lines, positions_do=positions_do)


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["t x y z roll pitch", "1 2 3 4 5 6"], "without rotations"),
        (["t x y range bearing", "1 2 3 4 5"], "this one names t x y range bearing"),
        (["header.stamp.secs,header.stamp.nsecs,x,y,theta", "1.5,0,1,2,3"], "'1.5 0' is no stamp"),
        (["header.stamp.secs,header.stamp.nsecs,x,y,theta", "9999999999,0,1,2,3"], "is no stamp"),
        (["t,x,y,theta", "1,2,,3"], "'' is not a number"),
        (["/a/position/x,/a/position/y,/a/position/z,/b/position/x", "1,2,3,4"], "4 numbers"),
    ],
)
def test_what_cannot_be_told_is_one_line(tmp_path: Path, lines: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        file_of(tmp_path, *lines)
    assert "\n" not in str(caught.value)
