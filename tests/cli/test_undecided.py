# SPDX-License-Identifier: Apache-2.0
"""Cells between the thresholds are not lost in silence when a map is exported."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import oddsmap
from tests.cli.conftest import Run
from tests.kit import ONE

Save = Callable[..., Path]


@pytest.fixture
def save(tmp_path: Path) -> Save:
    """Save a map of cells in a row, by their hits and passes."""

    def save_it(*votes: tuple[int, int], ndim: int = 2, repeat: int = 1) -> Path:
        grid = oddsmap.EvidenceMap(0.1, ndim=ndim)
        all_votes = np.array(list(votes) * repeat, np.int64) * ONE
        index = np.zeros((len(all_votes), ndim), np.int64)
        index[:, 0] = np.arange(len(index))
        grid.add_cells(index, all_votes[:, 0], all_votes[:, 1])
        grid.save(tmp_path / "m.zarr")
        return tmp_path / "m.zarr"

    return save_it


def notes(out: str) -> list[str]:
    return [line for line in out.splitlines() if line.startswith("note")]


def free_pixels(image: Path) -> int:
    grid = oddsmap.load_ros(image.with_suffix(".yaml"))
    return int((grid.state() == oddsmap.State.FREE).sum())


@pytest.mark.parametrize(
    ("passes", "needed", "hint"), [(1, 4, "0.19"), (2, 4, "0.33"), (3, 4, "0.38")]
)
def test_what_would_free_them_does(
    run: Run, save: Save, tmp_path: Path, passes: int, needed: int, hint: str
) -> None:
    source, out = save((1, 0), *[(0, passes)] * 9), tmp_path / "m.yaml"
    done = run("export", source, out)
    (note,) = notes(done.out)
    assert note == (
        "note     90% of the 10 seen cells are undecided, with p between 0.196 (free) and 0.65 "
        f"(occupied), and are written as unknown. It takes {needed} passes to make a cell free, "
        f"and most of these have {passes}: with --p-miss {hint} they are free. --mode scale keeps "
        "their probabilities."
    )
    assert free_pixels(out) == 0
    done = run("export", source, out, "--force", "--p-miss", hint)
    assert notes(done.out) == []
    assert free_pixels(out) == 9


@pytest.mark.parametrize(
    ("votes", "said"),
    [
        ([(0, 4)] * 7 + [(0, 1)] * 3, True),
        ([(0, 4)] * 8 + [(0, 1)] * 2, False),
        ([(1, 0), (0, 4)], False),
    ],
)
def test_a_share_that_is_usual_is_not_said(
    run: Run, save: Save, tmp_path: Path, votes: list[tuple[int, int]], said: bool
) -> None:
    assert len(notes(run("export", save(*votes), tmp_path / "m.yaml").out)) == said


@pytest.mark.parametrize(("options", "name"), [(["--mode", "scale"], "m.yaml"),
                                               (["--mode", "raw"], "m.yaml"),
                                               ([], "m.png"), ([], "m.npz")])  # fmt: skip
def test_what_keeps_probabilities_loses_nothing(
    run: Run, save: Save, tmp_path: Path, options: list[str], name: str
) -> None:
    done = run("export", save((1, 0), (0, 1)), tmp_path / name, *options)
    assert done.status == 0
    assert notes(done.out) == []


def test_cells_that_hits_and_passes_fight_for(run: Run, save: Save, tmp_path: Path) -> None:
    """No smaller p_miss decides them as free: it is not proposed."""
    (note,) = notes(run("export", save((1, 2), (2, 4)), tmp_path / "m.yaml").out)
    assert "--p-miss" not in note
    assert "More scans would decide them, or other limits (--free, --occupied)." in note


def test_a_prior_that_is_free_already(run: Run, save: Save, tmp_path: Path) -> None:
    done = run("export", save((1, 0), (0, 1)), tmp_path / "m.yaml", "--prior", 0.1)
    (note,) = notes(done.out)  # one hit makes 0.1 to 0.2: neither
    assert note.startswith("note     50% of the 2 seen cells")
    assert "--p-miss" not in note


def test_points(run: Run, save: Save, tmp_path: Path) -> None:
    source = save((2, 0), (1, 1), (1, 1), (0, 9), ndim=3)
    done = run("export", source, tmp_path / "m.ply")
    (note,) = notes(done.out)  # a hit and a pass make 0.61
    assert note == (
        "note     67% of the 3 cells with p of 0.5 or more are left out, because a cell is "
        "occupied from 0.65 on. A lower --occupied brings them in, or a larger --p-hit or --prior."
    )
    assert notes(run("export", source, tmp_path / "m.ply", "--force", "--p-hit", 0.8).out) == []
    assert notes(run("export", source, tmp_path / "m.ply", "--force", "--p-miss", 0.2).out) == []
    assert notes(run("export", source, tmp_path / "m.bt").out) == []


def test_a_projected_map(run: Run, save: Save, tmp_path: Path) -> None:
    source = save((0, 1), ndim=3, repeat=5)
    done = run("export", source, tmp_path / "m.yaml", "--z-min", 0, "--z-max", 1)
    (note,) = notes(done.out)
    assert note.startswith("note     100% of the 5 columns seen in the band are undecided")
    assert "a lower --z-max, if the robot is no taller; a larger --slab, which" in note
    done = run(
        "export", source, tmp_path / "l.yaml", "--z-min", 0, "--z-max", 1, "--rule", "largest"
    )
    assert "100% of the 5 seen cells are undecided" in notes(done.out)[0]
    words = ("--z-min", 0, "--z-max", 1, "--p-miss", 0.19, "--slab", "inf")
    done = run("export", source, tmp_path / "n.yaml", *words)
    assert notes(done.out) == []
    assert free_pixels(tmp_path / "n.yaml") == 5
