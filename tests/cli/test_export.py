# SPDX-License-Identifier: Apache-2.0
"""`oddsmap export` of 2D maps, and requests that no view can serve."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import oddsmap
from tests.cli.conftest import Run


@pytest.fixture
def saved(run: Run, office: Path, tmp_path: Path) -> Path:
    out = tmp_path / "office.zarr"
    assert run("build", office, "--resolution", 0.1, "-o", out).status == 0
    return out


def test_npz(run: Run, saved: Path, tmp_path: Path) -> None:
    out = tmp_path / "office.npz"
    assert run("export", saved, out, "--prior", 0.2).status == 0
    grid = oddsmap.load_map(saved)
    index, hits, passes = grid.cells()
    with np.load(out) as arrays:
        assert arrays["index"].dtype == np.int64
        assert np.array_equal(arrays["index"], index)
        assert np.array_equal(arrays["hits"], hits / 65536)
        assert np.array_equal(arrays["passes"], passes / 65536)
        assert arrays["probability"].dtype == np.float32
        expected = grid.log_odds(prior=0.2).cells()[1].astype(np.float32)
        assert np.array_equal(arrays["probability"], expected)
        assert arrays["observed"].all()
        assert arrays["resolution"] == 0.1


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
def test_ros(run: Run, saved: Path, tmp_path: Path, mode: str) -> None:
    out = tmp_path / "ros.yaml"
    assert run("export", saved, out, "--mode", mode).status == 0
    view = oddsmap.load_map(saved).log_odds()
    back = oddsmap.load_ros(out)
    assert np.array_equal(
        back.observed if mode != "trinary" else back.observed & view.observed(), back.observed
    )
    assert np.array_equal(back.state() == 100, view.state() == 100)
    assert back.resolution == 0.1
    assert back.origin == view.to_probability_map().origin


def test_pictures(run: Run, saved: Path, office: Path, tmp_path: Path) -> None:
    poses = tmp_path / "way.txt"
    poses.write_text("0.0 1 2 0 0 0 0 1\n1.0 3 2.5 0 0 0 0 1\n")
    shape = ("--title", "Büro", "--size", 400, "--crop", 0, 0, 12, 8)
    for name, way in (("log.svg", office), ("poses.svg", poses)):
        assert run("export", saved, tmp_path / name, *shape, "--trajectory", way).status == 0
    for name, start in (("a.pdf", b"%PDF"), ("a.png", b"\x89PNG")):
        assert run("export", saved, tmp_path / name).status == 0
        assert (tmp_path / name).read_bytes().startswith(start)
    drawn = [(tmp_path / f"{name}.svg").read_text().count("#e4572e") for name in ("log", "poses")]
    assert min(drawn) > 0


@pytest.mark.parametrize(
    ("name", "words", "message"),
    [
        ("m.yaml", ("--title", "x"), "--title, --trajectory, --crop, --size and --whole shape a"),
        ("m.png", ("--size", 5), "size is 100 to 3800 pixels, got 5"),
        ("m.png", ("--crop", 3, 0, 1, 1), "crop is x_min y_min x_max y_max"),
        ("m.png", ("--crop", 300, 300, 301, 301), "known in the crop 300 300 301 301"),
        ("m.npz", ("--posterior", "reflection", "--crop", 0, 0, 1, 1), "--crop shapes a picture"),
        ("m.png", ("--crop", 0, 0, 9, 9, "--whole"), "leave one of them out"),
        ("m.png", ("--trajectory", "none.log"), "none.log"),
    ],
)
def test_wrong_pictures(
    run: Run, saved: Path, tmp_path: Path, name: str, words: tuple[object, ...], message: str
) -> None:
    done = run("export", saved, tmp_path / name, *words)
    assert done.status == 1
    assert message in done.line
    assert not (tmp_path / name).exists()


def test_a_trajectory_is_a_log_or_poses(run: Run, saved: Path, tmp_path: Path) -> None:
    other = tmp_path / "notes.txt"
    other.write_text("what is this\n")
    done = run("export", saved, tmp_path / "m.png", "--trajectory", other)
    assert "--trajectory: neither a log nor a file of poses" in done.line


def test_png(run: Run, saved: Path, tmp_path: Path) -> None:
    out = tmp_path / "office.png"
    assert run("export", saved, out).status == 0
    assert out.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["x.gif"], "the suffix says what to write"),
        (["x.npz", "--prior", "2"], "prior is a probability"),
        (["x.npz", "--prior", "other.zarr"], "neither a number nor a file"),
        (["x.npz", "--p-hit", "0.3"], "p_miss < 0.5 < p_hit"),
        (
            ["x.npz", "--posterior", "refraction"],
            "known: log-odds, calibrated, full-map",
        ),
    ],
)
def test_export_failures(
    run: Run, saved: Path, tmp_path: Path, words: list[str], message: str
) -> None:
    assert message in run("export", saved, tmp_path / words[0], *words[1:]).line
    assert not (tmp_path / words[0]).exists()


def test_export_refuses_what_exists(run: Run, saved: Path, tmp_path: Path) -> None:
    out = tmp_path / "office.pgm"
    out.write_text("mine")
    assert "exists already" in run("export", saved, tmp_path / "office.yaml").line
    assert out.read_text() == "mine"
    assert not (tmp_path / "office.yaml").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("hall.zarr", "m.npz", "--posterior", "odds"), "known: log-odds, calibrated, full-map"),
        (("hall.zarr", "m.png", "--show", "mean"), "--show belongs to --posterior reflection"),
        (("hall.zarr", "m.npz", "--beta-a", 2), "--beta-a belongs to --posterior reflection"),
        (("hall.zarr", "m.npz", "--posterior", "reflection", "--prior", 0.3),
         "--prior belongs to --posterior log"),
        (("hall.zarr", "m.npz", "--posterior", "reflection", "--p-hit", 0.8), "not to reflection"),
        (("hall.zarr", "m.png", "--mode", "raw"), "--mode says how a ROS map is written"),
    ],
)  # fmt: skip
def test_options_of_another_view(
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
