# SPDX-License-Identifier: Apache-2.0
"""Saved maps that stay on the disk, against the same maps read whole."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oddsmap
from oddsmap import ConfigError, EvidenceMap, InputError, SavedMap, Thresholds
from oddsmap.kernels.units import ONE
from oddsmap.map_files import zarr_folder
from oddsmap.map_files.zarr_folder import SHARD
from oddsmap.odds import sigmoid
from oddsmap.plot.picture import block_values
from tests.kit import votes_of


def noise(ndim: int, part: int = 1, *, lengths: bool = False, seed: int = 0) -> EvidenceMap:
    """Cells in several shards around the origin, most of them near others."""
    rng = np.random.default_rng(ndim + seed)
    grid = EvidenceMap(0.1, ndim=ndim, votes="beam", path_lengths=lengths)
    reach = 2 * SHARD[ndim]
    places = rng.integers(-reach, reach, (25, ndim))[:, None] + rng.integers(0, 12, (80, ndim))
    index = np.unique(places.reshape(-1, ndim), axis=0)
    grid.add_cells(index, *(rng.integers(0, 400, (2, len(index))) * (ONE // part)))
    if grid.lengths is not None:
        grid.lengths.add_cells(index + 3, rng.integers(1, 99, (len(index), 1)) * np.array([[0, 1]]))
    grid.record("some.log", scans=7)
    return grid


MAPS = {
    "plane": lambda: noise(2),
    "space": lambda: noise(3),
    "parts of votes": lambda: noise(3, 8),
    "lengths": lambda: noise(2, lengths=True),
    "no cell": lambda: EvidenceMap(0.1),
}


@pytest.fixture(scope="module", params=MAPS)
def pair(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> tuple[EvidenceMap, SavedMap[EvidenceMap]]:
    path = tmp_path_factory.mktemp("maps") / "map.zarr"
    MAPS[request.param]().save(path)
    return oddsmap.load_map(path), EvidenceMap.open(path)


def test_what_the_header_says(pair: tuple[EvidenceMap, SavedMap[EvidenceMap]]) -> None:
    whole, saved = pair
    assert str(saved.bounds()) == str(whole.bounds())
    assert saved.config == whole.config
    assert saved.provenance == whole.provenance
    assert (saved.resolution, saved.ndim, saved.votes) == (0.1, whole.ndim, "beam" if (
        whole.cell_count()) else "scan")  # fmt: skip
    assert f"{whole.ndim}D, cells of 0.1 m" in repr(saved)
    assert ("empty" in repr(saved)) == (whole.cell_count() == 0)


def test_opening_reads_no_shard(tmp_path: Path) -> None:
    noise(2).save(tmp_path / "map.zarr")
    for file in (tmp_path / "map.zarr").rglob("c/*/*"):
        file.write_bytes(b"no shard")
    saved = EvidenceMap.open(tmp_path / "map.zarr")
    assert "x -" in repr(saved)
    assert saved.bounds() is not None


@given(st.data())
@settings(max_examples=8)
def test_regions(pair: tuple[EvidenceMap, SavedMap[EvidenceMap]], data: st.DataObject) -> None:
    whole, saved = pair
    reach = 2 * SHARD[saved.ndim]
    at = st.integers(-reach - 9, reach + 20)
    lo = np.array([data.draw(at) for _ in range(saved.ndim)])
    hi = lo + [data.draw(st.integers(0, 150)) for _ in range(saved.ndim)]
    part, own = saved.crop(lo, hi), whole.crop(lo, hi)
    assert votes_of(part) == votes_of(own)
    assert part.provenance == own.provenance
    if part.lengths is not None:
        assert str(part.cell_lengths()) == str(own.cell_lengths())
    for ours, theirs in zip(saved.region(lo, hi), whole.region(lo, hi), strict=True):
        assert np.array_equal(ours, theirs)


def test_a_box_of_metres(pair: tuple[EvidenceMap, SavedMap[EvidenceMap]]) -> None:
    whole, saved = pair
    lo, hi = np.full((2, saved.ndim), [[-7.35], [9.05]])
    assert votes_of(saved.crop_box(lo, hi)) == votes_of(whole.crop_box(lo, hi))
    with pytest.raises(InputError, match="lowest corner before its highest"):
        saved.crop_box(hi, lo)
    with pytest.raises(InputError, match="indices"):
        saved.crop([0], [5])


@pytest.mark.parametrize("cache", [0, 10_000, 1 << 28])
def test_points(pair: tuple[EvidenceMap, SavedMap[EvidenceMap]], cache: int) -> None:
    whole, saved = pair[0], SavedMap(pair[1].path, EvidenceMap, cache=cache)
    rng, index = np.random.default_rng(1), whole.cells()[0]
    points = np.concatenate([
        whole.centre_of(index[:: max(1, len(index) // 200)]),
        rng.uniform(-80.0, 80.0, (100, saved.ndim)), np.full((1, saved.ndim), 1e7),
    ])  # fmt: skip
    rng.shuffle(points)
    view, limits = whole.log_odds(), Thresholds(0.2, 0.9)
    for _ in range(2):
        assert np.array_equal(saved.at(points), view.at(points))
        ours = saved.states_at(points, thresholds=limits)
        theirs = view.states_at(points, thresholds=limits)
        for name in ("cell", "probability", "state", "hits", "passes"):
            assert np.array_equal(getattr(ours, name), getattr(theirs, name))
    assert str(saved.votes_at(points)) == str((ours.hits, ours.passes))
    own = saved.at(points, view=lambda part: part.log_odds(p_hit=0.9, prior=0.1))
    assert np.array_equal(own, whole.log_odds(p_hit=0.9, prior=0.1).at(points))
    assert saved.at(np.empty((0, saved.ndim))).shape == (0,)
    with pytest.raises(InputError, match="have no cell"):
        saved.at(np.full((1, saved.ndim), np.nan))


def test_parts_add_up(pair: tuple[EvidenceMap, SavedMap[EvidenceMap]]) -> None:
    whole, saved = pair
    parts = list(saved.parts())
    assert sum(part.cell_count() for part in parts) == whole.cell_count()
    total = whole.like()
    for part in parts:
        total.merge(part)
    assert votes_of(total) == votes_of(whole)


@pytest.mark.parametrize("pixels", [2, 60, 700])
def test_the_overview(pair: tuple[EvidenceMap, SavedMap[EvidenceMap]], pixels: int) -> None:
    whole, saved = pair
    zoom = saved.overview(pixels)
    index, p = whole.log_odds().cells()
    assert max(zoom.observed.shape) <= pixels
    block = round(zoom.resolution / 0.1)
    corner = np.rint(np.array(zoom.origin) / 0.1).astype(int)
    assert not (corner % block).any()
    places = (index[:, :2] - corner) // block
    values: dict[tuple[int, int], list[float]] = {}
    for (x, y), value in zip(places.tolist(), p.tolist(), strict=True):
        values.setdefault((y, x), []).append(value)
    assert {tuple(at) for at in np.argwhere(zoom.observed).tolist()} == set(values)
    for at, found in values.items():
        expected = max(found) if max(found) >= 0.5 else np.mean(found)
        assert zoom.probability[at] == pytest.approx(expected, abs=1e-6)
    assert (zoom.probability[~zoom.observed] == whole.config.posterior.prior).all()


def test_the_overview_is_that_of_pictures(tmp_path: Path) -> None:
    """Of a plane whose blocks begin where the picture's do."""
    noise(2).crop([-700, -500], [900, 700]).save(tmp_path / "map.zarr")
    saved = EvidenceMap.open(tmp_path / "map.zarr")
    zoom = saved.overview(300)
    block = round(zoom.resolution / 0.1)
    lo = np.rint(np.array(zoom.origin) / 0.1).astype(int)
    box = lo, lo + block * np.array(zoom.observed.shape[::-1])
    view = oddsmap.load_map(tmp_path / "map.zarr").log_odds()
    dense = np.where(view.observed(box), view.probability(box), -1.0).astype(np.float32)
    ours = np.where(zoom.observed, zoom.probability, -1.0)
    assert ours == pytest.approx(block_values(dense, block), abs=1e-6)


def test_the_overview_with_a_prior_map(tmp_path: Path) -> None:
    grid, old = noise(2), noise(2, seed=5)
    grid.save(tmp_path / "map.zarr")
    zoom = EvidenceMap.open(tmp_path / "map.zarr").overview(
        50, view=lambda part: part.log_odds(prior=old)
    )
    view = grid.log_odds(prior=old)
    index, p = view.known_log_odds()[0], sigmoid(view.known_log_odds()[1])
    worst = index[np.argmax(p)]
    assert zoom.at(grid.centre_of([worst]))[0] == pytest.approx(p.max(), abs=1e-6)


def test_what_is_refused(tmp_path: Path) -> None:
    noise(2).save(tmp_path / "map.zarr")
    with pytest.raises(ConfigError, match="cache"):
        SavedMap(tmp_path / "map.zarr", EvidenceMap, cache=-1)
    with pytest.raises(ConfigError, match="pixels: 2 to 3800 along each side, got 1"):
        EvidenceMap.open(tmp_path / "map.zarr").overview(1)
    with pytest.raises(InputError, match="no such file"):
        EvidenceMap.open(tmp_path / "no.zarr")
    with pytest.raises(InputError, match="not a saved map"):
        EvidenceMap.open(tmp_path)


def test_views_that_are_fitted(tmp_path: Path) -> None:
    grid = noise(2)
    grid.save(tmp_path / "map.zarr")
    saved, points = EvidenceMap.open(tmp_path / "map.zarr"), grid.centre_of(grid.cells()[0])
    with pytest.raises(ConfigError, match="would be fitted to each shard alone"):
        saved.at(points, view=EvidenceMap.calibrated)
    with pytest.raises(ConfigError, match="looks at cells of other shards"):
        saved.overview(view=lambda part: part.calibrated(neighbours=True))
    own = grid.calibrated()
    ours = saved.at(points, view=lambda part: part.calibrated(model=own.model, prior=own.prior))
    assert np.array_equal(ours, own.at(points))


def test_damage_is_said_in_a_line_where_it_is_met(tmp_path: Path) -> None:
    path = tmp_path / "map.zarr"
    noise(2).save(path)
    saved = EvidenceMap.open(path)
    lo, hi = np.array([[0, 0], [100, 100]])
    points = saved.centre_of(noise(2).cells()[0])
    first, *_ = sorted(path.glob("hits/c/*/*"))
    content = first.read_bytes()
    first.unlink()
    for ask in (lambda: saved.at(points), saved.overview, lambda: list(saved.parts()),
                lambda: saved.crop(lo - 5000, hi + 5000)):  # fmt: skip
        with pytest.raises(InputError, match=r"map.zarr: damaged.*hits/c/\d+/\d+ is missing") as e:
            ask()
        assert "\n" not in str(e.value)
    first.write_bytes(content[:-40])
    with pytest.raises(InputError, match="damaged"):
        saved.at(points)


def test_a_map_that_is_replaced_has_to_be_opened_again(tmp_path: Path) -> None:
    path = tmp_path / "map.zarr"
    noise(2).save(path)
    saved = EvidenceMap.open(path)
    kept = saved.centre_of(noise(2).cells()[0][:1])
    before = saved.at(kept)
    noise(2, seed=1).save(path, force=True)
    assert saved.at(kept) == before  # of what was read, nothing is mixed with the new map
    for ask in (saved.overview, lambda: saved.crop([0, 0], [9, 9])):
        with pytest.raises(InputError, match="has changed since it was opened: open it again"):
            ask()
    assert votes_of(EvidenceMap.open(path).crop([-9999] * 2, [9999] * 2)) == votes_of(
        noise(2, seed=1)
    )


def test_it_goes_to_other_processes(tmp_path: Path) -> None:
    noise(2).save(tmp_path / "map.zarr")
    saved = EvidenceMap.open(tmp_path / "map.zarr")
    points = saved.centre_of(noise(2).cells()[0])
    before = saved.at(points)
    content = pickle.dumps(saved)
    assert len(content) < 20_000
    assert np.array_equal(pickle.loads(content).at(points), before)


def test_an_unlisted_shard_counts(tmp_path: Path) -> None:
    """Another process may have added one, as the format allows."""
    path = tmp_path / "map.zarr"
    noise(2).save(path)
    saved = EvidenceMap.open(path)
    listed = {tuple(place) for place in zarr_folder.shard_files(path, "hits", 2)}
    free = next(
        (y, x) for y in range(4) for x in range(4) if (y, x) not in listed
    ) if len(listed) < 16 else None  # fmt: skip
    if free is None:
        pytest.skip("all shards hold something")
    for name in ("hits", "passes"):
        source = path / name / "c" / "/".join(map(str, sorted(listed)[0]))
        target = path / name / "c" / "/".join(map(str, free))
        target.parent.mkdir(exist_ok=True)
        target.write_bytes(source.read_bytes())
    whole = oddsmap.load_map(path)
    assert sum(part.cell_count() for part in saved.parts()) == whole.cell_count()
