# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap build` says of a log that cannot be what it says: it is mapped, with a doubt."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import oddsmap
from oddsmap.simulate import write_carmen
from tests.cli.conftest import Run
from tests.plausibility.faults import (
    Change,
    headings_in_degrees,
    in_units,
    inverted,
    office,
    ranges_in_units,
    spoilt,
)


def carmen(folder: Path, *changes: Change) -> Path:
    path = folder / "office.log"
    write_carmen(path, spoilt(office(), *changes), no_return=81830.0)
    return path


def test_a_good_log(run: Run, tmp_path: Path) -> None:
    done = run("build", carmen(tmp_path), "--resolution", 0.1, "-o", tmp_path / "map.zarr")
    assert done.status == 0
    assert "are these" not in done.out + done.err


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (headings_in_degrees, "are these headings in degrees?"),
        (inverted, "are these poses that take the map to the sensor?"),
        (in_units(1000), "are these positions in millimetres beside ranges in metres?"),
    ],
)
def test_a_doubtful_log_is_mapped(run: Run, tmp_path: Path, change: Change, words: str) -> None:
    log = carmen(tmp_path, change)
    done = run("build", log, "--resolution", 0.5, "-o", tmp_path / "map.zarr")
    assert done.status == 0
    lines = [line for line in done.out.splitlines() if "are these" in line]
    assert len(lines) == 1
    assert lines[0].startswith(f"{log}: warning: {words}")
    assert "; if so, " in lines[0]


def test_json_stays_json(run: Run, tmp_path: Path) -> None:
    log = carmen(tmp_path, in_units(1000))
    done = run("build", log, "--resolution", 0.5, "-o", tmp_path / "map.zarr", "--json")
    assert done.json["scans"] == len(office())
    assert "are these positions in millimetres" in done.err


def test_a_doubt_goes_before_the_error_that_it_explains(run: Run, tmp_path: Path) -> None:
    log = carmen(tmp_path, ranges_in_units(1000))
    done = run("build", log, "--resolution", 0.01, "-o", tmp_path / "map.zarr")
    assert done.status == 1
    doubt, error = done.err.splitlines()
    assert doubt.startswith(f"{log}: warning: are these ranges in millimetres?")
    assert error.startswith(f"oddsmap: {log}: one scan spans")


@pytest.mark.parametrize("hold_out", [(), ("--hold-out", 0.1)])
def test_a_look_changes_no_bit(run: Run, tmp_path: Path, hold_out: tuple[object, ...]) -> None:
    log = carmen(tmp_path)
    out = tmp_path / "map.zarr"
    assert run("build", log, "--resolution", 0.1, "-o", out, *hold_out).status == 0
    scans = list(oddsmap.open_log(log))
    if hold_out:
        scans = [s for number, s in enumerate(scans, 1) if number % 10]
    direct = oddsmap.build_map(scans, 0.1, sensor=oddsmap.BeamSensor())
    for mine, theirs in zip(oddsmap.load_map(out).cells(), direct.cells(), strict=True):
        np.testing.assert_array_equal(mine, theirs)


def test_a_full_map_is_watched_too(run: Run, tmp_path: Path) -> None:
    beams = [
        (1000 * pose.translation[0], 1000 * pose.translation[1], math.atan2(*axis[::-1]), reading)
        for scan in office()[:60]
        for pose in (scan.map_from_sensor,)
        for axis, reading in zip(
            scan.directions[::6] @ pose.rotation.T, scan.ranges[::6], strict=True
        )
    ]
    path = tmp_path / "beams.npz"
    np.savez(path, beams=np.array(beams), scan=np.repeat(np.arange(60), len(beams) // 60),
             range_max=8.0)  # fmt: skip
    done = run("build", path, "--resolution", 1.0, "-o", tmp_path / "map.zarr", "--estimator",
               "full-map", "--sweeps", 1)  # fmt: skip
    assert done.status == 0
    assert "are these positions in millimetres" in done.out


@pytest.mark.parametrize(("scale", "doubtful"), [(1.0, False), (180 / np.pi, True)])
def test_headings_of_beams_in_degrees(
    run: Run, tmp_path: Path, scale: float, doubtful: bool
) -> None:
    headings = np.linspace(-3.0, 3.0, 50)
    beams = np.stack([headings * 0, headings * 0, headings * scale, headings * 0 + 2.0], axis=1)
    np.savez(tmp_path / "beams.npz", beams=beams, range_max=5.0)
    notes = oddsmap.open_log(tmp_path / "beams.npz").notes
    found = [note for note in notes if note.code == "pose.headings_in_degrees"]
    assert len(found) == doubtful
    if doubtful:
        assert found[0].severity == "warning"
        assert "They reach 171.9 and are read as radians" in found[0]
