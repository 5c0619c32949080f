# SPDX-License-Identifier: Apache-2.0
"""The online full map: the batch estimator's messages where nothing is forgotten, then its own."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap import ConfigError, InputError, Pose2, Pose3, Scan, open_log
from oddsmap.config.config import Config, MapConfig
from oddsmap.config.full_map import FullMapConfig
from oddsmap.forward.cell_grid import CellField
from oddsmap.full_map.estimator import build_full_map
from oddsmap.full_map.full_map import FullMap
from oddsmap.full_map.online import OnlineFullMap
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.overhead import OverheadSensor
from oddsmap.sensors.registry import stated_of_sensor
from oddsmap.simulate import Sonar2D

SENSOR = ConeSensor(cone_deg=25.0, range_max=3.0)
RESOLUTION = 0.1


def config(**settings: float) -> Config:
    return Config(
        map=MapConfig(resolution=RESOLUTION),
        sensor=SENSOR,
        full_map=FullMapConfig(**settings),  # type: ignore[arg-type]
    )


def beam(x: float, y: float, heading: float, z: float) -> Scan:
    direction = np.array([[math.cos(heading), math.sin(heading)]])
    return Scan(Pose2(x, y, 0.0), direction, np.array([z]))


def room(count: int, seed: int = 0) -> list[Scan]:
    """Scans along a line through a room of 6 x 4 m."""
    truth = np.ones((40, 60), np.bool_)
    truth[1:-1, 1:-1] = False
    truth[25:30, 20:30] = True
    rng = np.random.default_rng(seed)
    sonar = Sonar2D(beam_count=12, range_max=3.0, p_random=0.02, p_dropout=0.02)
    xs = np.linspace(1.03, 4.97, count)
    return [sonar.scan(truth, RESOLUTION, Pose2(float(x), 1.21, float(x)), rng) for x in xs]


def online(scans: Sequence[Scan], made_with: Config | None = None, **options: int) -> OnlineFullMap:
    estimator = OnlineFullMap(made_with or config(), **options)
    estimator.add_scans(scans)
    return estimator


def same(one: FullMap, other: FullMap) -> bool:
    """Equal to the bit, whatever the order of the blocks."""
    pairs = zip(one.known_log_odds(), other.known_log_odds(), strict=True)
    return all(np.array_equal(a, b) for a, b in pairs)


# ---- against the batch estimator -------------------------------------------------------------


def test_beams_that_share_no_cell_give_the_batch_result() -> None:
    """One beam's messages are the same however often it is looked at."""
    scans = [beam(5.0 * i, 0.0, 0.3 * i, 1.0 + 0.2 * i) for i in range(5)]
    batch = build_full_map(
        scans, RESOLUTION, sensor=SENSOR, settings=FullMapConfig(coupling=0.0, sweeps=3)
    )
    for window in (0, 2, 9):
        assert same(online(scans, config(coupling=0.0), window=window).view(), batch)


def test_one_scan_is_swept_as_the_batch_estimator_sweeps(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first messages and one sweep of the window are two sweeps in the same order."""

    class InOrder:
        def permutation(self, n: int) -> npt.NDArray[np.int64]:
            return np.arange(n)

    scans = room(1)
    settings = FullMapConfig(coupling=0.0, sweeps=2, tolerance=0.0, schedule="sequential")
    monkeypatch.setattr(
        "oddsmap.full_map.belief_propagation.np.random.default_rng", lambda seed: InOrder()
    )
    batch = build_full_map(scans, RESOLUTION, sensor=SENSOR, settings=settings)
    assert batch.sweeps == 2
    ours = online(scans, config(coupling=0.0), window=1, replay=0).view()
    assert same(ours, batch)
    assert ours.residual == batch.residual
    assert not same(online(scans, config(coupling=0.0), window=0, replay=0).view(), batch)


def test_with_all_scans_in_the_window_it_comes_to_the_batch_result() -> None:
    """Both rest where the beliefs explain each other; a beam's word counts once in either."""
    scans = room(6)
    settings = FullMapConfig(coupling=0.0, sweeps=200, tolerance=1e-9, schedule="sequential")
    batch = build_full_map(scans, RESOLUTION, sensor=SENSOR, settings=settings)
    assert batch.converged
    # With each scan far away the first ones are swept once more.
    estimator = online(scans, config(coupling=0.0), window=100)
    estimator.add_scans([beam(500.0, 0.0, 0.0, 1.0)] * 60)
    region = ((0, 0), (60, 40))
    np.testing.assert_allclose(estimator.view().log_odds(region), batch.log_odds(region), atol=1e-5)


# ---- by itself -------------------------------------------------------------------------------


def test_one_call_or_many_give_the_same_bits() -> None:
    scans = room(25)
    one = online(scans).view()
    many = OnlineFullMap(config())
    for scan in scans:
        many.add_scans([scan])
    assert same(one, many.view())
    assert one.sweeps == 3
    assert many.report.scans == 25
    assert many.report.beams == one.report.beams if one.report else False


def test_a_snapshot_is_left_alone_and_leaves_the_map_alone() -> None:
    scans = room(24)
    estimator = online(scans[:12])
    early = estimator.view()
    index, before = early.known_log_odds()
    before = before.copy()
    estimator.add_scans(scans[12:])
    assert np.array_equal(early.known_log_odds()[1], before)
    assert early.report is not None
    assert early.report.scans == 12
    late = estimator.view()
    assert len(late.known_log_odds()[0]) > len(index)
    # Looking at it half way changed nothing: messages went to neighbours in the copy only.
    assert same(late, online(scans).view())


def test_the_window_bounds_memory_and_matters() -> None:
    """Once the window is full it takes no more, and what is swept again is believed better."""
    scans = [scan for seed in range(4) for scan in room(10, seed)]
    estimator = OnlineFullMap(config(), window=5, replay=0)
    sizes = []
    for scan in scans:
        estimator.add_scans([scan])
        sizes.append(estimator.window_nbytes)
    assert sizes[0] > 0
    # Four rounds over the same places: each window of five is about as large as the first ones.
    assert max(sizes[5:]) <= 1.2 * max(sizes[5:15])
    assert max(sizes) < 8 * max(np.diff([0, *sizes[:5]]))
    alone = online(scans, window=0, replay=0)
    assert alone.window_nbytes == 0
    assert not same(alone.view(), estimator.view())


def test_each_option_matters() -> None:
    plain = online(room(12)).view()
    assert not same(plain, online(room(12), prior_every=1).view())
    assert not same(plain, online(room(12), window=1).view())


def test_the_prior_and_its_coupling_matter() -> None:
    plain = online(room(12)).view()
    assert not same(plain, online(room(12), config(coupling=0.3)).view())
    assert not same(plain, online(room(12), config(prior=0.4)).view())


def test_neighbours_are_told_only_where_something_changed() -> None:
    """Beliefs far from the window stay as they are."""
    estimator = online(room(20), window=3, replay=0, prior_every=1)
    region = ((0, 0), (60, 40))
    before = estimator.view().log_odds(region)
    estimator.add_scans([beam(500.0 + 0.5 * i, 0.0, 0.0, 1.0) for i in range(3)])
    moving = estimator.view().log_odds(region)
    estimator.add_scans([beam(500.0 + 0.5 * i, 0.0, 0.0, 1.0) for i in range(4)])
    assert not np.array_equal(before, moving)
    assert np.array_equal(moving, estimator.view().log_odds(region))


def test_a_room_is_mapped() -> None:
    """Fresh readings, away from the benchmark's files."""
    view = online(room(40)).view()
    probability, seen = view.probability(((0, 0), (60, 40))), view.observed(((0, 0), (60, 40)))
    truth = np.ones((40, 60), np.bool_)
    truth[1:-1, 1:-1] = False
    truth[25:30, 20:30] = True
    free = seen & ~truth
    assert free.sum() > 1000
    assert (probability[free] < 0.5).mean() > 0.98
    # The wall along the robot's way, seen from 1.1 m.
    assert (probability[0, 12:48] > 0.5).mean() > 0.9


def test_space() -> None:
    rng = np.random.default_rng(0)
    directions = rng.standard_normal((20, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    scans = [
        Scan(Pose3(np.array([0.3 * i, 0.0, 0.0]), np.eye(3)), directions, np.full(20, 1.0))
        for i in range(3)
    ]
    view = online(scans).view()
    assert view.ndim == 3
    assert view.probability(((0, 0, 0), (1, 1, 1)))[0, 0, 0] < 0.5


# ---- what is counted, and what is refused ----------------------------------------------------


def test_scans_without_information_are_counted() -> None:
    estimator = OnlineFullMap(config())
    report = estimator.add_scans([beam(0.0, 0.0, 0.0, math.nan), beam(math.nan, 0.0, 0.0, 1.0)])
    assert report.scans == 0
    assert report.skipped == {"beam.nan": 1, "scan.empty": 1, "scan.nan_pose": 1}
    with pytest.raises(InputError, match=r"no usable scan .*1 x scan.nan_pose"):
        estimator.view()
    estimator.add_scans(room(1))
    assert estimator.report.scans == 1
    assert estimator.report.skipped["beam.nan"] == 1
    assert estimator.view().provenance[0]["estimator"] == "full-map-online"


def test_a_pose_too_far_is_counted_and_the_prior_is_noted() -> None:
    ways = np.array([[1.0, 0.0]])
    lost, island, here = (
        Scan(Pose2(x, 0.05, 0.0), ways, np.array([1.0])) for x in (1e30, 1e9, 0.05)
    )
    for prior, coupling in ((None, None), (0.3, 0.5)):
        settings = FullMapConfig(prior=prior, coupling=coupling)
        grid = OnlineFullMap(
            Config(map=MapConfig(resolution=RESOLUTION), sensor=SENSOR, full_map=settings)
        )
        report = grid.add_scans([lost, here, island])
        assert (report.scans, report.skipped) == (2, {"scan.pose_too_far": 1})
        view = grid.view()
        noted = (view.provenance[0]["prior"], view.provenance[0]["coupling"])
        assert noted == (prior or 0.475, coupling or 0.8)
        far = round(1e9 / RESOLUTION)
        assert view.observed(((far, 0), (far + 8, 1))).any()


def test_nothing_at_all() -> None:
    with pytest.raises(InputError, match="there are none"):
        OnlineFullMap(config()).view()


def test_plane_and_space_do_not_mix() -> None:
    estimator = online(room(1))
    with pytest.raises(InputError, match="2D and 3D scans"):
        estimator.add_scans([Scan(Pose3(np.zeros(3), np.eye(3)), np.eye(3)[:1], np.ones(1))])


def test_what_is_refused() -> None:
    with pytest.raises(ConfigError, match="window: at least 0 is needed, got -1"):
        OnlineFullMap(config(), window=-1)
    with pytest.raises(ConfigError, match="prior_every: at least 1 is needed, got 0"):
        OnlineFullMap(config(), prior_every=0)
    overhead = Config(map=MapConfig(resolution=0.1, votes="beam"), sensor=OverheadSensor())
    with pytest.raises(ConfigError, match="kind overhead"):
        OnlineFullMap(overhead)


# ---- the field that grows --------------------------------------------------------------------


@pytest.mark.parametrize("d", [2, 3])
def test_a_field_grows_block_by_block(d: int) -> None:
    """Values and numbers stay, and each block knows those beside it, as if made at once."""
    rng = np.random.default_rng(d)
    coords = np.unique(rng.integers(-3, 4, (60, d)), axis=0)
    rng.shuffle(coords)
    field = CellField(d, start=7)
    cells = field.block_cells
    for i, at in enumerate(coords):
        assert field.insert(np.array([at, coords[0]])).tolist() == [i, 0]
        assert (field.belief[i * cells :] == 7).all()
        assert not field.received[i * cells :].any()
        assert not field.observed[i * cells :].any()
        field.belief[i * cells :], field.received[i * cells :], field.observed[i * cells :] = (
            i,
            i,
            1,
        )
    count = len(coords)
    assert np.array_equal(field.coords, coords)
    assert np.array_equal(field.belief, np.repeat(np.arange(count), cells))
    assert np.array_equal(
        field.received, np.repeat(np.arange(count), cells)[:, None] * np.ones(2 * d)
    )
    assert field.observed.all()
    number = {tuple(at): i for i, at in enumerate(coords.tolist())}
    for at, beside in zip(coords.tolist(), field.block_neighbours().tolist(), strict=True):
        for way, found in enumerate(beside):
            other = list(at)
            other[way // 2] += 2 * (way % 2) - 1
            assert found == number.get(tuple(other), -1)


# ---- the benchmark ---------------------------------------------------------------------------


SPECULAR = {"detection": 0.3, "p_dropout": 0.3, "p_random": 0.1, "sigma": 0.04}


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "more", "bound"),
    [
        ("E1_nominal_24x25deg_A_seed0", {}, 0.028),
        ("E5_every_4th_pose_A_seed0", {}, 0.052),
        ("E6_specular_35deg_A_seed0", SPECULAR, 0.072),
    ],
)
def test_the_sonar_benchmark(
    data_folder: Path, name: str, more: dict[str, float], bound: float
) -> None:
    """Log loss; without window and replay it is .030 and without replay .092 in E1 and E6."""
    path = data_folder / "sonar_bench" / f"{name}.npz"
    log = open_log(path)
    said = stated_of_sensor(log) | more
    sensor = ConeSensor(**{name: said[name] for name in said if name != "kind"})
    estimator = OnlineFullMap(Config(map=MapConfig(resolution=0.1), sensor=sensor))
    estimator.add_scans(log)
    arrays = np.load(path)
    p = estimator.view().probability(((0, 0), (150, 150)))
    right = np.where(arrays["truth"], p, 1.0 - p)[arrays["scored"]]
    assert -np.log(np.clip(right, 1e-9, None)).mean() <= bound


def test_settings_of_the_filter_are_refused() -> None:
    for fields in ({"mark_z_max": 1.0}, {"body_min": (0.0,) * 3, "body_max": (1.0,) * 3}):
        sensor = dataclasses.replace(SENSOR, **fields)
        with pytest.raises(ConfigError, match="is for the filter"):
            OnlineFullMap(Config(map=MapConfig(resolution=0.1), sensor=sensor))
