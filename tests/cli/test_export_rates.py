# SPDX-License-Identifier: Apache-2.0
"""`oddsmap export --posterior`: how often cells reflect beams, and how soon beams end in them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import oddsmap
from tests.cli.conftest import Run
from tests.kit import fan_scan

REFLECTION = ("--posterior", "reflection")


def picture(path: Path) -> bytes:
    with Image.open(path) as image:
        return image.convert("RGB").tobytes()


def test_each_quantity_is_another_picture(run: Run, maps: Path, tmp_path: Path) -> None:
    made = {}
    for show in ("mean", "mode", "std", "interval-width", "lower", "upper", "p-above"):
        out = tmp_path / f"{show}.png"
        words = (*REFLECTION, "--show", show)
        assert run("export", maps / "hall.zarr", out, *words).status == 0
        made[picture(out)] = show
    assert len(made) == 7
    out = tmp_path / "m.png"
    assert run("export", maps / "hall.zarr", out, *REFLECTION).status == 0
    assert made[picture(out)] == "mean"


def test_options_reach_the_view(run: Run, maps: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.npz"
    words = ("--level", 0.8, "--interval", "highest-density", "--beta-a", 0.5, "--beta-b", 2)
    for name in ("hall", "space"):
        done = run("export", maps / f"{name}.zarr", out, *REFLECTION, *words, "--force")
        assert (done.status, done.err) == (0, "")
        view = oddsmap.load_map(maps / f"{name}.zarr").reflection(
            level=0.8, kind="highest-density", a=0.5, b=2.0
        )
        view.save_npz(tmp_path / "want.npz", force=True)
        with np.load(out) as arrays, np.load(tmp_path / "want.npz") as want:
            assert set(arrays) >= {"index", "hits", "passes", "probability", "std", "lower"}
            for field in want:
                assert np.array_equal(arrays[field], want[field])


def test_pictures_follow_their_options(run: Run, maps: Path, tmp_path: Path) -> None:
    def drawn(*words: object) -> bytes:
        out = tmp_path / "m.png"
        assert run("export", maps / "hall.zarr", out, *REFLECTION, *words, "--force").status == 0
        return picture(out)

    for show, option in (
        ("lower", ("--level", 0.5)),
        ("upper", ("--interval", "highest-density")),
        ("p-above", ("--threshold", 0.2)),
        ("mean", ("--beta-a", 5)),
        ("mean", ("--beta-b", 5)),
    ):
        assert drawn("--show", show) != drawn("--show", show, *option)


def test_ros(run: Run, maps: Path, tmp_path: Path) -> None:
    view = oddsmap.load_map(maps / "hall.zarr").reflection()
    for mode in ((), ("--mode", "raw")):
        out = tmp_path / f"m{len(mode)}.yaml"
        assert run("export", maps / "hall.zarr", out, *REFLECTION, *mode).status == 0
        back = oddsmap.load_ros(out)
        assert np.array_equal(back.observed, view.observed())
        assert np.allclose(back.probability[back.observed], view.mean()[back.observed], atol=0.006)


def test_votes_of_scans_are_warned_of(run: Run, maps: Path, tmp_path: Path) -> None:
    done = run("export", maps / "scans.zarr", tmp_path / "m.npz", *REFLECTION)
    assert done.status == 0
    assert ".zarr: warning: reflectivity from a map of" in done.err
    assert done.err.count("\n") == 1
    assert 'votes="beam"' in done.err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("hall.zarr", "m.npz", *REFLECTION, "--show", "std"), "--show says what a picture shows"),
        (("hall.zarr", "m.png", *REFLECTION, "--level", 0.9), "--level changes .npz and --show"),
        (("hall.zarr", "m.yaml", *REFLECTION, "--threshold", 0.9), "--threshold changes --show"),
        (("hall.zarr", "m.npz", *REFLECTION, "--level", 1.5), "level lies between 0 and 1"),
        (("hall.zarr", "m.npz", *REFLECTION, "--beta-b", 0), "prior's b is a weight above 0"),
        (("hall.zarr", "m.yaml", *REFLECTION, "--mode", "trinary"), "not a state"),
        (("hall.zarr", "m.ply", *REFLECTION), "written as .png, .pdf, .svg, .npz or .yaml"),
        (("space.zarr", "m.png", *REFLECTION), "its reflectivity as .npz"),
        (("before.bt", "m.npz", *REFLECTION), "needs hits and passes"),
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


def test_an_unknown_choice_is_a_usage_error(run: Run, maps: Path, tmp_path: Path) -> None:
    words = (*REFLECTION, "--show", "median")
    done = run("export", maps / "hall.zarr", tmp_path / "m.png", *words)
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
    for options, message in (
        ((*decay, "--show", "p-above"), "belongs to --posterior reflection"),
        ((*decay, "--level", 0.5), "--level changes .npz"),
        ((*decay, "--prior", 0.5), "--prior belongs to --posterior log-odds"),
        ((*REFLECTION, "--show", "p-pass"), "belongs to --posterior decay"),
    ):
        assert message in run(*words, tmp_path / "b.png", *options).line
    assert "as .png, .pdf, .svg or .npz" in run(*words, tmp_path / "b.yaml", *decay).line
    assert not list(tmp_path.glob("b.*"))
