# SPDX-License-Identifier: Apache-2.0
"""Maps of a cluster are those of one machine, file by file; its workers are threads here."""

from __future__ import annotations

import shutil
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import oddsmap
from oddsmap import (
    EvidenceMap,
    InputError,
    OutputError,
    Scan,
    build_map,
    load_map,
    open_log,
    scale,
)
from oddsmap.evidence.evidence import Evidence
from oddsmap.scale import write_on_cluster
from oddsmap.scale.chunk_task import Chunk, map_chunk
from oddsmap.scale.log_source import LogSource
from oddsmap.scale.map_places import LocalPlace, UrlPlace, url_of
from oddsmap.scale.marked_place import mark
from oddsmap.scale.worker_versions import versions_here
from tests.kit import ONE
from tests.scale.conftest import files_of, write_clouds

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning")


def assert_same(evidence: EvidenceMap, made: Path, folder: Path) -> None:
    one = folder / "one.zarr"
    evidence.save(one, force=True)
    assert files_of(made) == files_of(one)
    assert [path.name for path in folder.iterdir() if path.name.startswith(".")] == []


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"votes": "beam", "path_lengths": True},
        {"half_life": 0.7},
        {"half_life_scans": 3.0},
        {"sensor": oddsmap.BeamSensor(fade=0.5, hit_width=0.2)},
    ],
    ids=["votes by scan", "lengths", "half-life", "half-life in scans", "fading"],
)
def test_a_log_in_chunks(
    threads_of_dask: Any, clouds: Path, tmp_path: Path, options: dict[str, Any]
) -> None:
    grid = build_map(open_log(clouds), 0.25, **options)
    out, done = tmp_path / "map.zarr", list[int]()
    built = scale.build(
        str(clouds), 0.25, output=out, client=threads_of_dask, chunk_scans=3,
        progress=done.append, **options,
    )  # fmt: skip
    assert_same(grid, out, tmp_path)
    assert grid.report is not None
    assert (built.report.scans, built.report.beams) == (grid.report.scans, grid.report.beams)
    assert built.report.skipped == grid.report.skipped
    assert built.census.cells == grid.cell_count()
    assert (built.chunk_count, done[-1]) == (4, 10)
    assert repr(built).startswith("Built(")


def test_several_logs(threads_of_dask: Any, drives: list[Path], tmp_path: Path) -> None:
    first, second = map(open_log, drives)
    grid = build_map(first, 0.1)
    grid.add(second)
    out = tmp_path / "map.zarr"
    built = scale.build(drives, 0.1, output=out, client=threads_of_dask)
    assert_same(grid, out, tmp_path)
    assert built.chunk_count == 2
    assert built.notes == {str(log.path): log.notes for log in (first, second)}
    with pytest.raises(OutputError, match="exists already"):
        scale.build(drives, 0.1, output=out, client=threads_of_dask)
    scale.build(drives[:1], 0.1, output=out, client=threads_of_dask, force=True)
    assert_same(build_map(first, 0.1), out, tmp_path)


def test_scans_that_cannot_be_read(threads_of_dask: Any, damaged: Path, tmp_path: Path) -> None:
    log = open_log(damaged, skip_bad=True)
    grid = build_map(log, 0.25)
    out = tmp_path / "map.zarr"
    built = scale.build(
        damaged, 0.25, output=out, client=threads_of_dask, chunk_scans=3, reading={"skip_bad": True}
    )
    assert_same(grid, out, tmp_path)
    assert built.notes[str(damaged)] == log.notes
    assert "3 scans were skipped, the first" in str(log.notes)
    assert built.report.skipped == log.skipped
    (tmp_path / "old").mkdir()
    with pytest.raises(InputError, match=r"000002\.pcd: "):
        scale.build(damaged, 0.25, output=tmp_path / "no.zarr", client=threads_of_dask)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map.zarr", "old", "one.zarr"]


def test_what_is_said_of_no_returns(
    threads_of_dask: Any, drives: list[Path], tmp_path: Path
) -> None:
    sensor = oddsmap.BeamSensor()
    with pytest.warns(UserWarning, match="give range_max=") as expected:
        build_map(open_log(drives[0]), 0.1, sensor=sensor)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        scale.build(
            drives[0], 0.1, output=tmp_path / "m.zarr", client=threads_of_dask, sensor=sensor
        )
    of_sensor = [str(each.message) for each in said if "range_max" in str(each.message)]
    assert of_sensor == [str(each.message) for each in expected]


def test_a_chunk_that_is_mapped_twice(clouds: Path, tmp_path: Path) -> None:
    """Whoever is second writes the same, under the same name."""
    place, empty = LocalPlace(str(tmp_path), "writing"), Evidence(0.25, ndim=3)
    chunk = Chunk(7, LogSource("a", str(clouds), {}), 10, 3, 6, oddsmap.BeamSensor(), "rays", None)
    with pytest.raises(InputError, match="does not see it as it is here"):
        raise map_chunk(versions_here(), chunk, empty, place, "parts").to_error()  # type: ignore[union-attr]
    mark(place, "parts")
    first = map_chunk(versions_here(), chunk, empty, place, "parts")
    before = {path: path.read_bytes() for path in (tmp_path / "parts").iterdir()}
    again = map_chunk(versions_here(), chunk, empty, place, "parts")
    assert first.parts == again.parts  # type: ignore[union-attr]
    assert {path: path.read_bytes() for path in (tmp_path / "parts").iterdir()} == before
    assert len(before) == 2  # with the mark
    assert empty.cell_count() == 0


def test_many_parts_of_a_group_are_added_a_few_at_a_time(
    threads_of_dask: Any, clouds: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(write_on_cluster, "FAN_IN", 2)
    out = tmp_path / "map.zarr"
    scale.build(clouds, 0.25, output=out, client=threads_of_dask, chunk_scans=1)
    assert_same(build_map(open_log(clouds), 0.25), out, tmp_path)


@pytest.mark.parametrize("votes", [90, 50], ids=["two bytes", "one byte"])
def test_parts_of_one_byte_that_may_need_two(
    threads_of_dask: Any, tmp_path: Path, votes: int
) -> None:
    """Four chunks give one cell 90 votes each, which is more than a byte holds, or 50."""
    points = np.full((votes, 3), (1.1, 0.1, 0.1))
    write_clouds(tmp_path / "log", [Scan.from_points(np.eye(4), points)] * 4)
    grid, out = build_map(open_log(tmp_path / "log"), 0.25, votes="beam"), tmp_path / "map.zarr"
    built = scale.build(
        tmp_path / "log", 0.25, output=out, votes="beam", client=threads_of_dask, chunk_scans=1
    )
    assert_same(grid, out, tmp_path)
    assert built.census.largest == 4 * votes * ONE
    assert load_map(out).census().largest == 4 * votes * ONE


def test_a_map_at_a_url(threads_of_dask: Any, clouds: Path, tmp_path: Path) -> None:
    import fsspec

    grid, url = build_map(open_log(clouds), 0.25), "memory://maps/room.zarr"
    files = fsspec.filesystem("memory")
    try:
        built = scale.build(clouds, 0.25, output=url, client=threads_of_dask, chunk_scans=4)
        assert built.output == url
        assert [name.rpartition("/")[2] for name in files.ls("/maps", detail=False)] == [
            "room.zarr"
        ]
        files.get("/maps/room.zarr", str(tmp_path / "copy.zarr"), recursive=True)
        assert_same(grid, tmp_path / "copy.zarr", tmp_path)
        zarr = pytest.importorskip("zarr")
        hits = zarr.open_group(url, mode="r")["hits"][...]
        assert hits.sum() == grid.census().hits / 65536
        with pytest.raises(OutputError, match="at a URL cannot be replaced in one step"):
            scale.build(clouds, 0.25, output=url, client=threads_of_dask, force=True)
        with pytest.raises(InputError, match="gone: no such file on worker"):
            scale.build("/gone", 0.25, output="memory://maps/b.zarr", client=threads_of_dask)
        assert not files.exists("/maps/b.zarr")
    finally:
        if files.exists("/maps"):
            files.rm("/maps", recursive=True)


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("s3://bucket/m.zarr", "s3://bucket/m.zarr"),
        ("file:///tmp/m.zarr", "file:///tmp/m.zarr"),
        ("memory://m.zarr", "memory://m.zarr"),
        ("m.zarr", None),
        ("/maps/a:/m.zarr", None),
        ("C:/maps/m.zarr", None),
    ],
)
def test_urls_that_were_made_paths(text: str, url: str | None) -> None:
    assert url_of(Path(text)) == url


def test_a_url_that_nobody_knows(clouds: Path) -> None:
    with pytest.raises(InputError, match="nonsense://a: cannot be reached"):
        scale.build(clouds, 0.25, output="nonsense://a/m.zarr")
    place = UrlPlace("file:///tmp")
    assert not place.exists(f"no-such-thing-{np.random.default_rng().integers(1 << 40)}")


def test_a_log_of_no_usable_scan(threads_of_dask: Any, tmp_path: Path, clouds: Path) -> None:
    folder = tmp_path / "none"
    shutil.copytree(clouds, folder)
    for path in folder.glob("*.pcd"):
        path.write_bytes(b"VERSION 0.7\nnonsense\n")
    with pytest.raises(InputError, match=r"no usable scan \(10 x scan.unreadable\)"):
        scale.build(
            folder, 0.25, output=tmp_path / "m.zarr", client=threads_of_dask,
            reading={"skip_bad": True}, chunk_scans=4,
        )  # fmt: skip
