"""`oddsmap export` and `info` on maps of space."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import oddsmap
from tests.cli.conftest import Run


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    """A floor of 4 x 4 m tilted by 10 %, a post on it, free space above."""
    grid = oddsmap.EvidenceMap(0.1, ndim=3)
    x, y = (axis.ravel() for axis in np.meshgrid(np.arange(40), np.arange(40)))
    floor = x // 10
    post = np.array([[30, 5, 3 + k] for k in range(1, 10)])
    free = np.stack([x, y, floor + 5], axis=1)
    free = free[(free[:, 0] != 30) | (free[:, 1] != 5)]
    hits = np.concatenate([np.stack([x, y, floor], axis=1), post])
    none = np.zeros(len(hits), np.int64)
    grid.add_cells(hits, none + 6 * 65536, none)
    grid.add_cells(free, none[:1].repeat(len(free)), np.full(len(free), 6 * 65536))
    grid.save(tmp_path / "space.zarr")
    return tmp_path / "space.zarr"


def test_octomap_and_back(run: Run, saved: Path, tmp_path: Path) -> None:
    for name in ("space.ot", "space.bt", "space.ply"):
        assert run("export", saved, tmp_path / name).status == 0
    view = oddsmap.load_map(saved).log_odds()
    index, p = view.cells()
    voxels = oddsmap.load_octomap(tmp_path / "space.ot")
    assert np.allclose(voxels.probability[voxels.find(index)], p)
    assert run("export", tmp_path / "space.ot", tmp_path / "again.bt").status == 0
    assert (tmp_path / "again.bt").read_bytes() == (tmp_path / "space.bt").read_bytes()
    options = ("--clamp", 0.1192, 0.971)
    assert run("export", saved, tmp_path / "clamped.ot", *options).status == 0
    clamped = oddsmap.load_octomap(tmp_path / "clamped.ot").probability
    assert clamped.min() >= 0.1191
    assert voxels.probability.min() < 0.1191 < 0.9711 < voxels.probability.max()
    assert clamped.max() <= 0.9711


@pytest.mark.parametrize("source", ["space.zarr", "space.bt"])
def test_plane(run: Run, saved: Path, tmp_path: Path, source: str) -> None:
    assert run("export", saved, tmp_path / "space.bt").status == 0
    out = tmp_path / "plane.yaml"
    band = ("--z-min", 0.3, "--z-max", 1.5, "--ground", "relative")
    assert run("export", tmp_path / source, out, *band).status == 0
    state = oddsmap.load_ros(out).state()
    assert np.argwhere(state == oddsmap.State.OCCUPIED).tolist() == [[5, 30]]
    assert np.count_nonzero(state == oddsmap.State.FREE) == 40 * 40 - 1
    assert run("export", tmp_path / source, tmp_path / "plane.png", *band[:2]).status == 0
    above_zero = run("export", tmp_path / source, out, *band[:4], "--force")
    assert above_zero.status == 0
    assert np.count_nonzero(oddsmap.load_ros(out).state() == oddsmap.State.OCCUPIED) > 300


def test_wrong_requests(run: Run, saved: Path, tmp_path: Path, office: Path) -> None:
    bt, flat = tmp_path / "space.bt", tmp_path / "flat.zarr"
    assert run("export", saved, bt).status == 0
    assert run("build", office, "--resolution", 0.2, "-o", flat).status == 0
    before = sorted(tmp_path.iterdir())
    for words, said in (
        ((saved, "a.yaml"), "--z-min 0.2 --z-max 1.8 --ground relative"),
        ((saved, "a.png", "--ground", "relative"), "which heights"),
        ((saved, "a.bt", "--clamp", 0.1, 0.9), "--clamp bounds"),
        ((saved, "a.ply", "--z-min", 1), "not a.ply"),
        ((flat, "a.png", "--z-max", 1), "of the plane"),
        ((flat, "a.bt"), "needs a map of space"),
        ((bt, "a.npz"), "an OctoMap has none"),
        ((bt, "a.ply", "--prior", 0.3), "no counts"),
        ((saved, "a.las"), ".bt or .ot (OctoMap), .ply (points)"),
    ):
        source, name, *options = words
        assert said in run("export", source, tmp_path / str(name), *options).line
    assert sorted(tmp_path.iterdir()) == before


def test_info(run: Run, saved: Path, tmp_path: Path) -> None:
    bt = tmp_path / "space.bt"
    assert run("export", saved, bt).status == 0
    facts = run("info", bt, "--json").json
    assert facts["format"] == "OctoMap"
    assert facts["occupied"] == 40 * 40 + 9
    assert facts["free"] == 40 * 40 - 1
    assert facts["cells known"] == facts["occupied"] + facts["free"]
    assert facts["x [m]"] == pytest.approx([0.0, 4.0])
    assert "0.1 m" in run("info", bt).out
    bt.write_bytes(bt.read_bytes()[:-1])
    assert "cut off" in run("info", bt).line
