# SPDX-License-Identifier: Apache-2.0
"""`oddsmap landmarks`."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from oddsmap.landmarks import LandmarkMap
from tests.cli.conftest import Run
from tests.landmarks.kit import circle, observe

MARKS = np.array([[0.0, 0.0], [6.0, 3.0], [-4.0, 5.0], [15.0, 15.0]])


def write(path: Path, columns: str, *, ids: bool, more: str = "") -> Path:
    """A drive on a circle; `columns` are those of the observations."""
    kinds = {"range,bearing": "range-bearing", "bearing": "bearing", "dx,dy": "position"}
    rng = np.random.default_rng(0)
    lines = [f"x,y,theta,{columns}" + ",id" * ids]
    for pose in circle(16):
        scan = observe(kinds[columns], pose, MARKS, rng)  # type: ignore[arg-type]
        for name, values in enumerate(scan.values.tolist()):
            words = [pose.x, pose.y, pose.theta, *values]
            lines.append(",".join(map(str, words)) + f",{name}" * ids)
    path.write_text("\n".join(lines) + "\n" + more, encoding="utf-8")
    return path


@pytest.fixture
def seen(tmp_path: Path) -> Path:
    return write(tmp_path / "seen.csv", "range,bearing", ids=True)


@pytest.mark.parametrize("columns", ["range,bearing", "bearing", "dx,dy"])
def test_a_table_of_landmarks(run: Run, tmp_path: Path, columns: str) -> None:
    source = write(tmp_path / "seen.csv", columns, ids=True)
    options = () if columns == "dx,dy" else ("--sigma-bearing", 2)
    done = run("landmarks", source, *options, "-o", tmp_path / "marks.csv")
    assert done.status == 0, done.err
    assert done.err == ""
    assert "found    4 landmarks" in done.out
    with (tmp_path / "marks.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for row, true in zip(rows, MARKS, strict=True):
        for axis, at in zip("xy", true, strict=True):
            sigma = math.sqrt(float(row[f"cov_{axis}{axis}"]))
            assert sigma < 0.4
            assert abs(float(row[axis]) - at) < 4.0 * sigma


def test_json_on_stdout_and_on_disk(run: Run, tmp_path: Path) -> None:
    more = "0,0,0,nan,0.1\nnan,0,0,1,1\n"
    source = write(tmp_path / "seen.csv", "range,bearing", ids=False, more=more)
    output = tmp_path / "marks.json"
    done = run("landmarks", source, "--sigma-bearing", 2, "--json", "-o", output)
    facts = done.json
    assert done.err == ""
    skipped = facts.pop("skipped")
    assert skipped.pop("observation.nan") == 1
    assert skipped.pop("observation.nan_pose") == 1
    assert facts["observations"] + sum(skipped.values()) == 64
    assert facts | {"observations": 64} == {
        "output": str(output),
        "kind": "range-bearing",
        "association": "unknown",
        "scans": 17,
        "observations": 64,
        "landmarks": 4,
        "tentative": 0,
        "unlocated": 0,
        "sigma_range_m": 0.1,
        "sigma_bearing_deg": 2.0,
    }
    assert len(LandmarkMap.load(output).landmarks) == 4


def test_the_noise_is_in_metres_and_degrees(run: Run, seen: Path, tmp_path: Path) -> None:
    def area(*options: object) -> float:
        output = tmp_path / "marks.json"
        assert run("landmarks", seen, *options, "-o", output, "--force").status == 0
        return float(np.linalg.det(LandmarkMap.load(output).landmarks[0].covariance))

    base = area()
    assert area("--sigma-range", 0.1, "--sigma-bearing", 1) == base
    assert area("--sigma-range", 0.2) > 1.1 * base
    doubled = area("--sigma-range", 0.2, "--sigma-bearing", 2)
    assert doubled == pytest.approx(16.0 * base, rel=1e-3)


def test_gate_and_min_count(run: Run, tmp_path: Path) -> None:
    source = write(tmp_path / "seen.csv", "dx,dy", ids=False)

    def facts(*options: object) -> dict[str, object]:
        return run(
            "landmarks", source, *options, "--json", "-o", tmp_path / "m.csv", "--force"
        ).json  # fmt: skip

    tight = facts("--gate", 0.5)
    skipped = tight["skipped"]
    assert isinstance(skipped, dict)
    assert skipped["observation.ambiguous"] > 10
    assert facts("--min-count", 10)["landmarks"] == 4
    assert "--min-count" in run(
        "landmarks", source, "--min-count", 17, "-o", tmp_path / "n.csv"
    ).line  # fmt: skip


def test_a_picture(run: Run, seen: Path, tmp_path: Path) -> None:
    assert run("landmarks", seen, "-o", tmp_path / "marks.png").status == 0
    assert (tmp_path / "marks.png").read_bytes().startswith(b"\x89PNG")


def test_failures_write_nothing(run: Run, seen: Path, tmp_path: Path) -> None:
    nameless = write(tmp_path / "nameless.csv", "bearing", ids=False)
    bad = tmp_path / "bad.csv"
    bad.write_text("x,y,theta,bearing,id\n0,0,0,west,1\n", encoding="utf-8")
    single = tmp_path / "single.csv"
    single.write_text("x,y,theta,bearing,id\n0,0,0,1,1\n", encoding="utf-8")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    for words, message in (
        ((seen, "-o", tmp_path / "m.txt"), "the suffix says what to write"),
        ((seen, "-o", nameless), "exists already; use --force"),
        ((seen, "-o", seen, "--force"), "is the input"),
        ((seen, "-o", tmp_path / "none" / "m.csv"), "does not exist"),
        ((seen, "--sigma-xy", 1, "-o", tmp_path / "m.csv"), "--sigma-xy: "),
        ((seen, "--sigma-range", 0, "-o", tmp_path / "m.csv"), "--sigma-range 0: "),
        ((seen, "--gate", 1, "-o", tmp_path / "m.csv"), "gate"),
        ((bad, "-o", tmp_path / "m.csv"), f"{bad}:2: 'west' in column `bearing`"),
        ((nameless, "-o", tmp_path / "m.csv"), "they need a column `id`"),
        ((single, "-o", tmp_path / "m.csv"), "do not cross"),
        ((tmp_path / "gone.csv", "-o", tmp_path / "m.csv"), "no such file"),
    ):
        assert message in run("landmarks", *words).line
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
    assert run("landmarks", seen).status == 2
    assert run("landmarks", seen, "--min-count", 0, "-o", tmp_path / "m.csv").status == 2


def test_what_cannot_be_calculated_with_is_said(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "seen.csv"
    path.write_text("x,y,theta,range,bearing,id\n0,0,0,1e9,0.1,1\n0,0,0,2,0.1,-1\n")
    words = ("landmarks", path, "-o", tmp_path / "a.csv", "--sigma-range", 0.1)
    line = run(*words, "--sigma-bearing", 2).line
    assert line.endswith(
        "none of the observations is usable (1 x observation.no_id, 1 x observation.out_of_scale)"
    )
    with path.open("a") as file:
        file.write("0,0,0,3,0,2\n")
    facts = run(*words, "--sigma-bearing", 2, "--json").json
    assert facts["skipped"] == {"observation.no_id": 1, "observation.out_of_scale": 1}
