# SPDX-License-Identifier: Apache-2.0
"""`oddsmap export` of probabilities: prior maps, and 3D maps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import oddsmap
from oddsmap.odds import sigmoid
from tests.cli.conftest import Run


@pytest.mark.parametrize(
    ("source", "prior"),
    [("hall", "old.zarr"), ("hall", "coarse.zarr"), ("hall", "old.yaml"), ("space", "before.zarr"),
     ("space", "before.ot"), ("space", "before.bt")],
)  # fmt: skip
def test_a_map_as_the_prior(run: Run, maps: Path, tmp_path: Path, source: str, prior: str) -> None:
    out = tmp_path / "m.npz"
    assert run("export", maps / f"{source}.zarr", out, "--prior", maps / prior).status == 0
    grid, path = oddsmap.load_map(maps / f"{source}.zarr"), maps / prior
    belief: oddsmap.EvidenceMap | oddsmap.ProbabilityMap | oddsmap.VoxelMap
    if prior.endswith(".zarr"):
        belief = oddsmap.load_map(path)
    elif prior.endswith(".yaml"):
        belief = oddsmap.load_ros(path)
    else:
        belief = oddsmap.load_octomap(path)
    want = grid.log_odds(prior=belief).cells()[1].astype(np.float32)
    with np.load(out) as arrays:
        assert np.array_equal(arrays["probability"], want)
        assert not np.allclose(arrays["probability"], grid.log_odds().cells()[1])
        assert np.array_equal(arrays["index"], grid.cells()[0])


def test_other_outputs_have_the_prior(run: Run, maps: Path, tmp_path: Path) -> None:
    prior = ("--prior", maps / "old.zarr")
    assert run("export", maps / "hall.zarr", tmp_path / "a.yaml", *prior).status == 0
    assert run("export", maps / "hall.zarr", tmp_path / "b.yaml").status == 0
    old = oddsmap.load_map(maps / "old.zarr")
    view = oddsmap.load_map(maps / "hall.zarr").log_odds(prior=old)
    state = oddsmap.load_ros(tmp_path / "a.yaml").state()
    assert np.array_equal(state == 100, view.state() == 100)
    assert (tmp_path / "a.pgm").read_bytes() != (tmp_path / "b.pgm").read_bytes()
    prior = ("--prior", maps / "before.zarr")
    assert run("export", maps / "space.zarr", tmp_path / "a.ot", *prior).status == 0
    before = oddsmap.load_map(maps / "before.zarr")
    voxels = oddsmap.load_map(maps / "space.zarr").log_odds(prior=before).to_voxels()
    back = oddsmap.load_octomap(tmp_path / "a.ot")
    assert np.array_equal(back.log_odds[back.find(voxels.index)], voxels.log_odds.astype("f4"))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("hall.zarr", "m.npz", "--prior", "none.yaml"), "neither a number nor a file"),
        (("hall.zarr", "m.npz", "--prior", "notes.txt"), "not a map that can be a prior"),
        (("hall.zarr", "m.npz", "--prior", "hall.zarr"), "count twice"),
        (("hall.zarr", "m.npz", "--prior", "space.zarr"), "the prior is a 3D map"),
        (("hall.zarr", "m.npz", "--prior", "before.bt"), "the prior is a 3D map"),
        (("space.zarr", "m.npz", "--prior", "old.yaml"), "the prior is a 2D map"),
        (("hall.zarr", "m.npz", "--prior", "nan"), "prior is a probability"),
        (("before.bt", "m.ply", "--prior", "before.ot"), "no counts"),
    ],
)  # fmt: skip
def test_wrong_requests(
    run: Run,
    maps: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[object, ...],
    message: str,
) -> None:
    monkeypatch.chdir(maps)
    source, name, *options = words
    assert message in run("export", source, tmp_path / str(name), *options).line
    assert list(tmp_path.iterdir()) == []


def test_octomap_and_back(run: Run, tilted_floor: Path, tmp_path: Path) -> None:
    for name in ("space.ot", "space.bt", "space.ply"):
        assert run("export", tilted_floor, tmp_path / name).status == 0
    view = oddsmap.load_map(tilted_floor).log_odds()
    index, p = view.cells()
    voxels = oddsmap.load_octomap(tmp_path / "space.ot")
    assert np.allclose(voxels.probability[voxels.find(index)], p)
    assert run("export", tmp_path / "space.ot", tmp_path / "again.bt").status == 0
    assert (tmp_path / "again.bt").read_bytes() == (tmp_path / "space.bt").read_bytes()
    options = ("--clamp", 0.1192, 0.971)
    assert run("export", tilted_floor, tmp_path / "clamped.ot", *options).status == 0
    clamped = oddsmap.load_octomap(tmp_path / "clamped.ot").probability
    assert clamped.min() >= 0.1191
    assert voxels.probability.min() < 0.1191 < 0.9711 < voxels.probability.max()
    assert clamped.max() <= 0.9711


@pytest.mark.parametrize("source", ["space.zarr", "space.bt"])
def test_plane(run: Run, tilted_floor: Path, tmp_path: Path, source: str) -> None:
    assert run("export", tilted_floor, tmp_path / "space.bt").status == 0
    out = tmp_path / "plane.yaml"
    band = ("--z-min", 0.3, "--z-max", 1.5, "--ground", "relative")
    done = run("export", tmp_path / source, out, *band)
    assert "0.3 m or more without a beam" in done.out
    state = oddsmap.load_ros(out).state()
    assert np.argwhere(state == oddsmap.State.OCCUPIED).tolist() == [[5, 30]]
    # One layer was seen free: all of the band is, if it is one slab.
    assert not (state == oddsmap.State.FREE).any()
    assert run("export", tmp_path / source, out, *band, "--slab", "inf", "--force").status == 0
    state = oddsmap.load_ros(out).state()
    assert np.argwhere(state == oddsmap.State.OCCUPIED).tolist() == [[5, 30]]
    assert np.count_nonzero(state == oddsmap.State.FREE) == 40 * 40 - 1
    assert run("export", tmp_path / source, tmp_path / "plane.png", *band[:2]).status == 0
    above_zero = run("export", tmp_path / source, out, *band[:4], "--force")
    assert above_zero.status == 0
    assert np.count_nonzero(oddsmap.load_ros(out).state() == oddsmap.State.OCCUPIED) > 300


def test_wrong_requests_of_maps_of_space(
    run: Run, tilted_floor: Path, tmp_path: Path, office: Path
) -> None:
    bt, flat = tmp_path / "space.bt", tmp_path / "flat.zarr"
    assert run("export", tilted_floor, bt).status == 0
    assert run("build", office, "--resolution", 0.2, "-o", flat).status == 0
    before = sorted(tmp_path.iterdir())
    for words, message in (
        ((tilted_floor, "a.yaml"), "--z-min 0.2 --z-max 1.8 --ground relative"),
        ((tilted_floor, "a.png", "--ground", "relative"), "which heights"),
        ((tilted_floor, "a.bt", "--clamp", 0.1, 0.9), "--clamp bounds"),
        ((tilted_floor, "a.ply", "--z-min", 1), "not a.ply"),
        ((flat, "a.png", "--z-max", 1), "this one is 2D"),
        ((flat, "a.bt"), "needs a 3D map"),
        ((bt, "a.npz"), "an OctoMap has none"),
        ((bt, "a.ply", "--prior", 0.3), "no counts"),
        ((tilted_floor, "a.xyz"), ".bt or .ot (OctoMap), .ply, .las or .laz (points), .rrd"),
    ):
        source, name, *options = words
        assert message in run("export", source, tmp_path / str(name), *options).line
    assert sorted(tmp_path.iterdir()) == before


def states_of(path: Path) -> dict[int, int]:
    """How many cells a ROS map says to be free (0), occupied (100), or neither (-1)."""
    states, counts = np.unique(oddsmap.load_ros(path).state(), return_counts=True)
    return dict(zip(states.tolist(), counts.tolist(), strict=True))


def test_other_limits_in_a_ros_map(run: Run, maps: Path, tmp_path: Path) -> None:
    source, out = maps / "hall.zarr", tmp_path / "m.yaml"
    view = oddsmap.load_map(source).log_odds()
    for options, limits in (
        ((), oddsmap.Thresholds()),
        (("--free", 0.01), oddsmap.Thresholds(0.01, 0.65)),
        (("--occupied", 0.99), oddsmap.Thresholds(0.196, 0.99)),
        (("--free", 0.3, "--occupied", 0.31), oddsmap.Thresholds(0.3, 0.31)),
    ):
        assert run("export", source, out, *options, "--force").status == 0
        want, found = view.state(thresholds=limits), states_of(out)
        for state in (oddsmap.State.FREE, oddsmap.State.OCCUPIED):
            assert found.get(state, 0) == np.count_nonzero(want == state)
        assert f"free_thresh: {limits.free:g}" in out.read_text()
        assert f"occupied_thresh: {limits.occupied:g}" in out.read_text()


def test_other_limits_of_maps_without_counts(run: Run, maps: Path, tmp_path: Path) -> None:
    limits = ("--free", 0.05, "--occupied", 0.95)
    for source in ("old.yaml", "hall.zarr"):
        assert run("export", maps / source, tmp_path / "a.yaml", *limits, "--force").status == 0
        assert "occupied_thresh: 0.95" in (tmp_path / "a.yaml").read_text()
    sizes = []
    for source in ("before.ot", "before.zarr"):
        for k, options in enumerate(((), limits)):
            name = f"{Path(source).suffix[1:]}{k}"
            for suffix in (".ply", ".bt", ".laz", ".mcap"):
                done = run("export", maps / source, tmp_path / f"{name}{suffix}", *options)
                assert done.status == 0, done.err
            sizes.append((tmp_path / f"{name}.ply").stat().st_size)
    assert sizes[0] > sizes[1]
    assert sizes[2] > sizes[3]


def test_bounds_of_what_is_written(run: Run, maps: Path, tmp_path: Path) -> None:
    bounds = ("--clamp", 0.3, 0.6)
    assert run("export", maps / "hall.zarr", tmp_path / "m.npz", *bounds).status == 0
    with np.load(tmp_path / "m.npz") as arrays:
        p = arrays["probability"]
    assert (p.min(), p.max()) == (np.float32(0.3), np.float32(0.6))
    for name in ("m.yaml", "m.png", "m.tif", "m.mcap"):
        assert run("export", maps / "hall.zarr", tmp_path / name, *bounds).status == 0
    assert set(states_of(tmp_path / "m.yaml")) == {-1}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("hall.zarr", "m.npz", "--free", 0.1), "--free and --occupied decide"),
        (("hall.zarr", "m.yaml", "--free", 0.7), "got 0.7 and 0.65"),
        (("hall.zarr", "m.yaml", "--occupied", 1.2), "0 <= free < occupied <= 1"),
        (("hall.zarr", "m.yaml", "--free", 0.5, "--occupied", 0.5), "got 0.5 and 0.5"),
        (("hall.zarr", "m.png", "--clamp", 0.9, 0.1), "clamp needs"),
        (("before.bt", "m.ply", "--clamp", 0.1, 0.9), "no counts"),
        (("space.zarr", "m.bt", "--clamp", 0.1, 0.9), "not m.bt"),
        (("hall.zarr", "m.png", "--posterior", "reflection", "--occupied", 0.7), "log-odds"),
    ],
)  # fmt: skip
def test_wrong_limits(
    run: Run, maps: Path, tmp_path: Path, words: tuple[object, ...], message: str
) -> None:
    source, name, *options = words
    assert message in run("export", maps / str(source), tmp_path / str(name), *options).line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["hall", "space"])
def test_calibrated_with_neighbours(run: Run, maps: Path, tmp_path: Path, name: str) -> None:
    source, words = maps / f"{name}.zarr", ("--posterior", "calibrated", "--neighbours")
    assert run("export", source, tmp_path / "m.npz", *words).status == 0
    grid = oddsmap.load_map(source)
    view = grid.calibrated(neighbours=True)
    with np.load(tmp_path / "m.npz") as arrays:
        index, seen = arrays["index"], arrays["observed"]
        assert np.array_equal(index[seen], grid.cells()[0])
        assert (~seen).sum() > 10
        want = sigmoid(view.log_odds_at(index))
        assert np.allclose(arrays["probability"], want, atol=1e-6)
        alpha, beta, _ = view.reflectivity.parameters_at(index)
        assert np.allclose(arrays["reflectivity"], alpha / (alpha + beta), atol=1e-6)
        assert not (arrays["hits"] + arrays["passes"])[~seen].any()
    # Without it, other probabilities, and no cell that was not seen.
    assert run("export", source, tmp_path / "plain.npz", *words[:2]).status == 0
    with np.load(tmp_path / "plain.npz") as arrays:
        assert np.array_equal(arrays["index"], grid.cells()[0])
        assert not np.allclose(arrays["probability"], want[seen])
    # A prior map is that of cells not seen, too.
    prior = ("--prior", maps / ("old.zarr" if name == "hall" else "before.zarr"))
    assert run("export", source, tmp_path / "p.npz", *words, *prior).status == 0
    with np.load(tmp_path / "p.npz") as arrays:
        assert np.array_equal(arrays["index"], index)
        before = oddsmap.load_map(prior[1])
        want = sigmoid(grid.calibrated(neighbours=True, prior=before).log_odds_at(index))
        assert np.allclose(arrays["probability"], want, atol=1e-6)


def test_ros_maps_with_neighbours_keep_what_is_unknown(
    run: Run, maps: Path, tmp_path: Path
) -> None:
    words = (tmp_path / "m.yaml", "--posterior", "calibrated", "--neighbours")
    assert run("export", maps / "hall.zarr", *words).status == 0
    view = oddsmap.load_map(maps / "hall.zarr").calibrated(neighbours=True)
    state = oddsmap.load_ros(tmp_path / "m.yaml").state()
    assert (state[~view.observed()] == -1).all()
    assert np.array_equal(state == 100, view.state() == 100)


def test_neighbours_are_the_calibrated_views(run: Run, maps: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.npz"
    line = run("export", maps / "hall.zarr", out, "--neighbours").line
    assert line == "--neighbours belongs to --posterior calibrated, not to log-odds"
    assert not out.exists()
