"""`oddsmap export`, `info` and `demo`."""

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


def test_png(run: Run, saved: Path, tmp_path: Path) -> None:
    out = tmp_path / "office.png"
    assert run("export", saved, out).status == 0
    assert out.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["x.tiff"], "the suffix says what to write"),
        (["x.npz", "--prior", "2"], "prior is a probability"),
        (["x.npz", "--prior", "other.zarr"], "neither a number nor a file"),
        (["x.npz", "--p-hit", "0.3"], "p_miss < 0.5 < p_hit"),
        (["x.npz", "--posterior", "refraction"], "known: log-odds, reflection"),
    ],
)
def test_export_failures(
    run: Run, saved: Path, tmp_path: Path, words: list[str], said: str
) -> None:
    assert said in run("export", saved, tmp_path / words[0], *words[1:]).line
    assert not (tmp_path / words[0]).exists()


def test_export_refuses_what_exists(run: Run, saved: Path, tmp_path: Path) -> None:
    out = tmp_path / "office.pgm"
    out.write_text("mine")
    assert "exists already" in run("export", saved, tmp_path / "office.yaml").line
    assert out.read_text() == "mine"
    assert not (tmp_path / "office.yaml").exists()


def test_info_of_a_log(run: Run, office: Path) -> None:
    facts = run("info", office, "--json").json
    assert (facts["format"], facts["scans"], facts["beams"]) == ("CARMEN", 20, 3600)
    assert "CARMEN" in run("info", office).out


def test_info_of_a_map(run: Run, saved: Path) -> None:
    facts = run("info", saved, "--json").json
    assert facts["cells known"] == oddsmap.load_map(saved).cell_count()
    assert facts["made from"][0]["source"] == "office.log.gz"
    assert "resolution   0.1" in run("info", saved).out


def test_demo(run: Run, tmp_path: Path) -> None:
    folder = tmp_path / "demo"
    said = run("demo", "-o", folder)
    assert said.status == 0
    assert {path.suffix for path in folder.iterdir()} == {".gz", ".zarr", ".yaml", ".pgm", ".png"}
    assert oddsmap.load_map(folder / "office.zarr").cell_count() > 50_000
    assert "exists already" in run("demo", "-o", folder).line


def test_help_and_version(run: Run) -> None:
    assert "oddsmap build" in run("--help").out
    assert oddsmap.__version__ in run("--version").out
