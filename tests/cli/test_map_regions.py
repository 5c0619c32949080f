# SPDX-License-Identifier: Apache-2.0
"""`oddsmap export` of parts of maps, and of maps that do not fit in memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import oddsmap
from oddsmap import limits
from oddsmap.cli import map_regions
from oddsmap.evidence import store
from tests.cli.conftest import Run

BOX = "1.2 0.9 6.05 4"


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("maps") / "office.zarr"
    scan = oddsmap.Scan.from_angles((3, 3, 0), np.linspace(-3, 3, 90), np.full(90, 4.0))
    oddsmap.build_map([scan], 0.1, votes="beam", path_lengths=True).save(path)
    return path


@pytest.mark.parametrize("posterior", ["log-odds", "reflection", "decay"])
def test_a_box_is_exported_as_its_crop_is(
    run: Run, flat: Path, tmp_path: Path, posterior: str
) -> None:
    assert run("crop", flat, "--box", BOX, "-o", tmp_path / "part.zarr").status == 0
    way = ("--posterior", posterior)
    assert run("export", tmp_path / "part.zarr", tmp_path / "a.npz", *way).status == 0
    assert run("export", flat, tmp_path / "b.npz", *way, "--box", BOX).status == 0
    with np.load(tmp_path / "a.npz") as one, np.load(tmp_path / "b.npz") as other:
        assert list(one) == list(other)
        assert all(np.array_equal(one[name], other[name]) for name in one)


def test_a_picture_of_a_crop_reads_no_more(
    run: Run, flat: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    crop = ("--crop", 1.23, 0.9, 6.05, 4)
    assert run("export", flat, tmp_path / "a.png", *crop).status == 0
    with monkeypatch.context() as patch:
        patch.setattr(map_regions, "_cells_shown", lambda *_: None)
        assert run("export", flat, tmp_path / "b.png", *crop).status == 0
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()

    def whole(*_: object, **__: object) -> None:
        raise AssertionError("the whole map is read")

    monkeypatch.setattr(store, "read_map", whole)
    assert run("export", flat, tmp_path / "c.png", *crop).status == 0
    line = run("export", flat, tmp_path / "d.png", "--crop", 100, 100, 110, 110).line
    assert "no cell of the map is known in the crop" in line


def test_a_map_that_does_not_fit_is_drawn_in_blocks(
    run: Run, flat: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "memory_limit", lambda: 200_000)
    done = run("export", flat, tmp_path / "a.png", "--size", 40 * 4)
    assert done.status == 0
    assert "office.zarr does not fit in memory as a picture of all its cells" in done.out
    assert "in blocks of 0.1 m" in done.out
    assert (tmp_path / "a.png").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--box", "1 2 3"), "four numbers [metres] are needed"),
        (("--box", "5 2 3 4"), "the lowest corner comes first"),
        (("--box", "1 2 0 3 4 5"), "is a 2D map, whose box has 4 numbers; --box has 6"),
        (("--box", "100 100 110 110"), "no evidence in the box"),
        (("--posterior", "calibrated", "--box", BOX), "--box belongs to --posterior log-odds or"),
    ],
)
def test_boxes_that_are_refused(
    run: Run, flat: Path, tmp_path: Path, words: tuple[str, ...], message: str
) -> None:
    done = run("export", flat, tmp_path / "a.png", *words)
    assert done.status == 1
    assert message in done.line
    assert list(tmp_path.iterdir()) == []


def test_other_maps_are_read_whole(run: Run, tmp_path: Path) -> None:
    grid = oddsmap.EvidenceMap(0.1, ndim=3)
    grid.add_cells(np.array([[1, 2, 3]]), np.array([65536]), np.array([0]))
    grid.log_odds().save_octomap(tmp_path / "a.bt")
    line = run("export", tmp_path / "a.bt", tmp_path / "b.ply", "--box", "0 0 0 1 1 1").line
    assert "an OctoMap is read whole; --box is for maps of oddsmap build" in line
