# SPDX-License-Identifier: Apache-2.0
"""Tables of observations: columns, scans, gaps, and what is wrong with a line."""

from __future__ import annotations

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from oddsmap.errors import ConfigError, InputError
from oddsmap.landmarks import ObservationTable, read_observations

POLAR = "x,y,theta,range,bearing,id"


def table(folder: Path, *lines: str) -> ObservationTable:
    path = folder / "seen.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_observations(path)


def test_scans_are_rows_of_one_pose(tmp_path: Path) -> None:
    found = table(
        tmp_path,
        "# a comment",
        "id, theta,range,bearing,x,y,colour",
        "3,0.5,1.0,0.1,1,2,red",
        "",
        "4,0.5,2.0,0.2,1,2,blue",
        "3,0.6,3.0,0.3,1,2,red",
        "3.0,0.5,4.0,0.4,1,2,red",
    )
    assert found.kind == "range-bearing"
    scans = list(found.scans(sigma_range=0.2, sigma_bearing=0.1))
    assert [len(scan) for scan in scans] == [2, 1, 1]
    assert scans[0].values.tolist() == [[1.0, 0.1], [2.0, 0.2]]
    assert scans[0].ids is not None
    assert scans[0].ids.tolist() == [3, 4]
    pose = scans[1].map_from_sensor
    assert (pose.translation.tolist(), getattr(pose, "theta", None)) == ([1.0, 2.0], 0.6)
    assert np.allclose(scans[0].covariance, np.diag([0.04, 0.01]))


def test_stamps_tell_scans_of_one_place_apart(tmp_path: Path) -> None:
    rows = ("0,0,0,1,1,1.5", "0,0,0,2,2,1.5", "0,0,0,1,1,1.6")
    found = table(tmp_path, "x,y,theta,dx,dy,stamp", *rows)
    assert found.kind == "position"
    assert [len(scan) for scan in found.scans(sigma_xy=0.1)] == [2, 1]
    assert found.ids is None


def test_gaps_are_counted(tmp_path: Path) -> None:
    found = table(
        tmp_path,
        POLAR,
        "0,0,0,1,0.1,1",
        "nan,0,0,1,0.1,1",
        "0,0,inf,1,0.1,",
        "0,0,0,1,0.1,",
        "0,0,0,1,0.1,nan",
        "0,0,0,1,0.1,-1",
        "0,0,0,nan,0.1,2",
        "0,0,0,,0.1,2",
    )
    assert found.skipped == {"observation.nan_pose": 2, "observation.no_id": 3}
    assert len(found.starts) == 1
    assert np.isnan(found.values[:, 0]).tolist() == [False, True, True]


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["x,y,theta,range", "0,0,0,1"], ":1: no landmarks in the columns x, y, theta, range"),
        (["x,y,bearing", "0,0,1"], ":1: no column `theta`"),
        (["x,y,theta,bearing,dx,dy", "0,0,0,1,1,1"], ":1: columns of two kinds"),
        (["x,y,theta,dx", "0,0,0,1"], ":1: no landmarks"),
        (["x,x,y,theta,bearing", "0,0,0,0,0"], ":1: column `x` is there twice"),
        ([POLAR, "0,0,0,1,0.1,1", "0,0,0,1,0.1"], ":3: 5 values where the header announces 6"),
        ([POLAR, "0,0,0,1_0,0.1,1"], ":2: '1_0' in column `range` is not a number"),
        ([POLAR, "# c", "0,0,0,1,east,1"], ":3: 'east' in column `bearing` is not a number"),
        ([POLAR, "0,0,0,1,0.1,1.5"], ":2: the id 1.5 is not an integer"),
        ([POLAR, "0,0,0,1,0.1,tree"], ":2: 'tree' in column `id`"),
        ([POLAR, "0,0,0,1,0.1," + "9" * 5000], ":2: the id inf is not an integer of 64 bits"),
        ([POLAR, "0,0,0,1,0.1," + "9" * 30], ":2: the id a whole number of about 31 digits is"),
        ([POLAR, "0,0,0,1,0.1,1", "0,0,0,1,45,1"], ":3: a bearing of 45"),
        ([POLAR, "nan,0,0,1,0.1,1"], "no usable observation in 1 rows"),
        ([POLAR], "no usable observation in 0 rows"),
        (["# nothing"], "no column `x`, found none"),
    ],
)
def test_bad_tables(tmp_path: Path, lines: list[str], message: str) -> None:
    with pytest.raises(InputError) as caught:
        table(tmp_path, *lines)
    text = str(caught.value)
    assert text.startswith(str(tmp_path / "seen.csv"))
    assert message in text
    assert "\n" not in text


def test_noise_must_be_given(tmp_path: Path) -> None:
    found = table(tmp_path, "x,y,theta,bearing", "0,0,0,1")
    assert found.kind == "bearing"
    for sigma in (None, 0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ConfigError, match="positive sigma_bearing"):
            list(found.scans(sigma_bearing=sigma))


def test_npz_gives_the_same(tmp_path: Path) -> None:
    found = table(tmp_path, POLAR, "1,2,0.5,1,0.1,3", "1,2,0.5,2,0.2,4", "1,3,0.5,2,0.2,")
    columns = np.loadtxt(["1 2 .5 1 .1 3", "1 2 .5 2 .2 4", "1 3 .5 2 .2 nan"])
    path = tmp_path / "seen.npz"
    np.savez(path, **dict(zip(POLAR.split(","), columns.T, strict=True)), other=np.zeros((2, 2)))
    again = read_observations(path)
    packed = tmp_path / "seen.csv.gz"
    packed.write_bytes(gzip.compress((tmp_path / "seen.csv").read_bytes()))
    for other in (again, read_observations(packed)):
        assert other.kind == found.kind
        assert other.skipped == found.skipped == {"observation.no_id": 1}
        for name in ("poses", "values", "ids", "starts"):
            assert np.array_equal(getattr(other, name), getattr(found, name))


def test_bad_npz(tmp_path: Path) -> None:
    path = tmp_path / "seen.npz"
    fine = {name: np.zeros(3) for name in ("x", "y", "theta", "bearing")}
    for change, message in (
        ({"x": np.zeros(2)}, "`x` holds float64 of shape (2,)"),
        ({"y": np.array(["a", "b", "c"])}, "`y` holds"),
        ({"id": np.array([0.0, 0.5, 1.0])}, "row 1: the id 0.5"),
        ({"bearing": np.array([0.0, 0.0, 90.0])}, "row 2: a bearing of 90"),
        ({"bearing": np.array([None, 0, 1])}, "cannot be read"),
    ):
        np.savez(path, **fine | change)
        with pytest.raises(InputError) as caught:
            read_observations(path)
        assert str(caught.value).startswith(str(path))
        assert message in str(caught.value)
    np.savez(path, x=np.zeros(3))
    with pytest.raises(InputError, match="no column `y`"):
        read_observations(path)
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(InputError, match="corrupt or truncated"):
        read_observations(path)
