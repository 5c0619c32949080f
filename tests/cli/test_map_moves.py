# SPDX-License-Identifier: Apache-2.0
"""`oddsmap merge --transform` and `--shift`: maps of other frames brought into the first's."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import oddsmap
from tests.cli.conftest import Run
from tests.kit import ONE, Votes, add_votes, votes_of


@pytest.fixture
def three(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Maps a, b and c of one log each, and space and more of 3D."""
    monkeypatch.chdir(tmp_path)
    for k, name in enumerate(("a", "b", "c", "space", "more")):
        grid = oddsmap.EvidenceMap(0.1, ndim=3 if k > 2 else 2)
        votes: Votes = {
            (i, j) if k < 3 else (i, j, k): (k * ONE, ONE) for i in range(20) for j in range(9)
        }
        add_votes(grid, votes)
        grid.record(f"{name}.log", scans=k)
        grid.save(f"{name}.zarr")
    return tmp_path


def loaded(name: str) -> oddsmap.EvidenceMap:
    return oddsmap.load_map(f"{name}.zarr")


@pytest.mark.usefixtures("three")
def test_each_map_has_its_own_or_all_have_one(run: Run) -> None:
    a, b, c = (loaded(name) for name in "abc")
    turn = (1.0, -0.5, math.pi / 2)
    words = "--transform", "1 -.5 1.570796", "--transform", "0 0 0"
    done = run("merge", "a.zarr", "b.zarr", "c.zarr", *words, "-o", "m.zarr")
    assert done.status == 0
    assert done.err == ""
    assert "warning" not in done.out
    assert done.out.startswith("merged   3 maps, in the frame of a.zarr\n")
    assert votes_of(loaded("m")) == votes_of(a + b.transformed(turn) + c)
    done = run("merge", "a.zarr", "b.zarr", "c.zarr", "--shift=-1,2", "-o", "m.zarr", "--force")
    assert done.status == 0
    moved = [other.transformed((-1.0, 2.0, 0.0)) for other in (b, c)]
    assert votes_of(loaded("m")) == votes_of(a + moved[0] + moved[1])
    # What the provenance says is told from the same logs where they were.
    done = run("subtract", "m.zarr", "b.zarr", "--shift", "-1 2", "-o", "left.zarr")
    assert done.status == 0
    assert "warning" not in done.out
    assert votes_of(loaded("left")) == votes_of(a + moved[1])
    assert loaded("left").provenance == (a + moved[1]).provenance
    sums = a + moved[0] + b
    sums.save("sums.zarr")
    done = run("subtract", "sums.zarr", "a.zarr", "-o", "rest.zarr")
    assert "warning" not in done.out
    done = run("merge", "m.zarr", "b.zarr", "-o", "twice.zarr")
    assert "warning: b.log is in what it is added to as well" in done.out


@pytest.mark.usefixtures("three")
def test_what_was_moved_is_not_what_it_was(run: Run) -> None:
    a, b = loaded("a"), loaded("b")
    (b.transformed((0.1, 0.0, 0.0)) + a).save("m.zarr")
    b.crop((5, 5), (6, 6)).save("part.zarr")
    done = run("subtract", "m.zarr", "part.zarr", "-o", "left.zarr")
    assert "warning: b.log is not among what the first map was made from" in done.out


@pytest.mark.usefixtures("three")
def test_one_line_says_what_resampling_costs(run: Run) -> None:
    done = run("merge", "a.zarr", "b.zarr", "--transform", "1 2 .3", "-o", "m.zarr")
    assert done.status == 0
    assert done.out.count("warning") == 1
    total = loaded("m")
    cost = total.provenance[-1]["resampling"]
    assert (
        "b.zarr: warning: moved by no quarter turn and whole cells, so resampled: of 180 cells the "
        f"counts of {cost['repeated']} are repeated and those of {cost['dropped']} dropped, 360 "
        f"votes became {cost['votes']:.0f}; "
    ) in done.out
    assert "moved x 1, y 2, yaw 0.3" in run("info", "m.zarr").out
    with pytest.warns(UserWarning, match="resampled"):
        moved = loaded("b").transformed((1.0, 2.0, 0.3))
    assert votes_of(total) == votes_of(loaded("a") + moved)
    done = run("merge", "a.zarr", "b.zarr", "--shift", ".05 0", "-o", "n.zarr", "--json")
    assert "those of 0 dropped" in done.err
    assert done.json["hits"] == 180
    # The same is made again, to the bit, and so comes out again.
    done = run("subtract", "m.zarr", "b.zarr", "--transform", "1 2 .3", "-o", "left.zarr", "-q")
    assert (done.status, done.out) == (0, "")
    assert votes_of(loaded("left")) == votes_of(loaded("a"))


@pytest.mark.usefixtures("three")
def test_maps_of_space(run: Run) -> None:
    words = "--transform", "1 2 3 0 0 .7071068 .7071068"
    done = run("merge", "space.zarr", "more.zarr", *words, "-o", "m.zarr")
    assert done.status == 0
    assert "warning" not in done.out
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    moved = loaded("more").transformed(oddsmap.Pose3(np.array([1.0, 2.0, 3.0]), turn))
    assert votes_of(loaded("m")) == votes_of(loaded("space") + moved)
    for words in (("--shift", "1 2 .5"), ("--shift", "1 2"), ("--transform", "1 2 0")):
        done = run("merge", "space.zarr", "more.zarr", *words, "-o", "m.zarr", "--force")
        assert done.status == 0
        assert "warning" not in done.out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("a", "b", "--transform", "1 2"), '--transform "1 2": needs the numbers x y yaw'),
        (("a", "b", "--transform", "1 2 nan"), "needs the numbers x y yaw"),
        (("a", "b", "--transform", "1 2 north"), "needs the numbers x y yaw"),
        (("space", "more", "--transform", "1 2 3 0 0 0 2"), "needs a unit quaternion, got norm 2"),
        (("a", "b", "--transform", "1 2 3 0 0 0 1"), "b.zarr: a 2D map is moved in the plane"),
        (("a", "b", "--shift", "1 2 3"), "b.zarr: a 2D map is moved in the plane"),
        (("a", "b", "--shift", "1"), '--shift "1": needs the numbers x y'),
        (("a", "b", "--shift", "1 2", "--transform", "1 2 3"), 'as a transform without a turn, --'),
        (("a", "b", "--shift", "1 2", "--shift", "3 4"), "given 2 times, and the maps"),
        (("a", "b", "c", "c2", "--shift", "1 2", "--shift", "3 4"), "stands, are 3: once for all"),
        (("a", "b", "--shift", "1e300 0"), "b.zarr: the moved map would reach farther than 2^46"),
    ],
)  # fmt: skip
@pytest.mark.usefixtures("three")
def test_wrong_moves(run: Run, words: tuple[str, ...], message: str) -> None:
    maps = [f"{word}.zarr" for word in words if word[0] in "abcsm" and len(word) < 6]
    rest = words[len(maps) :]
    assert message in run("merge", *maps, *rest, "-o", "m.zarr").line
    assert not Path("m.zarr").exists()
