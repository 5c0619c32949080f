# SPDX-License-Identifier: Apache-2.0
"""Bags and MCAP on a cluster: in chunks of scans, and the map is that of one machine."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import oddsmap
from oddsmap import EvidenceMap, InputError, Scan, build_map, open_log, scale
from oddsmap.plausibility.doubts import WatchedLog
from oddsmap.plausibility.sample import Sample
from oddsmap.scale import on_cluster
from oddsmap.scale.log_source import LogSource, look_at
from oddsmap.scale.worker_versions import versions_here
from oddsmap.scans.log import parts_of
from tests.scale.conftest import files_of

pytest.importorskip("rosbags")
pytest.importorskip("mcap")
troubled = pytest.importorskip("tests.recordings.troubled")

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::UserWarning")
READING: dict[str, Any] = {"frame": "map", "skip_bad": True}


def assert_same(
    path: Path, folder: Path, built: scale.Built, reading: dict[str, Any], **options: Any
) -> None:
    """The files of the map, and all that is said."""
    log: Any = open_log(path, **reading)
    grid = build_map(log, 0.1, **options)
    grid.save(folder / "one.zarr", force=True)
    assert files_of(Path(built.output)) == files_of(folder / "one.zarr")
    assert grid.report is not None
    assert (built.report.scans, built.report.beams) == (grid.report.scans, grid.report.beams)
    assert built.report.skipped == grid.report.skipped
    if len(parts_of(log)) == 1 or "sensor" in options:
        assert built.notes == {str(path): log.notes}


@pytest.mark.parametrize("spoilt", [-1, 90], ids=["", "a message cut off"])
@pytest.mark.parametrize("kind", troubled.FILES)
def test_bags_in_chunks(threads_of_dask: Any, kind: str, spoilt: int, tmp_path: Path) -> None:
    """Scans without poses, bad, twice or in another order, and sensors of other limits."""
    path = troubled.write_troubled(kind, tmp_path, spoilt=spoilt)
    reading = {**READING, "scans": ["/scan", "/rear"], "deskew": True}
    out, done = tmp_path / "map.zarr", list[int]()
    built = scale.build(
        path, 0.1, output=out, client=threads_of_dask, chunk_scans=15, reading=reading,
        progress=done.append,
    )  # fmt: skip
    assert built.chunk_count == 14
    assert_same(path, tmp_path, built, reading)
    assert built.report.skipped["scan.no_pose"] > 0
    assert done == sorted(done)


@pytest.mark.parametrize(
    ("options", "reading"),
    [
        ({"half_life_scans": 9.0}, {"scans": "/scan"}),
        ({"half_life": 0.7, "votes": "beam"}, {"scans": "/rear"}),
        ({"sensor": oddsmap.BeamSensor(range_max=4.5)}, {"scans": ["/scan", "/rear"]}),
        ({"votes": "beam", "path_lengths": True}, {"scans": "/scan", "clock_offset_s": 4.0}),
    ],
    ids=["half-life in scans", "half-life", "sensors in one", "clock offset"],
)
def test_options(
    threads_of_dask: Any, options: dict[str, Any], reading: dict[str, Any], tmp_path: Path
) -> None:
    path = troubled.write_troubled("mcap in chunks", tmp_path)
    reading = {**READING, **reading}
    built = scale.build(
        path, 0.1, output=tmp_path / "map.zarr", client=threads_of_dask, chunk_scans=25,
        reading=reading, **options,
    )  # fmt: skip
    assert built.chunk_count > 3
    assert_same(path, tmp_path, built, reading, **options)


def test_a_chunk_of_the_file_that_is_lost(threads_of_dask: Any, tmp_path: Path) -> None:
    path = troubled.write_troubled("mcap in chunks", tmp_path)
    content = bytearray(path.read_bytes())
    at = len(content) // 2
    content[at : at + 40] = bytes(40)
    path.write_bytes(content)
    reading = {**READING, "scans": "/scan"}
    built = scale.build(
        path, 0.1, output=tmp_path / "map.zarr", client=threads_of_dask, chunk_scans=25,
        reading=reading,
    )  # fmt: skip
    assert_same(path, tmp_path, built, reading)
    assert built.report.skipped["container.truncated"] > 3


def test_a_scan_that_makes_no_sense_ends_the_run(threads_of_dask: Any, tmp_path: Path) -> None:
    path = troubled.write_troubled("bag", tmp_path)
    reading: dict[str, Any] = {"frame": "map", "scans": "/scan"}
    with pytest.raises(InputError, match="a laser of 40 beams") as caught:
        build_map(open_log(path, **reading), 0.1)
    with pytest.raises(InputError) as on_workers:
        scale.build(
            path, 0.1, output=tmp_path / "map.zarr", client=threads_of_dask, chunk_scans=7,
            reading=reading,
        )  # fmt: skip
    assert str(on_workers.value) == str(caught.value)


def test_the_same_scans_are_looked_at(tmp_path: Path) -> None:
    """Also where some before them are skipped, which a worker does not know of."""
    path = troubled.write_troubled("mcap", tmp_path)
    log: Any = open_log(path, **READING, scans="/scan")
    alone, together = Sample(len(log)), Sample(len(log))
    assert len(list(WatchedLog(log, alone))) == 96
    for first in range(0, len(log), 10):
        part = Sample(len(log))
        list(part.watch(log.between(first, first + 10), first))
        together.include(part)
    stamps = [[glance.stamp_ns for glance in sample.glances] for sample in (alone, together)]
    assert stamps[0] == stamps[1]


def head(scans: int, beams: int, *, whole: bool = True) -> Any:
    return SimpleNamespace(scan_count=scans, first_beams=beams, by_number=True, read_to_open=whole)


@pytest.mark.parametrize(
    ("log", "in_all", "threads", "sizes"),
    [
        (head(590, 1440), 590, 8, [590]),  # of a laser: opening it takes longer
        (head(200, 60_000), 200, 2, [40] * 5),
        (head(80_000, 60_000), 80_000, 100, [200] * 400),
        (head(80_000, 60_000), 8_000_000, 100, [2000] * 40),  # one of a hundred
        (head(210, 60_000), 210_000, 8, [210]),
        (head(10, 60_000, whole=False), 10, 2, [2] * 5),
    ],
)
def test_sizes_of_chunks(log: Any, in_all: int, threads: int, sizes: list[int]) -> None:
    ranges = list(on_cluster._ranges(log, in_all, threads, None))
    assert ranges[0][0] == 0
    if len(sizes) == 1:
        assert ranges == [(0, None)]
    else:
        assert [(past or 0) - first for first, past in ranges] == sizes


def test_what_a_worker_says_of_a_bag(tmp_path: Path) -> None:
    path = troubled.write_troubled("bag", tmp_path)
    source = LogSource("a", str(path), {**READING, "scans": ["/scan", "/rear"]})
    found: Any = look_at(versions_here(), source)
    assert found.by_number
    assert found.read_to_open
    assert [part.first_beams for part in found.inner] == [40, 20]
    assert isinstance(found.first, Scan)
    assert (found.first.size, found.first.number) == (1, 6)
    assert found.skipped == {}


@pytest.mark.realdata
def test_a_recorded_drive(threads_of_dask: Any, data_folder: Path, tmp_path: Path) -> None:
    path = data_folder / "ros/ros1/tilt_laser.bag"
    built = scale.build(
        path, 0.1, output=tmp_path / "map.zarr", client=threads_of_dask, chunk_scans=50
    )
    assert built.chunk_count == 4
    assert_same(path, tmp_path, built, {})
    assert isinstance(oddsmap.load_map(tmp_path / "map.zarr"), EvidenceMap)
