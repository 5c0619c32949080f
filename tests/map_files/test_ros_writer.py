# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import yaml
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from oddsmap.errors import ConfigError, InputError, OutputError
from oddsmap.map_files.ros_reader import RosMode
from oddsmap.map_files.ros_writer import save_ros
from oddsmap.maps.probability_map import ProbabilityMap, load_ros
from oddsmap.odds import State, Thresholds
from tests.naive.nav2_reader import read_map

ORIGIN = (-51.224998474121094, 7.1 / 3.0)
MODES: tuple[RosMode, ...] = ("trinary", "scale", "raw")


def lopsided() -> ProbabilityMap:
    """A world that no flip, turn or transposition maps to itself."""
    probability = np.array(
        [[0.97, 0.03, 0.03, 0.50], [0.03, 0.40, 0.12, 0.80], [0.65, 0.196, 0.03, 0.03]]
    )
    observed = np.array([[1, 1, 0, 1], [1, 1, 1, 1], [1, 1, 1, 0]], dtype=np.bool_)
    return ProbabilityMap(probability, observed, 0.05, ORIGIN, yaw=0.1)


@st.composite
def grids(draw: st.DrawFn) -> ProbabilityMap:
    shape = draw(array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=7))
    number = st.floats(0.0, 1.0) | st.sampled_from([0.0, 0.195, 0.196, 0.1961, 0.5, 0.65, 1.0])
    probability = draw(arrays(np.float64, shape, elements=number))
    observed = draw(arrays(np.bool_, shape))
    coordinate = st.floats(-1e7, 1e7)
    return ProbabilityMap(
        probability,
        observed,
        resolution=draw(st.floats(1e-5, 10.0)),
        origin=(draw(coordinate), draw(coordinate)),
        yaw=draw(st.floats(-3.2, 3.2)),
    )


@st.composite
def limits(draw: st.DrawFn) -> Thresholds:
    free = draw(st.floats(0.01, 0.9) | st.sampled_from([0.196, 50 / 255, 0.25]))
    return Thresholds(free, draw(st.floats(free + 0.05, 0.99)))


def round_trip(grid: ProbabilityMap, mode: RosMode, limit: Thresholds) -> ProbabilityMap:
    with tempfile.TemporaryDirectory() as folder:
        path, _ = save_ros(grid, Path(folder) / "m.yaml", mode=mode, thresholds=limit)
        return load_ros(path)


def data(path: Path, rules: str) -> npt.NDArray[np.int64]:
    found = read_map(path, rules)
    return np.array(found["data"]).reshape(found["height"], found["width"])


@pytest.mark.parametrize("rules", ["older", "newer"])
class TestNav2:
    def test_trinary_map_loads_unflipped(self, tmp_path: Path, rules: str) -> None:
        path, _ = save_ros(lopsided(), tmp_path / "m.yaml")
        expected = [[100, 0, -1, -1], [0, -1, 0, 100], [100, 0, 0, -1]]
        assert data(path, rules).tolist() == expected

    def test_scale_map_loads_unflipped_with_probabilities(self, tmp_path: Path, rules: str) -> None:
        path, _ = save_ros(lopsided(), tmp_path / "m.yaml", mode="scale")
        expected = np.array([[100, 0, -1, 50], [0, 40, 0, 100], [100, 0, 0, -1]])
        assert np.abs(data(path, rules) - expected).max() <= 1
        assert np.array_equal(data(path, rules) % 100 == 0, expected % 100 == 0)

    def test_raw_map_loads_unflipped_with_percents(self, tmp_path: Path, rules: str) -> None:
        path, _ = save_ros(lopsided(), tmp_path / "m.yaml", mode="raw")
        expected = [[97, 3, -1, 50], [3, 40, 12, 80], [65, 20, 3, -1]]
        assert data(path, rules).tolist() == expected

    @pytest.mark.parametrize("mode", MODES)
    def test_origin_and_resolution_are_exact(
        self, tmp_path: Path, rules: str, mode: RosMode
    ) -> None:
        path, _ = save_ros(lopsided(), tmp_path / "m.yaml", mode=mode)
        found = read_map(path, rules)
        assert found["resolution"] == 0.05
        assert found["origin"] == (*ORIGIN, 0.1)

    @given(grid=grids(), limit=limits())
    def test_any_map_under_any_thresholds(
        self, rules: str, grid: ProbabilityMap, limit: Thresholds
    ) -> None:
        state = grid.state(thresholds=limit)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "m.yaml"
            save_ros(grid, path, thresholds=limit)
            trinary = data(path, rules)
            save_ros(grid, path, mode="scale", thresholds=limit, force=True)
            scale = data(path, rules)
        assert np.array_equal(trinary, np.where(state == State.UNDECIDED, -1, state))
        undecided = state == State.UNDECIDED
        assert np.array_equal(scale[~undecided], state[~undecided])
        step = 100.0 / (255.0 * (limit.occupied - limit.free))
        error = np.abs(scale - 100.0 * grid.probability)[undecided]
        assert np.all(error <= 1.01 * step + 0.5)


class TestRoundTrip:
    @given(grid=grids(), limit=limits())
    def test_trinary_keeps_every_state(self, grid: ProbabilityMap, limit: Thresholds) -> None:
        expected = grid.state(thresholds=limit)
        expected[expected == State.UNDECIDED] = State.UNKNOWN
        again = round_trip(grid, "trinary", limit)
        assert np.array_equal(again.state(thresholds=limit), expected)
        assert np.array_equal(again.state(), expected)

    @given(grid=grids(), limit=limits())
    def test_scale_keeps_state_and_probability(
        self, grid: ProbabilityMap, limit: Thresholds
    ) -> None:
        # Closer together, they may leave no grey that reads as a probability between them.
        assume(limit.occupied - limit.free >= 0.07)
        again = round_trip(grid, "scale", limit)
        assert np.array_equal(again.observed, grid.observed)
        assert np.array_equal(again.state(thresholds=limit), grid.state(thresholds=limit))
        step = np.where(
            grid.state(thresholds=limit) == State.UNDECIDED,
            1.0 / (255.0 * (limit.occupied - limit.free)),
            1.0 / 255.0,
        )
        error = np.abs(again.probability - grid.probability)
        assert np.all((error <= 1.01 * step)[grid.observed])

    @given(grid=grids())
    def test_raw_keeps_percents(self, grid: ProbabilityMap) -> None:
        again = round_trip(grid, "raw", Thresholds())
        assert np.array_equal(again.observed, grid.observed)
        error = np.abs(again.probability - grid.probability)[grid.observed]
        assert np.all(error <= 0.005 + 1e-12)

    @given(grid=grids(), mode=st.sampled_from(MODES))
    def test_frame_is_exact(self, grid: ProbabilityMap, mode: RosMode) -> None:
        again = round_trip(grid, mode, Thresholds())
        assert again.resolution == grid.resolution
        assert again.origin == grid.origin
        assert again.yaw == grid.yaw


class TestFiles:
    def test_yaml_has_the_keys_of_map_saver_in_its_order(self, tmp_path: Path) -> None:
        path, image = save_ros(lopsided(), tmp_path / "hall.v2.yaml")
        fields = yaml.safe_load(path.read_text())
        assert fields == {
            "image": "hall.v2.pgm",
            "mode": "trinary",
            "resolution": 0.05,
            "origin": [*ORIGIN, 0.1],
            "negate": 0,
            "occupied_thresh": 0.65,
            "free_thresh": 0.196,
        }
        assert list(fields)[:2] == ["image", "mode"]
        assert image == tmp_path / "hall.v2.pgm"

    def test_greys_are_those_of_map_saver(self, tmp_path: Path) -> None:
        _, image = save_ros(lopsided(), tmp_path / "m.yaml")
        top = image.read_bytes()[-12:-8]
        assert list(top) == [0, 254, 254, 205]  # top row = highest y

    def test_small_numbers_are_numbers_in_yaml(self, tmp_path: Path) -> None:
        grid = ProbabilityMap(np.zeros((1, 1)), np.ones((1, 1), np.bool_), 1e-05, (1e22, 0.0))
        path, _ = save_ros(grid, tmp_path / "m.yaml")
        fields = yaml.safe_load(path.read_text())
        assert fields["resolution"] == 1e-05
        assert fields["origin"] == [1e22, 0.0, 0.0]

    def test_odd_names_survive_yaml(self, tmp_path: Path) -> None:
        path, _ = save_ros(lopsided(), tmp_path / "Halle Süd: #1 'a'.yaml")
        assert load_ros(path).resolution == 0.05

    @pytest.mark.parametrize("name", ["m.yaml", "m.pgm"])
    def test_existing_file_is_refused_before_anything_is_written(
        self, tmp_path: Path, name: str
    ) -> None:
        (tmp_path / name).write_text("mine")
        with pytest.raises(OutputError, match="exists already"):
            save_ros(lopsided(), tmp_path / "m.yaml")
        assert [file.name for file in tmp_path.iterdir()] == [name]
        assert (tmp_path / name).read_text() == "mine"
        save_ros(lopsided(), tmp_path / "m.yaml", force=True)
        assert read_map(tmp_path / "m.yaml")["width"] == 4

    def test_failure_leaves_old_files(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        save_ros(lopsided(), tmp_path / "m.yaml")
        old = {file.name: file.read_bytes() for file in tmp_path.iterdir()}

        def full(*_: object) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr("oddsmap.map_files.ros_writer._write_pgm", full)
        with pytest.raises(OutputError, match="No space left"):
            save_ros(lopsided(), tmp_path / "m.yaml", mode="raw", force=True)
        assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == old


class TestRefusals:
    @pytest.mark.parametrize("shape", [(0, 0), (0, 5), (5, 0)])
    def test_empty_map(self, tmp_path: Path, shape: tuple[int, int]) -> None:
        grid = ProbabilityMap(np.zeros(shape), np.zeros(shape, np.bool_), 0.05)
        with pytest.raises(InputError, match="nothing to write"):
            save_ros(grid, tmp_path / "m.yaml")
        assert not list(tmp_path.iterdir())

    @pytest.mark.parametrize("value", [np.nan, -0.1, 1.1])
    def test_impossible_probability(self, tmp_path: Path, value: float) -> None:
        grid = ProbabilityMap(np.array([[value, 0.5]]), np.ones((1, 2), np.bool_), 0.05)
        with pytest.raises(InputError, match="1 observed cells"):
            save_ros(grid, tmp_path / "m.yaml")

    def test_no_grey_between_thresholds(self, tmp_path: Path) -> None:
        limit = Thresholds(0.5, 0.501)
        grid = ProbabilityMap(np.array([[0.5005]]), np.ones((1, 1), np.bool_), 0.05)
        for mode in ("trinary", "scale"):
            with pytest.raises(ConfigError, match="leave no 8-bit grey"):
                save_ros(grid, tmp_path / "m.yaml", mode=mode, thresholds=limit)
        assert not list(tmp_path.iterdir())

    def test_unknown_mode(self, tmp_path: Path) -> None:
        with pytest.raises(ConfigError, match="mode must be one of trinary, scale, raw"):
            save_ros(lopsided(), tmp_path / "m.yaml", mode="grey")  # type: ignore[arg-type]

    def test_wrong_suffix(self, tmp_path: Path) -> None:
        with pytest.raises(ConfigError, match=r"named by its \.yaml"):
            save_ros(lopsided(), tmp_path / "m.pgm")


@pytest.mark.parametrize(("off", "kept"), [(0.5e-6, False), (1.5e-6, True)])
def test_greys_keep_a_millionth_off_the_thresholds(tmp_path: Path, off: float, kept: bool) -> None:
    """Of greys 0.2 and 0.8 dark: versions of Nav2 may take one next to a threshold differently."""
    grid = ProbabilityMap(np.array([[0.2, 0.8]]), np.ones((1, 2), np.bool_), 0.05)
    limit = Thresholds(0.2 + off, 0.8 - off)
    path, _ = save_ros(grid, tmp_path / "m.yaml", mode="scale", thresholds=limit)
    again = load_ros(path)
    assert again.state(thresholds=limit).tolist() == [[State.FREE, State.OCCUPIED]]
    assert np.allclose(again.probability, [[0.2, 0.8]], atol=1e-9) == kept
