"""OctoMap files: against a node-by-node oracle, against OctoMap itself, and damaged."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import oddsmap
from oddsmap import InputError, VoxelMap
from oddsmap.kernels import octree
from oddsmap.map_files import octomap_nodes
from oddsmap.map_files.octomap_reader import is_octomap
from oddsmap.map_files.octomap_writer import OCTOMAP_CLAMP, save_octomap
from oddsmap.maps.voxel_map import load_octomap
from tests.naive import octomap_tree as naive

ONE = 65536
Leaves = dict[naive.Leaf, float]

# Few values, so that blocks merge; among them 0, OctoMap's own limit, and one that float32 rounds.
VALUES = st.sampled_from([-2.0, -0.4, 0.0, 0.1, 0.85])


@st.composite
def trees(draw: st.DrawFn) -> Leaves:
    """Leaves of all sizes; siblings are often equal, and on both sides of the origin."""
    found: Leaves = {}

    def fill(cell: naive.Cell, side: int, value: float) -> None:
        kind = draw(st.sampled_from(["leaf", "leaf", "none", "split"]))
        if kind == "none":
            return
        if kind == "leaf" or side == 1:
            found[cell, side] = value
            return
        same = draw(st.booleans())
        for x in (0, 1):
            for y in (0, 1):
                for z in (0, 1):
                    half = side // 2
                    place = (cell[0] + x * half, cell[1] + y * half, cell[2] + z * half)
                    if same:
                        found[place, half] = value
                    else:
                        fill(place, half, draw(VALUES))

    places = st.tuples(*[st.integers(-8, 7) | st.sampled_from([-8192, 8191])] * 3)
    for x, y, z in draw(st.sets(places, max_size=5)):
        fill((4 * x, 4 * y, 4 * z), 4, draw(VALUES))
    return found


def voxels_of(leaves: Leaves, resolution: float = 0.1) -> VoxelMap:
    return VoxelMap(
        np.array([cell for cell, _ in leaves], np.int64).reshape(-1, 3),
        np.array(list(leaves.values())),
        resolution,
        np.array([int(math.log2(side)) for _, side in leaves], np.uint8),
    )


def leaves_of(voxels: VoxelMap) -> Leaves:
    cells = (tuple(map(int, cell)) for cell in voxels.index)
    found = zip(cells, map(int, voxels.side), map(float, voxels.log_odds), strict=True)
    return {(cell, side): value for cell, side, value in found}  # type: ignore[misc]


def written(voxels: VoxelMap, suffix: str, **options: Any) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return save_octomap(voxels, Path(folder) / f"map{suffix}", **options).read_bytes()


def read(content: bytes) -> VoxelMap:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.file"
        path.write_bytes(content)
        return load_octomap(path)


def float32(value: float) -> float:
    return float(np.float32(value))


@given(trees())
def test_ot_is_what_the_oracle_writes(leaves: Leaves) -> None:
    tree = naive.build({leaf: float32(value) for leaf, value in leaves.items()})
    content = written(voxels_of(leaves), ".ot")
    assert content == naive.header(tree, 0.1, "") + naive.full(tree)
    back = read(content)
    assert leaves_of(back) == naive.leaves(tree)
    assert back.resolution == 0.1
    assert written(back, ".ot") == content


@given(trees())
def test_bt_is_what_the_oracle_writes(leaves: Leaves) -> None:
    # By OctoMap's own rule: p >= 0.5 is occupied; all five values agree with the thresholds there.
    tree = naive.build({leaf: 1.0 if value >= 0 else -1.0 for leaf, value in leaves.items()})
    content = written(voxels_of(leaves), ".bt")
    assert content == naive.header(tree, 0.1, "binary ") + naive.binary(tree)
    back = read(content)
    occupied = {leaf: value >= 0 for leaf, value in naive.leaves(tree).items()}
    assert {leaf: value >= 0 for leaf, value in leaves_of(back).items()} == occupied
    low, high = (float32(math.log(p / (1 - p))) for p in OCTOMAP_CLAMP)
    assert set(leaves_of(back).values()) <= {low, high}
    assert written(back, ".bt") == content


@given(trees(), st.integers(0, 10**9), st.integers(0, 255), st.booleans())
def test_damage_is_one_line(leaves: Leaves, where: int, byte: int, binary: bool) -> None:
    content = bytearray(written(voxels_of(leaves), ".bt" if binary else ".ot"))
    for damaged in (content[: where % len(content)], content[:]):
        if len(damaged) == len(content):
            damaged[where % len(damaged)] = byte
        message = complaint(bytes(damaged))
        assert "\n" not in message
        assert message or len(damaged) == len(content), "a file that is cut off was read"


def complaint(content: bytes) -> str:
    """What is said of a damaged file; empty where it can be read all the same."""
    try:
        read(content)
    except InputError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("suffix", [".bt", ".ot"])
def test_a_whole_world_of_one_value(suffix: str, tmp_path: Path) -> None:
    # Leaves of level 15 stay: the root is never merged.
    half = naive.HALF
    corners = np.array([[x, y, z] for z in (-half, 0) for y in (-half, 0) for x in (-half, 0)])
    world = VoxelMap(corners, np.full(8, -2.0), 0.1, np.full(8, 15, np.uint8))
    back = read(written(world, suffix))
    assert back.leaf_count == 8
    assert back.cell_count == 65536**3
    assert set(back.level) == {15}
    with pytest.raises(oddsmap.MapTooLargeError, match=r"281474976710656 cells.*1\.8e\+07 GB"):
        back.cells()
    index, _ = back.cells(([-1, -1, -1], [1, 2, 3]))
    assert len(index) == 2 * 3 * 4


def test_the_root_alone_is_the_whole_world() -> None:
    content = naive.header(naive.Node(), 0.1, "") + b"\x00\x00\x80\xbf\x00"
    world = read(content)
    assert world.cell_count == 65536**3
    assert (world.log_odds == -1.0).all()
    bounds = world.bounds()
    assert bounds is not None
    assert [end.tolist() for end in bounds] == [[-32768] * 3, [32768] * 3]


@pytest.mark.parametrize("suffix", [".bt", ".ot"])
def test_empty(suffix: str) -> None:
    empty = VoxelMap(np.empty((0, 3), np.int64), np.empty(0), 0.05)
    back = read(written(empty, suffix))
    assert back.leaf_count == 0
    assert back.bounds() is None
    assert back.state_at([[0, 0, 0]]).tolist() == [oddsmap.State.UNKNOWN]


def test_undecided_cells_of_a_bt() -> None:
    p = np.array([0.1, 0.3, 0.499, 0.5, 0.6, 0.9])
    index = np.array([[i, 0, 0] for i in (0, 2, 4, 6, 8, 10)])
    voxels = VoxelMap(index, np.log(p / (1 - p)), 0.1)
    default = read(written(voxels, ".bt")).log_odds > 0
    assert default.tolist() == [False, False, False, True, True, True]
    bold = oddsmap.Thresholds(free=0.05, occupied=0.3)
    assert (read(written(voxels, ".bt", thresholds=bold)).log_odds > 0).tolist() == [
        False,
        *[True] * 5,
    ]
    shy = oddsmap.Thresholds(free=0.7, occupied=0.8)
    assert (read(written(voxels, ".bt", thresholds=shy)).log_odds > 0).tolist() == [
        *[False] * 5,
        True,
    ]


def test_clamp_and_digits(tmp_path: Path) -> None:
    voxels = VoxelMap(
        np.array([[0, 0, 0], [5, 0, 0], [9, 0, 0]]), np.array([-9.0, 0.3, 12.5]), 1 / 3
    )
    assert read(written(voxels, ".ot")).log_odds.tolist() == [-9.0, float32(0.3), 12.5]
    assert read(written(voxels, ".ot")).resolution == 1 / 3
    clamped = read(written(voxels, ".ot", clamp=OCTOMAP_CLAMP)).log_odds
    low, high = (float32(math.log(p / (1 - p))) for p in OCTOMAP_CLAMP)
    assert clamped.tolist() == [low, float32(0.3), high]
    with pytest.raises(oddsmap.ConfigError, match="clamp needs"):
        written(voxels, ".ot", clamp=(0.6, 0.9))
    with pytest.raises(oddsmap.ConfigError, match=r"named \.bt"):
        save_octomap(voxels, tmp_path / "map.oct")
    assert list(tmp_path.iterdir()) == []


def test_bounds_name_the_crop(tmp_path: Path) -> None:
    edge = VoxelMap(np.array([[-32768] * 3, [32767] * 3]), np.array([1.0, -1.0]), 0.05)
    assert leaves_of(read(written(edge, ".ot"))) == leaves_of(edge)
    for index, message in (
        ([32768, 0, 0], r"crop to x < 1638\.4 m \(.*got 32768\), or --shift 1000 0 0 moves"),
        ([0, -32769, 0], r"crop to y >= -1638\.4 m \(.*got -32769\), or --shift 0 -1000 0 "),
        ([40000, 0, -40000], r"crop to x < .* and z >= "),
    ):
        wide = VoxelMap(np.array([index, [0, 0, 0]]), np.array([1.0, 1.0]), 0.05)
        with pytest.raises(InputError, match=message):
            wide.save_octomap(tmp_path / "wide.ot")
    assert list(tmp_path.iterdir()) == []


def good(suffix: str) -> bytes:
    return written(voxels_of({((0, 0, 0), 1): 1.0, ((5, -3, 2), 1): -1.0}), suffix)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not an OctoMap"),
        (b"# Octomap OcTree file\nid OcTree\nsize 3\n", 'no line "data"'),
        (b"# Octomap OcTree file\nid OcTree\nres 0.1\ndata\n", "lacks size"),
        (good(".ot").replace(b"id OcTree", b"id Other"), "type 'Other'"),
        (good(".ot").replace(b"res 0.1", b"res -1"), "res '-1'"),
        (good(".ot").replace(b"res 0.1", b"res inf"), "res 'inf'"),
        (good(".ot").replace(b"size ", b"size x"), "size 'x"),
        (good(".ot").replace(b"size ", b"size " + b"9" * 5000), r"got size '9{17}\.\.\.9"),
        (good(".ot").replace(b"size ", b"size 9"), "announces 9.* holds"),
        (good(".ot") + b"\n", "1 bytes after the last"),
        (good(".bt") + b"\n", "1 bytes after the last"),
        (good(".ot")[:-3], "cut off"),
        (good(".bt")[:-1], "cut off"),
        (good(".ot")[:-1] + b"\x01", "below depth 16"),
        (good(".bt")[:-2] + b"\0\0", "inner node without children"),
        (good(".bt")[:-2] + b"\3\0", "below depth 16"),
        (good(".ot")[:-5] + np.float32(np.nan).tobytes() + b"\0", "not finite"),
    ],
)
def test_bad_files(content: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        read(content)
    assert "\n" not in str(error.value)


def test_is_octomap(tmp_path: Path) -> None:
    path = tmp_path / "map"
    assert not is_octomap(path)
    assert not is_octomap(tmp_path)
    path.write_bytes(good(".bt"))
    assert is_octomap(path)
    path.write_bytes(b"# Octomap")
    assert not is_octomap(path)
    with pytest.raises(InputError, match="no such file"):
        load_octomap(tmp_path / "nothing.bt")


def test_the_old_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "map.bt"
    path.write_text("old")
    voxels = voxels_of({((0, 0, 0), 1): 1.0})
    with pytest.raises(oddsmap.OutputError, match="exists already"):
        voxels.save_octomap(path)
    assert path.read_text() == "old"
    voxels.save_octomap(path, force=True)
    assert is_octomap(path)


# OctoMap itself.


@pytest.fixture
def octomap() -> ModuleType:
    reason = "octomap-python has no wheel here: the comparison with OctoMap itself is left out"
    module: ModuleType = pytest.importorskip("octomap", reason=reason)
    return module


def leaves_of_octomap(tree: Any) -> Leaves:
    # A leaf's centre is at whole or half cells: floor of its lowest corner plus half a cell.
    resolution, found = tree.getResolution(), {}
    for leaf in tree.begin_leafs():
        side = 2 ** (16 - leaf.getDepth())
        corner = (np.array(leaf.getCoordinate()) / resolution) - side / 2
        cell = tuple(int(i) for i in np.rint(corner))
        found[cell, side] = float(leaf.getValue())
    return found  # type: ignore[return-value]


def noise_map(seed: int, count: int = 3000) -> oddsmap.EvidenceMap:
    """A 3D map with free blocks that can be merged, and noise, around the origin."""
    rng = np.random.default_rng(seed)
    grid = oddsmap.EvidenceMap(0.25, ndim=3)
    free = np.stack(np.meshgrid(*[np.arange(-9, 9)] * 3), axis=-1).reshape(-1, 3)
    grid.add_cells(free, np.zeros(len(free), np.int64), np.full(len(free), 3 * ONE))
    index = np.unique(rng.integers(-40, 40, (count, 3)), axis=0)
    hits, passes = rng.integers(0, 4, (2, len(index))) * ONE
    grid.add_cells(index, hits, passes)
    return grid


@pytest.mark.parametrize("clamp", [None, OCTOMAP_CLAMP])
def test_octomap_reads_our_ot(
    octomap: ModuleType, tmp_path: Path, clamp: tuple[float, float] | None
) -> None:
    view = noise_map(1).log_odds()
    path = tmp_path / "map.ot"
    view.save_octomap(path, clamp=clamp)
    tree = octomap.OcTree.read(str(path).encode())
    ours = leaves_of(load_octomap(path))
    assert ours == leaves_of_octomap(tree)
    size = tree.size()
    tree.updateInnerOccupancy()  # recomputes inner nodes: theirs equal ours if nothing changes
    again = tmp_path / "again.ot"
    assert tree.write(str(again).encode())
    assert again.read_bytes() == path.read_bytes()
    # Nothing is left to prune, and each cell of the map has its log odds.
    assert tree.size() == size
    index, hits, passes = view.evidence.cells()
    expected = view.of_votes(hits / ONE, passes / ONE).astype(np.float32).astype(np.float64)
    if clamp is not None:
        low, high = (np.float32(math.log(p / (1 - p))) for p in clamp)
        expected = np.clip(expected, low, high)
    voxels = load_octomap(path)
    assert voxels.cell_count == len(index)
    assert np.array_equal(voxels.log_odds[voxels.find(index)], expected)


def test_octomap_reads_our_bt_and_writes_the_same(octomap: ModuleType, tmp_path: Path) -> None:
    view = noise_map(2).log_odds()
    view.save_octomap(tmp_path / "map.ot")
    view.save_octomap(tmp_path / "map.bt")
    tree = octomap.OcTree(1.0)
    assert tree.readBinary(str(tmp_path / "map.bt").encode())
    assert leaves_of(load_octomap(tmp_path / "map.bt")) == leaves_of_octomap(tree)
    # OctoMap makes of our .ot, by its maximum likelihood and its pruning, the very same .bt.
    full = octomap.OcTree.read(str(tmp_path / "map.ot").encode())
    assert full.writeBinary(str(tmp_path / "theirs.bt").encode())
    assert (tmp_path / "theirs.bt").read_bytes() == (tmp_path / "map.bt").read_bytes()


def test_we_read_what_octomap_maps(octomap: ModuleType, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    tree = octomap.OcTree(0.2)
    tree.insertPointCloud(rng.uniform(-4, 4, (500, 3)), np.array([0.1, 0.2, 0.3]))
    path = tmp_path / "theirs.ot"
    assert tree.write(str(path).encode())
    assert leaves_of(load_octomap(path)) == leaves_of_octomap(tree)
    load_octomap(path).save_octomap(tmp_path / "ours.ot")
    assert (tmp_path / "ours.ot").read_bytes() == path.read_bytes()


def test_colours_are_left_out(octomap: ModuleType, tmp_path: Path) -> None:
    tree = octomap.ColorOcTree(0.2)
    for i in range(20):
        tree.updateNode(np.array([0.1 + 0.2 * i, -0.3, 0.1]), i % 2 == 0)
    assert tree.write(str(tmp_path / "colour.ot").encode())
    assert leaves_of(load_octomap(tmp_path / "colour.ot")) == leaves_of_octomap(tree)


@pytest.mark.realdata
def test_geb079(octomap: ModuleType, data_folder: Path, tmp_path: Path) -> None:
    path = data_folder / "octomap" / "geb079.bt"
    voxels = load_octomap(path)
    tree = octomap.OcTree(1.0)
    assert tree.readBinary(str(path).encode())
    ours = leaves_of(voxels)
    assert ours == leaves_of_octomap(tree)
    assert (len(ours), voxels.resolution) == (428144, 0.08)
    voxels.save_octomap(tmp_path / "geb079.bt")
    voxels.save_octomap(tmp_path / "geb079.ot")
    data = path.read_bytes()
    begin = data.index(b"data\n")
    assert (tmp_path / "geb079.bt").read_bytes().endswith(data[begin:])
    full = octomap.OcTree.read(str(tmp_path / "geb079.ot").encode())
    assert full.size() == tree.size() == 532566
    assert leaves_of_octomap(full) == ours


def test_eight_leaves_of_two_sizes_stay() -> None:
    # From the first cell of child 0 to the whole of child 7: eight leaves, but not eight children.
    cubes: Leaves = {((2 * (i & 1), 2 * (i >> 1 & 1), 2 * (i >> 2)), 2): 1.0 for i in range(1, 8)}
    leaves: Leaves = {((0, 0, 0), 1): 1.0, **cubes}
    assert leaves_of(read(written(voxels_of(leaves), ".ot"))) == leaves


@pytest.mark.parametrize("suffix", [".bt", ".ot"])
@pytest.mark.parametrize("leaves_at_a_time", [1, 7, 100])
def test_a_tree_written_in_pieces(
    suffix: str, leaves_at_a_time: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nodes that are written before those below them have all come, and nodes that merge late."""
    full = np.stack(np.meshgrid(*[np.arange(16)] * 3), axis=-1).reshape(-1, 3)
    rng = np.random.default_rng(4)
    noise = rng.integers(-40, 40, (400, 3))
    far = [(8000, 8000, 8000), (-8000, 5, 5)]
    leaves: Leaves = {((x, y, z), 1): 0.5 for x, y, z in [*full.tolist(), *(full - 32).tolist()]}
    leaves |= {((x, y, z), 1): float(rng.choice([-2.0, 0.5])) for x, y, z in noise.tolist()}
    leaves |= {(cell, 1): -1.0 for cell in far}
    voxels = voxels_of(leaves)
    tree = naive.build({leaf: 1.0 if v >= 0 else -1.0 for leaf, v in leaves.items()})
    expected = naive.header(tree, 0.1, "binary ") + naive.binary(tree)
    if suffix == ".ot":
        tree = naive.build({leaf: float32(value) for leaf, value in leaves.items()})
        expected = naive.header(tree, 0.1, "") + naive.full(tree)
    assert naive.size(tree) > 5 * octree.KEPT
    monkeypatch.setattr(octomap_nodes, "_LEAVES", leaves_at_a_time)
    assert written(voxels, suffix) == expected
