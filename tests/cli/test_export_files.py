# SPDX-License-Identifier: Apache-2.0
"""`oddsmap export` to messages of ROS, GeoTIFF and points, and of ROS maps."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import oddsmap
from tests.cli.conftest import Run


def messages(path: Path) -> dict[str, Any]:
    highlevel = pytest.importorskip("rosbags.highlevel")
    with highlevel.AnyReader([path]) as reader:
        return {
            connection.topic: reader.deserialize(raw, connection.msgtype)
            for connection, _, raw in reader.messages()
        }


@pytest.mark.parametrize(
    ("name", "words", "topics"),
    [
        ("m.mcap", [], ["/map", "/map_cells"]),
        ("m.bag", [], ["/map"]),
        ("m", ["--format", "ros2-bag"], ["/map", "/map_cells"]),
    ],
)
def test_messages_of_a_plane(
    run: Run, maps: Path, tmp_path: Path, name: str, words: list[str], topics: list[str]
) -> None:
    out = tmp_path / name
    done = run("export", maps / "hall.zarr", out, *words, "--mode", "raw", "--frame", "odom",
               "--stamp", 3.25)  # fmt: skip
    assert done.status == 0, done.err
    assert f"wrote    {out}" in done.out
    found = messages(out)
    assert list(found) == topics
    view = oddsmap.load_map(maps / "hall.zarr").log_odds()
    percent = np.where(view.observed(), np.rint(100 * view.probability()), -1)
    assert np.array_equal(found["/map"].data.reshape(percent.shape), percent)
    assert found["/map"].header.frame_id == "odom"
    assert found["/map"].header.stamp.nanosec == 250_000_000
    assert "exists already" in run("export", maps / "hall.zarr", out, *words).line
    assert run("export", maps / "hall.zarr", out, *words, "--force").status == 0
    assert messages(out)["/map"].header.frame_id == "map"


def test_messages_of_space(run: Run, maps: Path, tmp_path: Path) -> None:
    for source in ("space.zarr", "before.ot"):
        assert run("export", maps / source, tmp_path / "m.mcap", "--force").status == 0
        found = messages(tmp_path / "m.mcap")
        topics = ["/octomap_binary", "/octomap_full", "/octomap_point_cloud_centers"]
        assert list(found) == topics
        fields = [field.name for field in found[topics[2]].fields]
        assert ("hits" in fields) == (source == "space.zarr")
    done = run("export", maps / "space.zarr", tmp_path / "s.mcap", "--shift", 10, 0, 0)
    assert "shifted: add 10 0 0 [m]" in done.out
    assert run("export", maps / "space.zarr", tmp_path / "z.mcap", "--z-min", 0).status == 0
    assert list(messages(tmp_path / "z.mcap")) == ["/map", "/map_cells"]


def test_cells_for_foxglove(run: Run, maps: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.mcap"
    for source, words, topic in (
        ("hall.zarr", [], "/map_cells"),
        ("space.zarr", [], "/map_voxels"),
        ("before.ot", ["--occupied", 0.8], "/map_voxels"),
        ("space.zarr", ["--z-min", 0, "--free", 0.1], "/map_cells"),
    ):
        words = ["--format", "foxglove", "--frame", "odom", "--force", *words]
        done = run("export", maps / source, out, *words)
        assert done.status == 0, done.err
        found = messages(out)
        assert list(found) == [topic]
        assert found[topic].frame_id == "odom"
    for name, rest, message in (
        ("m.bag", [], "name it .mcap"),
        ("b.mcap", ["--mode", "raw"], "--mode shapes messages of ROS"),
        ("b.mcap", ["--free", 0.1], "decide nothing in a Grid"),
    ):
        words = ["--format", "foxglove", *rest]
        assert message in run("export", maps / "hall.zarr", tmp_path / name, *words).line


def test_time_of_fading_maps(run: Run, tmp_path: Path) -> None:
    grid = oddsmap.EvidenceMap(0.5, half_life=5.0, t_ref_ns=7_000_000_000)
    grid.add_cells(np.array([[0, 0]]), np.array([65536]), np.array([0]))
    grid.save(tmp_path / "m.zarr")
    assert run("export", tmp_path / "m.zarr", tmp_path / "m.mcap").status == 0
    assert messages(tmp_path / "m.mcap")["/map"].header.stamp.sec == 7


def test_geotiff(run: Run, maps: Path, tmp_path: Path) -> None:
    rasterio = pytest.importorskip("rasterio")
    done = run("export", maps / "hall.zarr", tmp_path / "m.tif", "--prior", 0.3)
    assert "--crs EPSG:32632 (or what your coordinates are in)" in done.out
    view = oddsmap.load_map(maps / "hall.zarr").log_odds(prior=0.3)
    with rasterio.open(tmp_path / "m.tif") as file:
        p = file.read(1)[::-1]
        assert np.array_equal(p[view.observed()], view.probability()[view.observed()].astype("f4"))
    words = ("--crs", "EPSG:32632", "--z-min", 0, "--ground", "none")
    done = run("export", maps / "space.zarr", tmp_path / "s.tiff", *words)
    assert "where on the Earth" not in done.out
    with rasterio.open(tmp_path / "s.tiff") as file:
        assert (file.count, file.crs.to_epsg()) == (1, 32632)


def test_points(run: Run, maps: Path, tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy")
    for source in ("space.zarr", "before.bt"):
        for name in ("m.las", "m.laz"):
            assert run("export", maps / source, tmp_path / name, "--force").status == 0
        one, other = (laspy.read(tmp_path / name) for name in ("m.las", "m.laz"))
        assert np.array_equal(one.xyz, other.xyz)
        assert len(one) > 0


def test_rerun(run: Run, maps: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    from tests.map_files.test_rerun_file import read

    def written(source: Path, *words: object) -> dict[str, Any]:
        done = run("export", source, tmp_path / "m.rrd", *words, "--force")
        assert done.status == 0, done.err
        return read(tmp_path / "m.rrd")["/map"]

    view = oddsmap.load_map(maps / "hall.zarr").log_odds(prior=0.3)
    percent = np.where(view.observed(), np.rint(100 * view.probability()), 255)
    grid = written(maps / "hall.zarr", "--prior", 0.3)
    assert np.array_equal(grid["GridMap:data"][0], percent[::-1].ravel())
    assert "GridMap:data" in written(maps / "space.zarr", "--z-min", 0, "--free", 0.3)
    p = oddsmap.load_map(maps / "space.zarr").log_odds().cells()[1]
    voxels = written(maps / "space.zarr", "--occupied", 0.8)
    assert np.array_equal(voxels["VoxelGridMap:values"], p[p >= 0.8].astype("f4"))
    assert "VoxelGridMap:values" in written(maps / "before.ot")
    line = run("export", maps / "hall.zarr", tmp_path / "a.rrd", "--free", 0.1).line
    assert "decide which voxels an .rrd has" in line


@pytest.fixture
def ros_map(tmp_path: Path) -> Path:
    """A ROS map that is turned, with its corner inside a cell."""
    (tmp_path / "old.yaml").write_text(
        "image: old.pgm\nresolution: 0.5\norigin: [0.7, -3.0, 0.1]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    greys = np.array([[254, 205, 0], [0, 254, 205]], np.uint8)
    (tmp_path / "old.pgm").write_bytes(b"P5\n3 2\n255\n" + greys.tobytes())
    return tmp_path / "old.yaml"


def test_export_of_a_ros_map(run: Run, ros_map: Path, tmp_path: Path) -> None:
    assert run("export", ros_map, tmp_path / "m.npz").status == 0
    with np.load(tmp_path / "m.npz") as arrays:
        assert arrays["index"].tolist() == [[0, 0], [1, 0], [0, 1], [2, 1]]
        assert arrays["origin"].tolist() == [0.7, -3.0, 0.1]
        assert not arrays["hits"].any()
        assert arrays["probability"].tolist() == [
            1.0,
            np.float32(1 / 255),
            np.float32(1 / 255),
            1.0,
        ]
    done = run("export", ros_map, tmp_path / "m.mcap")
    assert "205 are read as unknown" in done.err
    found = messages(tmp_path / "m.mcap")["/map"]
    assert found.data.tolist() == [100, 0, -1, 0, -1, 100]
    assert found.info.origin.orientation.z == pytest.approx(np.sin(0.05))
    for name in ("m.png", "m.bag", "new.yaml"):
        assert run("export", ros_map, tmp_path / name).status == 0
    again = oddsmap.load_ros(tmp_path / "new.yaml")
    assert np.array_equal(again.state(), oddsmap.load_ros(ros_map).state())
    assert (again.origin, again.yaw) == ((0.7, -3.0), 0.1)
    for words, message in (
        ((tmp_path / "a.bt",), "a ROS map is 2D"),
        ((tmp_path / "a.laz",), "a ROS map is 2D"),
        ((tmp_path / "a.png", "--z-min", 0), "need a 3D map"),
        ((tmp_path / "a.png", "--prior", 0.3), "a ROS map has no counts"),
    ):
        assert message in run("export", ros_map, *words).err
    line = run("export", ros_map.with_suffix(".pgm"), tmp_path / "a.png").line
    assert line.endswith(f"an image says no resolution and no origin; give {ros_map}")


def test_info_of_a_ros_map(run: Run, ros_map: Path) -> None:
    facts = run("info", ros_map, "--json").json
    assert facts["format"] == "ROS map"
    assert facts["mode"] == "trinary"
    assert (facts["columns"], facts["rows"], facts["resolution"]) == (3, 2, 0.5)
    assert facts["size [m]"] == {"x": 1.5, "y": 1.0}
    assert facts["origin [m]"] == {"x": 0.7, "y": -3.0}
    assert facts["unknown"] == {"cells": 2, "percent": 33.33}
    assert facts["free"] == facts["occupied"] == {"cells": 2, "percent": 33.33}
    assert "2 pixels of grey 205" in facts["notes"][0]
    assert "occupied     cells 2" in run("info", ros_map).out
    assert "give the .yaml" not in run("info", ros_map).out
    assert f"give {ros_map}" in run("info", ros_map.with_suffix(".pgm")).line


@pytest.mark.realdata
def test_maps_of_others(run: Run, data_folder: Path, tmp_path: Path) -> None:
    for name, cells in (("maps/depot", 604 * 307), ("ros/turtlebot3_world", 384 * 384)):
        facts = run("info", data_folder / f"{name}.yaml", "--json").json
        kinds = ("unknown", "free", "undecided", "occupied")
        assert sum(facts[kind]["cells"] for kind in kinds) == cells
        out = tmp_path / "m.mcap"
        assert run("export", data_folder / f"{name}.yaml", out, "--force").status == 0
        data = messages(out)["/map"].data
        counts = [facts[kind]["cells"] for kind in ("unknown", "free", "occupied")]
        assert [np.count_nonzero(data == value) for value in (-1, 0, 100)] == counts


@pytest.mark.parametrize(
    ("source", "words", "message"),
    [
        ("hall", ["m.tif", "--mode", "raw"], "--mode says how a ROS map is written, not m.tif"),
        ("hall", ["m.png", "--frame", "map"], "--frame names the frame of a map in .mcap"),
        ("hall", ["m.npz", "--stamp", "1"], "--stamp is the time of a map in .mcap"),
        ("hall", ["m.mcap", "--crs", "EPSG:32632"], "--crs says where a .tif, .las or .laz is"),
        ("space", ["m.ply", "--shift", "1", "0", "0"], "--shift moves an OctoMap or an .rrd"),
        ("hall", ["m.mcap", "--shift", "1", "0", "0"], "moves an OctoMap, and this map is 2D"),
        ("space", ["m.mcap", "--mode", "raw"], "this map is 3D: leave it out"),
        ("space", ["m.mcap", "--shift", "1", "0", "0", "--z-min", "0"], "make a 2D map"),
        ("space", ["m.bt", "--shift", "0.05", "0", "0"], "not a whole number of cells of 0.1 m"),
        ("hall", ["m.mcap", "--frame", "/map"], "no leading slash"),
        ("hall", ["m.mcap", "--stamp", "-1"], "a time in seconds since 1970, got -1"),
        ("hall", ["m.mcap", "--stamp", "nan"], "a time in seconds since 1970, got nan"),
        ("hall", ["m.mcap", "--format", "ros2-bag"], "leave one of them out"),
        ("hall", ["m.mcap", "--posterior", "reflection"], "is written as .png, .pdf, .svg"),
        ("hall", ["m", "--format", "ros2-bag", "--posterior", "decay"], "--format belongs to"),
        ("hall", ["m.tif", "--crs", "EPSG:4326"], "not of a plane in metres"),
        ("hall", ["m.las"], "needs a 3D map"),
        ("space", ["m.tif"], "say which heights make the 2D map"),
        ("hall", ["m.mcp"], 'did you mean ".mcap"'),
    ],
)  # fmt: skip
def test_what_does_not_fit(
    run: Run, maps: Path, tmp_path: Path, source: str, words: list[str], message: str
) -> None:
    name, *rest = words
    assert message in run("export", maps / f"{source}.zarr", tmp_path / name, *rest).line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("package", "name", "extra"),
    [
        ("rosbags", "m.mcap", "ros"),
        ("rasterio", "m.tif", "geo"),
        ("laspy", "m.laz", "survey"),
        ("rerun", "m.rrd", "rerun"),
    ],
)
def test_packages_that_are_missing(
    run: Run, maps: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, package: str,
    name: str, extra: str,
) -> None:  # fmt: skip
    for module in list(sys.modules):
        if module.split(".")[0] == package:
            monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, package, None)
    source = "space" if name == "m.laz" else "hall"
    line = run("export", maps / f"{source}.zarr", tmp_path / name).line
    assert f'pip install "oddsmap[{extra}]"' in line


def test_planes_that_are_too_wide_are_refused_at_once(run: Run, tmp_path: Path) -> None:
    far = oddsmap.EvidenceMap(0.1)
    far.add_cells(
        np.array([[0, 0], [1 << 20, 1 << 20]]), np.array([65536, 0]), np.array([0, 65536])
    )
    far.save(tmp_path / "far.zarr")
    for name in ("m.mcap", "m.tif"):
        line = run("export", tmp_path / "far.zarr", tmp_path / name).line
        assert "1048577 x 1048577 cells" in line
        assert "coarser map, or crop it" in line
