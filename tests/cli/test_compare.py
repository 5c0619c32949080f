# SPDX-License-Identifier: Apache-2.0
"""`oddsmap compare`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import oddsmap
from oddsmap.plot.comparison import COLOURS, save_kinds
from tests.cli.conftest import Run
from tests.kit import ONE, Votes, add_votes

FREE, WALL, ONCE = (0, 9 * ONE), (3 * ONE, 0), (0, ONE)


def save(path: Path, votes: Votes, **options: object) -> Path:
    grid = oddsmap.EvidenceMap(0.1, **options)  # type: ignore[arg-type]
    add_votes(grid, votes)
    grid.save(path)
    return path


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Path, Path]:
    before: Votes = {(0, 0): FREE, (1, 0): WALL, (2, 0): FREE, (3, 0): ONCE, (4, 0): WALL}
    after: Votes = {(0, 0): FREE, (1, 0): FREE, (2, 0): WALL, (3, 0): FREE, (9, 9): WALL,
                    (8, 8): WALL}  # fmt: skip
    return save(tmp_path / "before.zarr", before), save(tmp_path / "after.zarr", after)


def test_in_words_and_for_programs(run: Run, pair: tuple[Path, Path]) -> None:
    done = run("compare", *pair)
    assert done.status == 0
    both, agree, decided, changed, log_odds, alone = done.out.splitlines()
    assert both == "both     4 cells known in both"
    assert agree == "agree    25.00% have the same state"
    assert decided == "decided  3 are free or occupied in both, 33.33% of them the same"
    assert changed == "changed  1 free, then occupied; 1 occupied, then free"
    assert log_odds.startswith("log odds second less first: mean ")
    assert alone == "alone    1 cells known in the first alone, 2 in the second"
    facts = run("compare", *pair, "--json").json
    assert (facts["free_to_occupied"], facts["occupied_to_free"]) == (1, 1)
    assert facts["states"]["undecided"] == {"free": 1, "undecided": 0, "occupied": 0}
    assert (facts["first_alone"], facts["second_alone"]) == (1, 2)
    assert facts["agreement"] == 0.25


def test_a_picture(run: Run, pair: tuple[Path, Path], tmp_path: Path) -> None:
    from matplotlib.colors import to_rgb
    from PIL import Image

    out = tmp_path / "diff.png"
    done = run("compare", *pair, "--plot", out)
    assert done.out.splitlines()[-1] == f"picture  {out}"
    pixels = np.asarray(Image.open(out).convert("RGB")).reshape(-1, 3)
    for colour in set(COLOURS) - {"#d9d9d9", "#11141a"}:  # no cell but in the legend
        rgb = np.rint(255 * np.array(to_rgb(colour)))
        assert np.count_nonzero((pixels == rgb).all(axis=1)) > 1000
    assert "use --force" in run("compare", *pair, "--plot", out).line
    assert run("compare", *pair, "--plot", out, "--force").status == 0


def test_a_change_shows_in_a_block_of_cells(tmp_path: Path) -> None:
    from PIL import Image

    kinds = np.ones((40, 8000), np.uint8)
    kinds[11, 4001] = 7
    names = tuple("abcdefgh")
    save_kinds(kinds, tmp_path / "m.png", resolution=0.1, origin=(0, 0), names=names)
    pixels = np.asarray(Image.open(tmp_path / "m.png").convert("RGB"))
    assert pixels.shape[1] < 4000
    assert (pixels[300:] == (0xE4, 0x57, 0x2E)).all(axis=2).any()


def test_maps_without_a_common_cell(run: Run, tmp_path: Path) -> None:
    one, other = (save(tmp_path / f"{x}.zarr", {(x, 0): FREE}) for x in (1, 2))
    done = run("compare", one, other)
    assert done.out.splitlines() == [
        f"{other}: warning: no cell is known in both maps: they are of other places, or of other "
        "frames",
        "both     0 cells known in both",
        "alone    1 cells known in the first alone, 1 in the second",
    ]
    assert run("compare", one, other, "--json").json["agreement"] is None
    empty = save(tmp_path / "empty.zarr", {})
    for pair in ((one, empty), (empty, one)):
        assert "empty.zarr: has no known cell, so there is nothing" in run("compare", *pair).line


def test_settings_that_differ_are_said(run: Run, pair: tuple[Path, Path], tmp_path: Path) -> None:
    other = save(tmp_path / "m.zarr", {(0, 0): FREE}, sensor=oddsmap.BeamSensor(p_hit=0.9))
    done = run("compare", pair[0], other)
    assert "sensor.p_hit is 0.9, and 0.7 in the first map: states may differ" in done.out
    coarse = tmp_path / "coarse.zarr"
    native = tmp_path / "native.zarr"
    assert run("resample", pair[0], "--resolution", 0.2, "-o", coarse).status == 0
    grid = oddsmap.EvidenceMap(0.2)
    grid.add(oddsmap.Scan.from_angles((0, 0, 0), [0.0], [1.0]))
    grid.save(native)
    assert "warning: it is resampled from 0.1 m" in run("compare", native, coarse).out


@pytest.mark.parametrize(
    ("first", "second", "options", "message"),
    [
        ("hall", "coarse", (), "resample the finer one to 0.3 m"),
        ("hall", "space", (), "cell by cell"),
        ("space", "before", ("--plot", "m.png"), "a picture needs 2D maps"),
        ("hall", "old", ("--plot", "m.pgn"), "ends in .png"),
        ("hall", "gone", (), "no such file"),
    ],
)  # fmt: skip
def test_wrong_requests(
    run: Run,
    maps: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    first: str,
    second: str,
    options: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    paths = (maps / f"{name}.zarr" for name in (first, second))
    assert message in run("compare", *paths, *options).line
    assert list(tmp_path.iterdir()) == []


def test_space(run: Run, maps: Path) -> None:
    facts = run("compare", maps / "space.zarr", maps / "before.zarr", "--json").json
    assert facts["cells_known_in_both"] > 0


def test_calibrated_views(run: Run, pair: tuple[Path, Path]) -> None:
    facts = run("compare", *pair, "--posterior", "calibrated", "--json").json
    views = [oddsmap.load_map(path).calibrated() for path in pair]
    found = oddsmap.compare(*views)
    assert (facts["posterior"], facts["cells_known_in_both"]) == ("calibrated", 4)
    assert facts["log_odds_rms"] == found.rms
    assert found.rms != run("compare", *pair, "--json").json["log_odds_rms"]
    # Priors are fitted to each map, and not settings that somebody chose.
    assert "posterior.prior" not in run("compare", *pair, "--posterior", "calibrated").out
    line = run("compare", *pair, "--posterior", "reflection").line
    assert "there is no such view (known: log-odds, calibrated)" in line
