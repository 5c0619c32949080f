# SPDX-License-Identifier: Apache-2.0
"""`oddsmap export` with prior maps and with the reflection view."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import oddsmap
from tests.cli.conftest import Run
from tests.kit import fan_scan

REFLECTION = ("--posterior", "reflection")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Maps of the plane, one of another resolution and one of scan votes, and maps of space."""
    folder = tmp_path_factory.mktemp("maps")
    rng = np.random.default_rng(5)
    for name, resolution, votes, ndim in (
        ("hall", 0.1, "beam", 2), ("old", 0.1, "beam", 2), ("coarse", 0.3, "beam", 2),
        ("scans", 0.1, "scan", 2), ("space", 0.1, "beam", 3), ("before", 0.1, "beam", 3),
    ):  # fmt: skip
        grid = oddsmap.EvidenceMap(resolution, votes=votes, ndim=ndim)
        reach = 10 if ndim == 2 else 3
        index = np.unique(rng.integers(-reach, reach + 2, (150, ndim)), axis=0)
        grid.add_cells(index, *(rng.integers(0, 9, (2, len(index))) * 65536))
        grid.save(folder / f"{name}.zarr")
    oddsmap.load_map(folder / "old.zarr").log_odds().save_ros(folder / "old.yaml", mode="scale")
    before = oddsmap.load_map(folder / "before.zarr").log_odds()
    before.save_octomap(folder / "before.ot")
    before.save_octomap(folder / "before.bt")
    (folder / "notes.txt").write_text("no map")
    return folder


@pytest.mark.parametrize(
    ("source", "prior"),
    [("hall", "old.zarr"), ("hall", "coarse.zarr"), ("hall", "old.yaml"), ("space", "before.zarr"),
     ("space", "before.ot"), ("space", "before.bt")],
)  # fmt: skip
def test_a_map_as_the_prior(
    run: Run, folder: Path, tmp_path: Path, source: str, prior: str
) -> None:
    out = tmp_path / "m.npz"
    assert run("export", folder / f"{source}.zarr", out, "--prior", folder / prior).status == 0
    grid, path = oddsmap.load_map(folder / f"{source}.zarr"), folder / prior
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


def test_other_outputs_have_the_prior(run: Run, folder: Path, tmp_path: Path) -> None:
    prior = ("--prior", folder / "old.zarr")
    assert run("export", folder / "hall.zarr", tmp_path / "a.yaml", *prior).status == 0
    assert run("export", folder / "hall.zarr", tmp_path / "b.yaml").status == 0
    old = oddsmap.load_map(folder / "old.zarr")
    view = oddsmap.load_map(folder / "hall.zarr").log_odds(prior=old)
    state = oddsmap.load_ros(tmp_path / "a.yaml").state()
    assert np.array_equal(state == 100, view.state() == 100)
    assert (tmp_path / "a.pgm").read_bytes() != (tmp_path / "b.pgm").read_bytes()
    prior = ("--prior", folder / "before.zarr")
    assert run("export", folder / "space.zarr", tmp_path / "a.ot", *prior).status == 0
    before = oddsmap.load_map(folder / "before.zarr")
    voxels = oddsmap.load_map(folder / "space.zarr").log_odds(prior=before).to_voxels()
    back = oddsmap.load_octomap(tmp_path / "a.ot")
    assert np.array_equal(back.log_odds[back.find(voxels.index)], voxels.log_odds.astype("f4"))


def picture(path: Path) -> bytes:
    with Image.open(path) as image:
        return image.convert("RGB").tobytes()


def test_each_quantity_is_another_picture(run: Run, folder: Path, tmp_path: Path) -> None:
    made = {}
    for show in ("mean", "mode", "std", "interval-width", "lower", "upper", "p-above"):
        out = tmp_path / f"{show}.png"
        words = (*REFLECTION, "--show", show)
        assert run("export", folder / "hall.zarr", out, *words).status == 0
        made[picture(out)] = show
    assert len(made) == 7
    out = tmp_path / "m.png"
    assert run("export", folder / "hall.zarr", out, *REFLECTION).status == 0
    assert made[picture(out)] == "mean"


def test_options_reach_the_view(run: Run, folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.npz"
    words = ("--level", 0.8, "--interval", "highest-density", "--beta-a", 0.5, "--beta-b", 2)
    for name in ("hall", "space"):
        done = run("export", folder / f"{name}.zarr", out, *REFLECTION, *words, "--force")
        assert (done.status, done.err) == (0, "")
        view = oddsmap.load_map(folder / f"{name}.zarr").reflection(
            level=0.8, kind="highest-density", a=0.5, b=2.0
        )
        view.save_npz(tmp_path / "want.npz", force=True)
        with np.load(out) as arrays, np.load(tmp_path / "want.npz") as want:
            assert set(arrays) >= {"index", "hits", "passes", "probability", "std", "lower"}
            for field in want:
                assert np.array_equal(arrays[field], want[field])


def test_pictures_follow_their_options(run: Run, folder: Path, tmp_path: Path) -> None:
    def drawn(*words: object) -> bytes:
        out = tmp_path / "m.png"
        assert run("export", folder / "hall.zarr", out, *REFLECTION, *words, "--force").status == 0
        return picture(out)

    for show, option in (
        ("lower", ("--level", 0.5)),
        ("upper", ("--interval", "highest-density")),
        ("p-above", ("--threshold", 0.2)),
        ("mean", ("--beta-a", 5)),
        ("mean", ("--beta-b", 5)),
    ):
        assert drawn("--show", show) != drawn("--show", show, *option)


def test_ros(run: Run, folder: Path, tmp_path: Path) -> None:
    view = oddsmap.load_map(folder / "hall.zarr").reflection()
    for mode in ((), ("--mode", "raw")):
        out = tmp_path / f"m{len(mode)}.yaml"
        assert run("export", folder / "hall.zarr", out, *REFLECTION, *mode).status == 0
        back = oddsmap.load_ros(out)
        assert np.array_equal(back.observed, view.observed())
        assert np.allclose(back.probability[back.observed], view.mean()[back.observed], atol=0.006)


def test_votes_of_scans_are_warned_of(run: Run, folder: Path, tmp_path: Path) -> None:
    done = run("export", folder / "scans.zarr", tmp_path / "m.npz", *REFLECTION)
    assert done.status == 0
    assert done.err.startswith("oddsmap: warning: ")
    assert done.err.count("\n") == 1
    assert 'votes="beam"' in done.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("hall.zarr", "m.npz", "--prior", "none.yaml"), "neither a number nor a file"),
        (("hall.zarr", "m.npz", "--prior", "notes.txt"), "not a map that can be a prior"),
        (("hall.zarr", "m.npz", "--prior", "hall.zarr"), "count twice"),
        (("hall.zarr", "m.npz", "--prior", "space.zarr"), "the prior is a map of space"),
        (("hall.zarr", "m.npz", "--prior", "before.bt"), "the prior is a map of space"),
        (("space.zarr", "m.npz", "--prior", "old.yaml"), "the prior is a map of the plane"),
        (("hall.zarr", "m.npz", "--prior", "nan"), "prior is a probability"),
        (("before.bt", "m.ply", "--prior", "before.ot"), "no counts"),
        (("hall.zarr", "m.npz", "--posterior", "odds"), "known: log-odds, reflection"),
        (("hall.zarr", "m.png", "--show", "mean"), "--show belongs to --posterior reflection"),
        (("hall.zarr", "m.npz", "--beta-a", 2), "--beta-a belongs to --posterior reflection"),
        (("hall.zarr", "m.npz", *REFLECTION, "--prior", 0.3), "--prior belongs to --posterior log"),
        (("hall.zarr", "m.npz", *REFLECTION, "--p-hit", 0.8), "not to reflection"),
        (("hall.zarr", "m.npz", *REFLECTION, "--show", "std"), "--show says what a .png shows"),
        (("hall.zarr", "m.png", *REFLECTION, "--level", 0.9), "--level changes .npz and --show"),
        (("hall.zarr", "m.yaml", *REFLECTION, "--threshold", 0.9), "--threshold changes --show"),
        (("hall.zarr", "m.npz", *REFLECTION, "--level", 1.5), "level lies between 0 and 1"),
        (("hall.zarr", "m.npz", *REFLECTION, "--beta-b", 0), "prior's b is a weight above 0"),
        (("hall.zarr", "m.yaml", *REFLECTION, "--mode", "trinary"), "no state"),
        (("hall.zarr", "m.ply", *REFLECTION), "written as .png, .npz or .yaml"),
        (("space.zarr", "m.png", *REFLECTION), "its reflectivity as .npz"),
        (("before.bt", "m.npz", *REFLECTION), "needs hits and passes"),
        (("hall.zarr", "m.png", "--mode", "raw"), "--mode says how a ROS map is written"),
    ],
)  # fmt: skip
def test_wrong_requests(
    run: Run,
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[object, ...],
    said: str,
) -> None:
    monkeypatch.chdir(folder)
    source, name, *options = words
    assert said in run("export", source, tmp_path / str(name), *options).line
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_choice_is_a_usage_error(run: Run, folder: Path, tmp_path: Path) -> None:
    words = (*REFLECTION, "--show", "median")
    done = run("export", folder / "hall.zarr", tmp_path / "m.png", *words)
    assert done.status == 2
    assert "interval-width" in done.err


def test_decay_rates(run: Run, tmp_path: Path) -> None:
    scan = fan_scan(0.05, 0.05, 0.0, [1.0, 1.2, 0.7, 2.0], step=0.4)
    grid = oddsmap.build_map([scan], 0.1, votes="beam", path_lengths=True)
    grid.save(tmp_path / "m.zarr")
    words = ("export", tmp_path / "m.zarr")
    decay = ("--posterior", "decay")
    assert run(*words, tmp_path / "a.npz", *decay, "--level", 0.5).status == 0
    with np.load(tmp_path / "a.npz") as arrays:
        index, shape, rate = grid.decay_rate().cells()
        assert np.array_equal(arrays["index"], index)
        assert np.allclose(arrays["mean"], shape / rate)
    assert run(*words, tmp_path / "a.png", *decay, "--show", "p-pass").status == 0
    for options, said in (
        ((*decay, "--show", "p-above"), "belongs to --posterior reflection"),
        ((*decay, "--level", 0.5), "--level changes .npz"),
        ((*decay, "--prior", 0.5), "--prior belongs to --posterior log-odds"),
        ((*REFLECTION, "--show", "p-pass"), "belongs to --posterior decay"),
    ):
        assert said in run(*words, tmp_path / "b.png", *options).line
    assert "as .png or .npz" in run(*words, tmp_path / "b.yaml", *decay).line
    assert not list(tmp_path.glob("b.*"))
