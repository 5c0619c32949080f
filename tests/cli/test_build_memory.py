# SPDX-License-Identifier: Apache-2.0
"""`oddsmap build` with a half-life, and with path lengths."""

from __future__ import annotations

from pathlib import Path

import oddsmap
from tests.cli.conftest import Run


def test_a_half_life_counts_back_from_the_last_scan(run: Run, office: Path, tmp_path: Path) -> None:
    out, plain = tmp_path / "fading.zarr", tmp_path / "plain.zarr"
    done = run(
        "build", office, "--resolution", 0.2, "--set", "map.half_life=5", "-o", out, "--json"
    )
    whole = run("build", office, "--resolution", 0.2, "-o", plain, "--json").json
    stamps = [scan.stamp_ns for scan in oddsmap.open_log(office)]
    last = max(stamp for stamp in stamps if stamp is not None)
    grid = oddsmap.load_map(out)
    assert (grid.config.map.half_life, grid.config.map.t_ref_ns) == (5, last)
    assert grid.provenance[0]["t_ref_ns"] == last
    assert 0.0 < done.json["hits"] < whole["hits"]
    # Two logs of one time: the same last scan.
    twice = tmp_path / "twice.zarr"
    run("build", office, office, "--resolution", 0.2, "--set", "map.half_life=5", "-o", twice)
    both = oddsmap.load_map(twice)
    grid.merge(oddsmap.load_map(out))
    assert all((a == b).all() for a, b in zip(grid.cells(), both.cells(), strict=True))


def test_an_early_reference_is_one_line(run: Run, office: Path, tmp_path: Path) -> None:
    done = run(
        "build", office, "--resolution", 0.2, "--set", "map.half_life=5",
        "--set", "map.t_ref_ns=1", "-o", tmp_path / "x.zarr",
    )  # fmt: skip
    assert "later than the map's t_ref_ns 1" in done.line
    assert not (tmp_path / "x.zarr").exists()


def test_path_lengths(run: Run, office: Path, tmp_path: Path) -> None:
    out = tmp_path / "decay.zarr"
    words = ["--resolution", 0.2, "--set", "map.path_lengths=true", "-o", out]
    assert 'needs map.votes "beam"' in run("build", office, *words).line
    assert run("build", office, *words, "--votes", "beam").status == 0
    grid = oddsmap.load_map(out)
    index, units = grid.cell_lengths()
    assert len(index) >= grid.cell_count() / 2
    assert units.sum() > 0
    assert (grid.decay_rate().mean() > 0.0).all()


def test_a_half_life_of_scans_counts_back_from_the_last_one(
    run: Run, office: Path, tmp_path: Path
) -> None:
    out, again = tmp_path / "a.zarr", tmp_path / "b.zarr"
    words = ("build", office, "--resolution", 0.2)
    done = run(*words, "--half-life-scans", 5, "-o", out, "--json")
    assert done.status == 0, done.err
    log = oddsmap.open_log(office)
    grid = oddsmap.load_map(out)
    assert (grid.config.map.half_life_scans, grid.config.map.ref_scan) == (5, len(log) - 1)
    settings = tmp_path / "door.toml"
    settings.write_text(f"[map]\nhalf_life_scans = 5\nref_scan = {len(log)}\n")
    run(*words, "--config", settings, "-o", again)
    assert oddsmap.load_map(again).census().hits < grid.census().hits
    differ = run("merge", out, again, "-o", tmp_path / "c.zarr")
    assert "different ref_scan" in differ.line
    two = run(*words[:2], office, *words[2:], "--half-life-scans", 5, "-o", tmp_path / "c.zarr")
    assert "two scans have the number 0" in two.line
    late = run(*words, "--half-life-scans", 5, "--set", "map.ref_scan=3", "-o", tmp_path / "c.zarr")
    assert "scan 4 is later than the map's ref_scan 3" in late.line
