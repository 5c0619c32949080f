# SPDX-License-Identifier: Apache-2.0
"""Mistakes that a newcomer made: each is answered, and nothing is lost."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import oddsmap
from oddsmap import ConeSensor, EvidenceMap, InputError, OutputError, Pose2, Scan, build_map
from oddsmap.map_files.zarr_folder import check_map_output
from oddsmap.sensors.usable_beams import usable_beams
from tests.kit import fan_scan

CONE = ConeSensor(cone_deg=20.0, range_max=4.0)


def test_no_folder_of_other_things_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "clouds").mkdir()
    (tmp_path / "clouds" / "thesis.txt").write_text("years")
    with pytest.raises(OutputError, match="is a folder and no map"):
        check_map_output(tmp_path / "clouds", force=True)
    grid = build_map([fan_scan(0.0, 0.0, 0.0, [1.0])], 0.5)
    grid.save(tmp_path / "m.zarr")
    grid.save(tmp_path / "m.zarr", force=True)
    (tmp_path / "empty").mkdir()
    grid.save(tmp_path / "empty", force=True)


def test_a_cone_that_reads_its_range_max_saw_nothing() -> None:
    """For the forward model a fault is a dropout; for the filter it may be anything."""
    ranges = np.array([1.0, 4.0, 5.0, np.inf, np.nan])
    directions = np.tile([1.0, 0.0], (5, 1))
    scans = [Scan(Pose2(0.0, 0.0, 0.0), directions, ranges)]
    beams, _, skipped = usable_beams(scans, CONE)
    assert beams.ranges.tolist() == [1.0, np.inf, np.inf, np.inf]
    assert skipped == {"beam.nan": 1}
    narrow = oddsmap.BeamSensor(range_max=4.0)
    beams, _, skipped = usable_beams(scans, narrow)
    assert beams.ranges.tolist() == [1.0, np.inf]
    assert skipped == {"beam.nan": 1, "beam.no_return": 2}


def test_reflectivity_counted_under_cones_is_warned_of() -> None:
    grid = EvidenceMap(0.1, sensor=CONE)
    with pytest.warns(UserWarning, match="build_reflection_map"):
        grid.reflection()


def test_only_evidence_adds_up() -> None:
    grid = EvidenceMap(0.1)
    for other in (grid.log_odds(), 3):
        with pytest.raises(InputError, match="only evidence is added"):
            grid.merge(other)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"give grid\.log_odds\(\)"):
        oddsmap.changed(grid, grid)  # type: ignore[arg-type]


def test_a_map_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        oddsmap.load_map(tmp_path / "nosuch.zarr")
