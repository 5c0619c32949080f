# SPDX-License-Identifier: Apache-2.0
"""Maps as messages of ROS, read back by rosbags, by mcap and by OctoMap itself."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import oddsmap
from oddsmap import ConfigError, EvidenceMap, OutputError, ProbabilityMap, State, Thresholds
from oddsmap.map_files.grid_messages import cell_grid, occupancy_grid, plane_messages
from oddsmap.map_files.octomap_range import shift_of
from oddsmap.map_files.plane import ArrayPlane
from oddsmap.map_files.ros_bag import BagKind, save_bag
from oddsmap.map_files.ros_messages import MapHeader, RosMessages, TopicMessage
from oddsmap.map_files.ros_reader import RosMode
from oddsmap.map_files.space_messages import space_messages

pytest.importorskip("rosbags")
ONE = 65536
LIMITS = Thresholds()


def plane_map() -> EvidenceMap:
    """Cells on both sides of the origin, wider than one window, with votes in parts."""
    rng = np.random.default_rng(3)
    grid = EvidenceMap(0.25, votes="beam")
    index = np.unique(rng.integers([-2100, -20], [2100, 20], (4000, 2)), axis=0)
    grid.add_cells(index, *(rng.integers(0, 20, (2, len(index))) * (ONE // 2)))
    return grid


def space_map() -> EvidenceMap:
    rng = np.random.default_rng(4)
    grid = EvidenceMap(0.2, votes="beam", ndim=3)
    index = np.unique(rng.integers(-9, 9, (2000, 3)), axis=0)
    grid.add_cells(index, *(rng.integers(0, 9, (2, len(index))) * (ONE // 2)))
    return grid


def read(path: Path) -> dict[str, Any]:
    """Messages by topic, and the connection of each; by rosbags."""
    from rosbags.highlevel import AnyReader

    with AnyReader([path]) as reader:
        return {
            connection.topic: (reader.deserialize(raw, connection.msgtype), connection, stamp)
            for connection, stamp, raw in reader.messages()
        }


def save_plane(
    path: Path, kind: BagKind, mode: RosMode = "trinary", header: MapHeader | None = None
) -> None:
    plane = plane_map().log_odds().plane()
    save_bag(plane_messages(plane, mode=mode, thresholds=LIMITS), path, kind, header=header)


OUTPUTS: dict[BagKind, str] = {"mcap": "m.mcap", "ros2-bag": "m_bag", "bag": "m.bag"}


@pytest.mark.parametrize("kind", OUTPUTS)
def test_a_plane(tmp_path: Path, kind: BagKind) -> None:
    path = tmp_path / OUTPUTS[kind]
    save_plane(path, kind, header=MapHeader("odom", 12_500_000_000))
    view = plane_map().log_odds()
    grid, connection, stamp = read(path)["/map"]
    assert connection.msgtype == "nav_msgs/msg/OccupancyGrid"
    assert stamp == 12_500_000_000
    assert (grid.header.stamp.sec, grid.header.stamp.nanosec) == (12, 500_000_000)
    assert grid.header.frame_id == "odom"
    lo, hi = view.bounds() or pytest.fail("no cells")
    assert (grid.info.width, grid.info.height) == tuple(hi - lo)
    assert grid.info.resolution == 0.25
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == tuple(lo * 0.25)
    assert grid.info.origin.orientation.w == 1.0
    state = view.state()
    expected = np.where(state == State.UNDECIDED, -1, state)
    assert np.array_equal(grid.data.reshape(expected.shape), expected)
    assert {-1, 0, 100} == set(grid.data.tolist())
    if kind == "bag":
        assert connection.ext.latching == 1
    else:
        assert connection.ext.offered_qos_profiles[0].durability.name == "TRANSIENT_LOCAL"


def cells_of(grid: Any) -> npt.NDArray[np.void]:
    types = {1: "u1", 7: "<f4"}
    kind = np.dtype(
        {
            "names": [field.name for field in grid.fields],
            "formats": [types[field.type] for field in grid.fields],
            "offsets": [field.offset for field in grid.fields],
            "itemsize": grid.cell_stride,
        }
    )
    assert grid.row_stride == grid.column_count * grid.cell_stride
    cells: npt.NDArray[np.void] = grid.data.view(kind).reshape(-1, grid.column_count)
    return cells


def test_the_cells_of_a_plane(tmp_path: Path) -> None:
    save_plane(tmp_path / "m.mcap", "mcap")
    grid, connection, _ = read(tmp_path / "m.mcap")["/map_cells"]
    assert connection.msgtype == "foxglove_msgs/msg/Grid"
    view = plane_map().log_odds()
    cells, seen = cells_of(grid), view.observed()
    assert (grid.cell_size.x, grid.cell_size.y, grid.frame_id) == (0.25, 0.25, "map")
    assert np.isnan(cells["probability"][~seen]).all()
    assert np.array_equal(cells["probability"][seen], view.probability()[seen].astype("f4"))
    lo, hi = view.bounds() or pytest.fail("no cells")
    assert (grid.pose.position.x, grid.pose.position.y) == tuple(lo * 0.25)
    hits, passes = view.evidence.region(lo, hi)
    assert np.array_equal(cells["hits"], hits)
    assert np.array_equal(cells["passes"], passes)
    assert (cells["alpha"] == np.where(seen, 255, 0)).all()
    grey = np.rint(255 * (1 - view.probability()[seen]))
    for colour in ("red", "green", "blue"):
        assert np.array_equal(cells[colour][seen], grey)


def test_mcap_as_other_programs_see_it(tmp_path: Path) -> None:
    # `ros2 bag play` refuses a file in which topics differ in their encoding: all are CDR.
    reader = pytest.importorskip("mcap.reader")
    save_plane(tmp_path / "m.mcap", "mcap")
    with (tmp_path / "m.mcap").open("rb") as file:
        found = reader.make_reader(file, validate_crcs=True)
        assert found.get_header().profile == "ros2"
        messages = list(found.iter_messages())
    assert [channel.topic for _, channel, _ in messages] == ["/map", "/map_cells"]
    for schema, channel, message in messages:
        assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
        assert message.log_time == message.publish_time == 0
        assert "durability: 1" in channel.metadata["offered_qos_profiles"]
    schema, _, message = messages[0]
    assert schema.data.decode().startswith("std_msgs/Header header\n")
    # CDR by hand: 4 bytes of the encapsulation, stamp, frame, load time, resolution, sizes, pose.
    assert message.data[:4] == bytes([0, 1, 0, 0])
    lo, hi = plane_map().bounds() or pytest.fail("no cells")
    count = math.prod(int(n) for n in hi - lo)
    assert int.from_bytes(message.data[-count - 4 : -count], "little") == count


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
def test_values(tmp_path: Path, mode: RosMode) -> None:
    probability = np.array([[0.0, 0.1, 0.196, 0.2, 0.5, 0.6499, 0.65, 0.996, 1.0, 0.3]])
    seen = np.array([[True] * 9 + [False]])
    grid = ProbabilityMap(probability, seen, 0.5, (1.0, -2.0), yaw=math.pi / 2)
    messages = RosMessages(2, MapHeader())
    made = occupancy_grid(ArrayPlane(grid), messages, mode=mode, thresholds=LIMITS).message
    expected = {
        "trinary": [0, 0, 0, -1, -1, -1, 100, 100, 100, -1],
        "scale": [0, 0, 0, 20, 50, 65, 100, 100, 100, -1],
        "raw": [0, 10, 20, 20, 50, 65, 65, 100, 100, -1],
    }
    assert made.data.tolist() == expected[mode]
    turn = made.info.origin.orientation
    assert (turn.z, turn.w) == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)))
    assert (turn.x, turn.y) == (0.0, 0.0)
    assert (made.info.origin.position.x, made.info.origin.position.y) == (1.0, -2.0)
    if mode == "trinary":
        # Fields of counts are left out where there are none.
        cells = cells_of(cell_grid(ArrayPlane(grid), messages).message)
        assert cells.dtype.names == ("probability", "red", "green", "blue", "alpha")


@pytest.mark.parametrize("mode", ["trinary", "scale"])
def test_what_map_server_publishes_is_the_same(tmp_path: Path, mode: RosMode) -> None:
    from oddsmap.map_files.ros_writer import save_ros
    from tests.naive.nav2_reader import read_map

    view = plane_map().crop([-100, -20], [100, 20]).log_odds()
    save_ros(view.to_probability_map(), tmp_path / "m.yaml", mode=mode)
    made = occupancy_grid(view.plane(), RosMessages(2, MapHeader()), mode=mode, thresholds=LIMITS)
    published = np.asarray(read_map(tmp_path / "m.yaml")["data"]).ravel()
    between = (published > 0) & (published < 100)
    assert np.array_equal(made.message.data[~between], published[~between])
    assert np.abs(made.message.data[between] - published[between]).max(initial=0) <= 1


@pytest.mark.parametrize("kind", ["mcap", "bag"])
def test_space(tmp_path: Path, kind: BagKind) -> None:
    octomap = pytest.importorskip("octomap")
    grid = space_map()
    view = grid.log_odds()

    shift = shift_of((1.0, 0.0, 0.0), 0.2)
    leaves = view.leaves(shift)
    make = space_messages(leaves, view, thresholds=LIMITS, shift=shift)
    save_bag(make, tmp_path / OUTPUTS[kind], kind)
    found = read(tmp_path / OUTPUTS[kind])
    for topic, suffix in (("/octomap_binary", ".bt"), ("/octomap_full", ".ot")):
        message = found[topic][0]
        assert (message.id, message.resolution) == ("OcTree", 0.2)
        assert message.binary == (suffix == ".bt")
        view.save_octomap(tmp_path / f"a{suffix}", shift=(1.0, 0.0, 0.0))
        content = (tmp_path / f"a{suffix}").read_bytes()
        data = message.data.tobytes()
        assert content.split(b"data\n", 1)[1] == data
    # What octomap_msgs does: the data alone, read by OctoMap; here with its own header before it.
    tree = octomap.OcTree(0.2)
    head = b"# Octomap OcTree binary file\nid OcTree\nsize %d\nres 0.2\ndata\n"
    message = found["/octomap_binary"][0]
    size = int(next(w for w in _header_of(tmp_path / "a.bt") if w.startswith(b"size")).split()[1])
    assert tree.readBinary(head % size + message.data.tobytes())
    assert tree.size() == size
    cloud = found["/octomap_point_cloud_centers"][0]
    names = [field.name for field in cloud.fields]
    assert names == ["x", "y", "z", "size", "probability", "hits", "passes"]
    points = cloud.data.view(np.dtype([(name, "<f4") for name in names]))
    index, p = view.cells()
    occupied = p >= LIMITS.occupied
    assert (cloud.height, cloud.width, len(points)) == (1, occupied.sum(), occupied.sum())
    centres = (index[occupied] + 0.5) * 0.2 - [1.0, 0.0, 0.0]
    for axis, name in enumerate("xyz"):
        assert points[name] == pytest.approx(centres[:, axis], abs=1e-6)
    _, hits, passes = grid.cells()
    assert np.array_equal(points["hits"], (hits[occupied] / ONE).astype("f4"))
    assert np.array_equal(points["passes"], (passes[occupied] / ONE).astype("f4"))
    assert np.array_equal(points["probability"], p[occupied].astype("f4"))


def _header_of(path: Path) -> list[bytes]:
    return path.read_bytes().split(b"data\n", 1)[0].splitlines()


def test_outputs_replace_only_what_is_ours(tmp_path: Path) -> None:
    folder = tmp_path / "m_bag"
    view = plane_map().log_odds().plane()

    def save(force: bool) -> None:
        save_bag(
            lambda messages: [occupancy_grid(view, messages, mode="raw", thresholds=LIMITS)],
            folder, "ros2-bag", force=force,
        )  # fmt: skip

    save(force=False)
    assert {entry.name for entry in folder.iterdir()} == {"metadata.yaml", "m_bag.db3"}
    with pytest.raises(OutputError, match="exists already"):
        save(force=False)
    save(force=True)
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match="no bag that oddsmap made"):
        save(force=True)
    (folder / "notes.txt").unlink()
    said = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(said.replace("oddsmap", "someone"))
    with pytest.raises(OutputError, match="no bag that oddsmap made"):
        save(force=True)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["m_bag"]


def test_a_failure_leaves_nothing(tmp_path: Path) -> None:
    def make(messages: RosMessages) -> Iterator[TopicMessage]:
        view = plane_map().log_odds().plane()
        yield occupancy_grid(view, messages, mode="raw", thresholds=LIMITS)
        raise OutputError("no more")

    for kind, name in OUTPUTS.items():
        with pytest.raises(OutputError, match="no more"):
            save_bag(make, tmp_path / name, kind)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (MapHeader(""), "name of a frame"),
        (MapHeader("my map"), "name of a frame"),
        (MapHeader("/map"), "no leading slash since ROS 2, say map"),
        (MapHeader("map", -1), "a time from 0"),
        (MapHeader("map", 2**62), "a time from 0"),
    ],
)
def test_headers(tmp_path: Path, header: MapHeader, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        RosMessages(2, header)


def test_a_message_has_room_for_so_many_cells(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("oddsmap.map_files.grid_messages.memory_limit", lambda: 4000)
    view = plane_map().log_odds().plane()
    with pytest.raises(oddsmap.InputError, match="a message holds 1000 of them here"):
        occupancy_grid(view, RosMessages(2, MapHeader()), mode="raw", thresholds=LIMITS)


def test_from_python(tmp_path: Path) -> None:
    view = plane_map().log_odds()
    for name in OUTPUTS.values():
        view.save_rosbag(tmp_path / name, mode="raw", frame="odom", stamp_ns=5_000_000_000)
        found = read(tmp_path / name)["/map"][0]
        assert (found.header.frame_id, found.header.stamp.sec) == ("odom", 5)
        percent = np.where(view.observed(), np.rint(100 * view.probability()), -1)
        assert np.array_equal(found.data, percent.ravel())
    with pytest.raises(ConfigError, match=r"named \.mcap, \.bag"):
        view.save_rosbag(tmp_path / "m.db3")
    space = space_map().log_odds()
    space.save_rosbag(tmp_path / "s.mcap", shift=(0.4, 0.0, 0.0))
    centres = read(tmp_path / "s.mcap")["/octomap_point_cloud_centers"][0]
    assert centres.width == np.count_nonzero(space.cells()[1] >= 0.65)


def test_a_message_has_room_for_so_many_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for most, topic in ((100, "/octomap_binary"), (4000, "/octomap_full")):
        monkeypatch.setattr("oddsmap.map_files.ros_messages._MOST_BYTES", most)
        with pytest.raises(oddsmap.InputError, match=f"{topic}: .* GB in one message"):
            space_map().log_odds().save_rosbag(tmp_path / "m.mcap")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform == "win32", reason="limits of files are of Unix")
@pytest.mark.parametrize("kind", OUTPUTS)
def test_a_full_disk_is_said(tmp_path: Path, kind: BagKind) -> None:
    import resource
    import signal

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
        with pytest.raises(OutputError, match="cannot be written: "):
            save_plane(tmp_path / OUTPUTS[kind], kind)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert list(tmp_path.iterdir()) == []
