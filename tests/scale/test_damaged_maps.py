# SPDX-License-Identifier: Apache-2.0
"""Saved maps of which a shard is missing, damaged or another map's: one line, whoever reads it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from oddsmap import EvidenceMap, InputError, load_map, simulate
from tests.cli.conftest import Run, folder_bytes
from tests.cli.conftest import run as run  # a fixture

SHARDS = ("hits/c/0/0", "passes/c/0/0")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two logs of an office, `a.log` and `b.log`, and maps of them, each of one shard."""
    import oddsmap

    folder = tmp_path_factory.mktemp("made")
    rng, plan, lidar = np.random.default_rng(1), simulate.office_plan(), simulate.Lidar2D()
    poses = simulate.office_drive(8)
    for name, part in (("a", poses[:4]), ("b", poses[4:])):
        simulate.write_carmen(folder / f"{name}.log", [lidar.scan(plan, p, rng) for p in part])
    a, b = (oddsmap.open_log(folder / f"{name}.log") for name in "ab")
    for name, grid in {
        "map": oddsmap.build_map(a, 0.05),
        "another log": oddsmap.build_map(b, 0.05),
        "another resolution": oddsmap.build_map(a, 0.1),
        "other votes": oddsmap.build_map(a, 0.05, votes="beam"),
        "another type": oddsmap.build_map(a, 0.05, sensor=oddsmap.BeamSensor(hit_width=0.1)),
    }.items():
        grid.save(folder / f"{name}.zarr")
        assert (folder / f"{name}.zarr" / SHARDS[0]).exists()
    both = oddsmap.build_map(a, 0.05)
    both.add(b)
    both.save(folder / "a later save.zarr")
    return folder


def missing(shard: Path) -> None:
    shard.unlink()


def cut(shard: Path) -> None:
    shard.write_bytes(shard.read_bytes()[:-100])


def garbled(shard: Path) -> None:
    shard.write_bytes(np.random.default_rng(0).bytes(5000))


def of(other: str) -> Callable[[Path], None]:
    def copied(shard: Path) -> None:
        name = shard.relative_to(shard.parents[3])
        shutil.copy(shard.parents[5] / "made" / f"{other}.zarr" / name, shard)

    return copied


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (missing, "hits/c/0/0 is missing or empty"),
        (cut, "the index of hits/c/0/0 does not match its checksum"),
        (garbled, "the index of hits/c/0/0 does not match its checksum"),
        *[
            (of(other), "hits/c/0/0 is not what was saved, but another map's or another save's")
            for other in ("another log", "another resolution", "other votes", "another type",
                          "a later save")
        ],
    ],
    ids=["missing", "cut", "garbled", "log", "resolution", "votes", "type", "save"],
)  # fmt: skip
def test_a_shard_that_is_not_the_maps(
    run: Run, made: Path, tmp_path: Path, damage: Callable[[Path], None], said: str
) -> None:
    (tmp_path / "made").symlink_to(made)
    folder = tmp_path / "own"
    path, out = folder / "map.zarr", folder / "out"
    shutil.copytree(made / "map.zarr", path)
    for shard in SHARDS:
        damage(path / shard)
    before = folder_bytes(folder)
    for words in (
        ("build", made / "b.log", "-o", path, "--append"),
        ("info", path),
        ("export", path, f"{out}.png", "--box", "0 0 9 9"),
        ("export", path, f"{out}.yaml"),
        ("crop", path, "--box", "0 0 9 9", "-o", f"{out}.zarr"),
        ("subtract", path, made / "a.log", "-o", f"{out}.zarr"),
        ("merge", path, made / "another log.zarr", "-o", f"{out}.zarr"),
    ):
        line = run(*words).line
        assert line.startswith(f"{path}: damaged, cannot be read as a map: {said}"), words
    saved = EvidenceMap.open(path)
    for ask in (saved.overview, lambda: saved.at([(3.0, 3.0)]), lambda: saved.crop([0, 0], [9, 9]),
                lambda: list(saved.parts()), lambda: load_map(path)):  # fmt: skip
        with pytest.raises(InputError) as error:
            ask()
        assert said in str(error.value)
    assert folder_bytes(folder) == before


def test_shards_that_are_left_alone_are_still_told(made: Path, tmp_path: Path) -> None:
    """What is added to elsewhere does not make a foreign shard the map's."""
    path = tmp_path / "map.zarr"
    shutil.copytree(made / "map.zarr", path)
    far = load_map(path).like()
    far.add_cells(np.array([[5000, 5000]]), np.array([65536]), np.array([0]))
    far.save(path, append=True)
    assert load_map(path).cell_count() == load_map(made / "map.zarr").cell_count() + 1
    for shard in SHARDS:
        shutil.copy(made / "another log.zarr" / shard, path / shard)
    far.save(path, append=True)  # reads the shards that it reaches, and no other
    with pytest.raises(InputError, match="hits/c/0/0 is not what was saved"):
        load_map(path)


@pytest.mark.parametrize(
    "value", [None, 5, {}, {"hits": 3}, {"hits": "zz"}, {"hits": "", "passes": ""}]
)
def test_checksums_of_another_kind(made: Path, tmp_path: Path, value: object) -> None:
    path = tmp_path / "map.zarr"
    shutil.copytree(made / "map.zarr", path)
    root = json.loads((path / "zarr.json").read_text())
    root["attributes"]["checksums"] = value
    (path / "zarr.json").write_text(json.dumps(root))
    with pytest.raises(InputError, match=r"map\.zarr: damaged") as error:
        load_map(path)
    assert "\n" not in str(error.value)
    root["attributes"]["digest"] = None  # on purpose
    (path / "zarr.json").write_text(json.dumps(root))
    assert load_map(path).cell_count() == load_map(made / "map.zarr").cell_count()


def test_maps_from_before_there_were_checksums(made: Path, tmp_path: Path) -> None:
    path = tmp_path / "map.zarr"
    shutil.copytree(made / "map.zarr", path)
    root = json.loads((path / "zarr.json").read_text())
    del root["attributes"]["checksums"]
    (path / "zarr.json").write_text(json.dumps(root))
    far = load_map(path).like()
    far.add_cells(np.array([[5000, 5000]]), np.array([65536]), np.array([0]))
    far.save(path, append=True)
    assert load_map(path).cell_count() == load_map(made / "map.zarr").cell_count() + 1


@pytest.mark.parametrize("kind", ["xarray", "OME"])
def test_zarr_of_other_programs(run: Run, made: Path, tmp_path: Path, kind: str) -> None:
    zarr = pytest.importorskip("zarr")
    path, out = tmp_path / "own" / "map.zarr", tmp_path / "own" / "out"
    path.parent.mkdir()
    about = {"ome": {"version": "0.5", "multiscales": [{"datasets": [{"path": "0"}]}]}}
    group = zarr.open_group(path, mode="w", attributes=about if kind == "OME" else {})
    group.create_array("hits" if kind == "xarray" else "0", shape=(64, 64), dtype="u1")
    before = folder_bytes(path.parent)
    for words in (
        ("build", made / "b.log", "-o", path, "--append"),
        ("build", made / "b.log", "--resolution", 1, "-o", path, "--force", "--memory", "1GB"),
        ("build", made / "b.log", "--resolution", 1, "-o", path, "--force", "--dask", "local"),
        ("info", path),
        ("export", path, f"{out}.png", "--box", "0 0 9 9"),
        ("crop", path, "--box", "0 0 9 9", "-o", f"{out}.zarr"),
        ("subtract", path, made / "a.log", "-o", f"{out}.zarr"),
    ):
        assert run(*words).line.startswith(f"{path}: "), words
    with pytest.raises(
        InputError, match=r"map\.zarr: (not a saved map|a Zarr folder, but not one)"
    ):
        EvidenceMap.open(path)
    assert folder_bytes(path.parent) == before
