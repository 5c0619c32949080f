# SPDX-License-Identifier: Apache-2.0
"""Configuration: checked, explained, and without a field that changes nothing."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import BeamSensor, ConeSensor, GridScan, Scan, build_map
from oddsmap.config.config import (
    Config,
    MapConfig,
    PosteriorConfig,
    parse_setting,
    read_toml,
    resolve,
)
from oddsmap.config.full_map import FullMapConfig
from oddsmap.errors import ConfigError
from oddsmap.forward.beams import Beams
from oddsmap.forward.occupancy_box import Window
from oddsmap.full_map.estimator import FullMapEstimator
from oddsmap.poses.pose import Pose2, Pose3
from oddsmap.scans.measurement import Measurement
from oddsmap.sensors.registry import KINDS
from tests.full_map.kit import room

HOLDERS: dict[str, Any] = {
    "map": MapConfig,
    "posterior": PosteriorConfig,
    "full_map": FullMapConfig,
    **KINDS,
}
FIELDS = [
    (holder, field.name, str(field.type))
    for holder, kind in HOLDERS.items()
    for field in dataclasses.fields(kind)
]
Values = dict[str, dict[str, Any]]

# Four beams 0.02 rad apart, of all sorts: one short, two that share cells, one that saw nothing.
ANGLES = np.array([0.0, 0.02, 0.04, 1.0, 2.0])
FLAT = [
    Scan(
        Pose2(0.05, 0.05, 0.0),
        np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1),
        np.array([2.03, 1.02, 2.04, 0.3, math.inf]),
        stamp_ns=0,
    ),
    Scan(Pose2(0.05, 0.05, 0.5), np.array([[1.0, 0.0]]), np.array([1.0]), stamp_ns=60 * 10**9),
]
# 3D beams ahead, back and up: for the filters of what may mark.
AXES = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
SPACE = [Scan(Pose3(np.zeros(3), np.eye(3)), AXES, np.full(3, 1.05))]
GRID = [GridScan(Pose2(0.0, 0.0, 0.0), np.array([[0.0, 1.0], [0.7, 0.2]]), 0.1, (0.0, 0.0))]

# What the log of each kind of sensor is mapped with.
BASES: dict[str, Values] = {
    "beam": {"map": {"resolution": 0.1}, "sensor": {"range_max": 3.0, "hit_width": 0.45}},
    "cone": {
        "map": {"resolution": 0.1},
        "sensor": {"kind": "cone", "cone_deg": 20.0, "range_max": 3.0},
    },
    "overhead": {"map": {"resolution": 0.1}, "sensor": {"kind": "overhead"}},
}
FILTERS = {
    "mark_z_min": -1.0,
    "mark_z_max": 2.0,
    "body_min": [-0.5, -0.5, -0.5],
    "body_max": [0.5, 0.5, 0.5],
}

# For each field a value that changes what comes out of the log; a second dictionary is of what else
# is set for both, without which the field has no say.
CHANGES: dict[str, dict[str, Any]] = {
    "map": {
        "resolution": 0.05,
        "votes": "beam",
        "half_life": (30.0, {"t_ref_ns": None}),
        "t_ref_ns": (90 * 10**9, {"half_life": 30.0}),
        "half_life_scans": (3.0, {"ref_scan": None}),
        "ref_scan": (5, {"half_life_scans": 3.0}),
        "path_lengths": (True, {"votes": "beam"}),
    },
    "posterior": {"prior": 0.2, "free": 0.45, "occupied": 0.75},
    "full_map": {
        "method": "map",
        "prior_model": ("windows", {"method": "gibbs"}),
        "prior": 0.3,
        "coupling": 0.4,
        "sweeps": 2,
        "tolerance": 0.5,
        "schedule": "sequential",
        "chunk": 1,
        "seed": 1,
        "samples": (4, {"method": "gibbs", "burn_in": 2}),
        "burn_in": (1, {"method": "gibbs", "samples": 3}),
    },
    "beam": {
        "range_min": 0.5,
        "range_max": 2.0,
        "clear_range": 1.0,
        "hit_width": 0.0,
        "share_hit": True,
        "sigma": (0.1, {"hit_width": 0.0}),
        "spread": (1.0, {"hit_width": 0.0, "sigma": 0.1}),
        "fade": 0.5,
        "p_hit": 0.9,
        "p_miss": 0.45,
        "mark_z_min": 0.5,
        "mark_z_max": 0.5,
        "body_min": [-3.0, -3.0, -3.0],
        "body_max": [2.0, 0.5, 0.5],
        "angle_min": 0.01,
        "angle_max": 1.5,
    },
    "cone": {
        "cone_deg": 30.0,
        "range_min": 0.5,
        "range_max": 2.0,
        "clear_range": 1.0,
        "hit_width": 0.3,
        "share_hit": False,
        "angular_falloff": 0.5,
        "range_falloff": 0.5,
        "pass_falloff": 0.5,
        "p_hit": 0.9,
        "p_miss": 0.45,
        "mark_z_min": 0.5,
        "mark_z_max": 0.5,
        "body_min": [-3.0, -3.0, -3.0],
        "body_max": [2.0, 0.5, 0.5],
    },
    "overhead": {"true_positive_rate": 0.8, "false_positive_rate": 0.2},
}
# Fields of the forward model p(z | map): they change it, and by themselves no filter.
FORWARD: dict[str, dict[str, Any]] = {
    "beam": {"detection": 0.7, "p_random": 0.1, "p_dropout": 0.1},
    "cone": {"detection": 0.7, "p_random": 0.1, "p_dropout": 0.1, "sigma": 0.1},
}
CASES = [(holder, name) for holder, fields in CHANGES.items() for name in fields]

# Fields that may be 0, and fields that may be above 1.
ZERO = {
    *(("beam", name) for name in ("range_min", "hit_width", "sigma", "fade")),
    *(("cone", name) for name in ("range_min", "hit_width", "p_random", "p_dropout")),
    *(("beam", name) for name in ("p_random", "p_dropout")),
    ("cone", "angular_falloff"),
    ("cone", "range_falloff"),
    ("cone", "pass_falloff"),
    ("posterior", "free"),
    ("full_map", "coupling"),
    ("full_map", "tolerance"),
}
LENGTHS = ("range_min", "range_max", "clear_range", "hit_width")
LARGE = {
    *((kind, name) for kind in ("beam", "cone") for name in LENGTHS),
    *(("beam", name) for name in ("sigma", "spread", "fade")),
    ("cone", "cone_deg"),
    ("cone", "sigma"),
    ("map", "resolution"),
    ("map", "half_life"),
    ("map", "half_life_scans"),
    ("full_map", "coupling"),
    ("full_map", "tolerance"),
}


def section_of(holder: str) -> str:
    return "sensor" if holder in KINDS else holder


def log_and_base(holder: str, name: str) -> tuple[list[Measurement], Values]:
    """The readings that a field has a say in, and the settings that it is changed from."""
    if holder == "full_map":
        return [*room(20)], {**BASES["cone"], "full_map": {"sweeps": 6}}
    kind = holder if holder in KINDS else "beam"
    base = {section: dict(values) for section, values in BASES[kind].items()}
    if name == "path_lengths":  # they are not for wide hits
        base["sensor"]["hit_width"] = 0.0
    if name in FILTERS:
        base["sensor"] |= FILTERS
        return [*SPACE], base
    return [*(GRID if kind == "overhead" else FLAT)], base


def result(config: Config, log: list[Measurement]) -> tuple[bytes, ...]:
    evidence = build_map(log, sensor=config.sensor, **dataclasses.asdict(config.map))
    evidence.config = config
    view = evidence.log_odds()
    parts: list[np.ndarray[Any, Any]] = [*evidence.cells(), view.probability()]
    if evidence.lengths is not None:
        parts += evidence.cell_lengths()
    if evidence.ndim == 2:
        parts.append(view.state())
    return tuple(part.tobytes() for part in parts)


@pytest.mark.parametrize("holder", HOLDERS)
def test_every_field_has_a_case(holder: str) -> None:
    names = {field.name for field in dataclasses.fields(HOLDERS[holder])}
    assert names == set(CHANGES[holder]) | set(FORWARD.get(holder, {}))


def test_every_section_has_cases() -> None:
    sections = {field.name for field in dataclasses.fields(Config)}
    assert sections == {section_of(holder) for holder in HOLDERS}
    assert set(CHANGES) == set(HOLDERS)


@pytest.mark.parametrize(("holder", "name"), CASES)
def test_each_field_changes_the_result(holder: str, name: str) -> None:
    section = section_of(holder)
    log, values = log_and_base(holder, name)
    value, also = CHANGES[holder][name], {}
    if isinstance(value, tuple):
        value, also = value
    base = resolve(("base", values), ("also", {section: also}))
    changed = resolve(
        ("base", values), ("also", {section: also}), ("set", {section: {name: value}})
    )
    assert base != changed
    made = full_map if holder == "full_map" else result
    assert made(base, log) == made(base, log)
    assert made(base, log) != made(changed, log)


def full_map(config: Config, log: list[Measurement]) -> bytes:
    estimator = FullMapEstimator(config)
    estimator.add_log(log)
    box = ((-10, -10), (70, 50))
    return estimator.estimate().log_odds(box).tobytes()


@pytest.mark.parametrize(
    ("section", "field"), [("sensor", name) for name in FORWARD["cone"]] + [("map", "resolution")]
)
def test_a_full_map_is_made_with_the_forward_model(section: str, field: str) -> None:
    log, values = log_and_base("full_map", field)
    value = {**FORWARD["cone"], "resolution": 0.2}[field]
    base = resolve(("base", values))
    changed = resolve(("base", values), ("set", {section: {field: value}}))
    assert full_map(base, log) != full_map(changed, log)


@pytest.mark.parametrize(
    "values",
    [
        {"sweeps": 0}, {"chunk": 0}, {"seed": -1}, {"samples": 0}, {"burn_in": -1},
        {"schedule": "random"}, {"method": "thrun"}, {"prior": 1.0}, {"coupling": 65.0},
    ],
)  # fmt: skip
def test_bounds_of_the_full_map(values: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=f"full_map.{next(iter(values))} .*got"):
        resolve(("file.toml", {"map": {"resolution": 1.0}, "full_map": values}))


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind in FORWARD for name in FORWARD[kind]]
)
def test_each_field_of_the_forward_model_changes_the_likelihood(kind: str, name: str) -> None:
    log, values = log_and_base(kind, name)
    base = resolve(("base", values))
    changed = resolve(("base", values), ("set", {"sensor": {name: FORWARD[kind][name]}}))
    assert likelihood(base) == likelihood(base)
    assert likelihood(base) != likelihood(changed)
    assert result(base, log) == result(changed, log)


def likelihood(config: Config) -> float:
    """p(z | map) of a return from a wall one metre away."""
    assert isinstance(config.sensor, BeamSensor | ConeSensor)
    occupancy = np.zeros((20, 20))
    occupancy[:, 10] = 1.0
    window = Window(occupancy, config.map.resolution)
    beam = Beams(np.array([[0.05, 1.0]]), np.array([[1.0, 0.0]]), np.array([0.97]))
    return float(config.sensor.forward_model().likelihood(beam, window)[0])


@pytest.mark.parametrize(("holder", "name", "kind"), FIELDS)
def test_bounds(holder: str, name: str, kind: str) -> None:
    if "float" not in kind or name in FILTERS or name.startswith("angle_"):
        return  # the filters: any height, any box, any angle (below)
    bad = [math.nan, math.inf, -math.inf, -1.0]
    bad += [] if (holder, name) in ZERO else [0.0]
    bad += [] if (holder, name) in LARGE else [1.5]
    base = BASES[holder if holder in KINDS else "beam"]
    for value in bad:
        with pytest.raises(ConfigError, match=r"got|thresholds") as caught:
            resolve(("file.toml", base), ("set", {section_of(holder): {name: value}}))
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "sensor",
    [
        {"mark_z_min": math.nan},
        {"mark_z_max": math.inf},
        {"mark_z_min": 2.0, "mark_z_max": 1.0},
        {"body_min": [0.0, 0.0, 0.0]},
        {"body_min": [0.0, 0.0, 0.0], "body_max": [1.0, 1.0, 0.0]},
        {"body_min": [0.0, 0.0, math.nan], "body_max": [1.0, 1.0, 1.0]},
        {"body_min": [0.0, 0.0], "body_max": [1.0, 1.0, 1.0]},
        {"body_min": [0.0, 1.0], "body_max": [1.0, 1.0]},
        {"angle_min": 4.0},
        {"angle_max": -4.0},
        {"angle_min": 1.0, "angle_max": 1.0},
        {"angle_min": -90.0, "angle_max": 90.0},
        {"angle_min": math.nan, "angle_max": 1.0},
        {"angle_min": 0.0, "angle_max": math.inf},
    ],
)
def test_bounds_of_filters(sensor: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=r"got|both or none"):
        resolve(("file.toml", {"map": {"resolution": 1.0}, "sensor": sensor}))


def test_ranges_lie_in_order() -> None:
    BeamSensor(range_min=0.9, range_max=1.0)
    for kind in (BeamSensor, lambda **ranges: ConeSensor(cone_deg=20.0, **ranges)):
        with pytest.raises(ConfigError, match=r"range_min < range_max .* 1\.0 and 1\.0"):
            kind(range_min=1.0, range_max=1.0)


def test_a_kind_that_is_no_word() -> None:
    with pytest.raises(ConfigError, match=r"sensor\.kind is one of .*got \[1\]"):
        resolve(("file.toml", {"map": {"resolution": 1.0}, "sensor": {"kind": [1]}}))


def test_whole_numbers_reach_kernels_as_floats() -> None:
    sensor = BeamSensor(
        range_min=1, range_max=30, clear_range=10, hit_width=2, mark_z_min=0, mark_z_max=2
    )
    numbers = (*sensor.limits, *sensor.heights, sensor.half_width)
    assert {type(number) for number in numbers} == {float}
    assert type(BeamSensor(sigma=1, spread=3).half_width) is float


BOX2, BOX3 = ({"body_min": (-1.0,) * d, "body_max": (1.0,) * d} for d in (2, 3))


@pytest.mark.parametrize(
    ("log", "filters", "words"),
    [
        (FLAT, {"mark_z_min": 0.0}, "mark_z_max are for 3D scans: these are 2D"),
        (FLAT, BOX3, "have 3 numbers each, and these scans are 2D: give two numbers, x and y"),
        (SPACE, BOX2, "have 2 numbers each, and these scans are 3D: give three numbers, x, y and"),
        (SPACE, {"angle_max": 1.0}, "angle_max are for 2D scans: these are 3D"),
    ],
)
def test_filters_are_for_scans_of_their_dimension(
    log: list[Measurement], filters: dict[str, Any], words: str
) -> None:
    sensors: list[Any] = [BeamSensor(**filters)]
    if "angle_max" not in filters:  # cones have no window
        sensors.append(ConeSensor(cone_deg=20.0, **filters))
    for sensor in sensors:
        with pytest.raises(ConfigError, match=words):
            build_map(log, 0.1, sensor=sensor)


@pytest.mark.parametrize(("holder", "name", "kind"), FIELDS)
def test_types(holder: str, name: str, kind: str) -> None:
    section = section_of(holder)
    base = BASES[holder if holder in KINDS else "beam"]
    wrong: list[Any] = [[], {}, 1 + 2j]
    wrong += [] if kind == "bool" else [True]
    wrong += [] if kind == "str" else ["far"]
    wrong += [] if kind.startswith("float") else [0.5]
    wrong += [] if kind.startswith(("float", "int")) else [1]
    wrong += [] if "None" in kind else [None]
    for value in wrong:
        with pytest.raises(ConfigError, match=f"file.toml: {section}.{name} is "):
            resolve(("log", base), ("file.toml", {section: {name: value}}))


def test_whole_numbers_are_numbers() -> None:
    assert resolve(("a", {"map": {"resolution": 1}, "sensor": {"range_max": 30}})) == Config(
        map=MapConfig(resolution=1.0), sensor=BeamSensor(range_max=30.0)
    )


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"sensr": {}}, '"sensr", did you mean "sensor"'),
        ({"sensor": {"range_mx": 3.0}}, '"range_mx", did you mean "range_max"'),
        ({"map": {"votse": "beam"}}, '"votse", did you mean "votes"'),
        ({"posterior": {"priors": 0.5}}, '"priors", did you mean "prior"'),
        ({"zzzz": {}}, 'no section is called "zzzz"'),
        ({"sensor": 3}, r"\[sensor\] is a section, got 3"),
        ({}, "map.resolution is missing"),
        ({"map": {"votes": "beam"}}, "map.resolution is missing"),
        ({"map": {"resolution": 1.0, "votes": "all"}}, '"scan" or "beam", got "all"'),
        (
            {"map": {"resolution": 1.0}, "posterior": {"free": 0.7}},
            "free < occupied <= 1, got 0.7 and 0.65",
        ),
    ],
)
def test_what_is_wrong_is_said(values: Any, message: str) -> None:
    for layers in (True, False):
        with pytest.raises(ConfigError, match=message) as caught:
            _ = resolve(("a.toml", values)) if layers else Config.from_dict(values, "a.toml")
        # Once layers are merged no one file is to blame for a value outside its range.
        assert "did you mean" not in message or str(caught.value).startswith("a.toml: ")
        assert "\n" not in str(caught.value)


def test_the_last_layer_wins() -> None:
    config = resolve(
        ("log", {"map": {"resolution": 0.1}, "sensor": {"range_max": 80.0, "range_min": 0.2}}),
        ("toml", {"sensor": {"range_max": 30.0}, "posterior": {"prior": 0.3}}),
        ("--set", {"posterior": {"prior": 0.4}, "map": {"votes": "beam"}}),
    )
    assert config == Config(
        map=MapConfig(resolution=0.1, votes="beam"),
        sensor=BeamSensor(range_max=30.0, range_min=0.2),
        posterior=PosteriorConfig(prior=0.4),
    )


def test_to_dict_and_back() -> None:
    config = Config(
        map=MapConfig(resolution=0.1, votes="beam"),
        sensor=BeamSensor(clear_range=3.0, share_hit=True),
        posterior=PosteriorConfig(free=0.0, occupied=1.0),
    )
    assert Config.from_dict(config.to_dict(), "x") == config
    assert config.posterior.thresholds == dataclasses.replace(
        config.posterior.thresholds, free=0.0, occupied=1.0
    )


@pytest.mark.parametrize(
    ("text", "want"),
    [
        ("sensor.range_max=30", ("sensor", "range_max", 30)),
        ("sensor.p_hit = 0.7", ("sensor", "p_hit", 0.7)),
        ("sensor.share_hit=true", ("sensor", "share_hit", True)),
        ("map.votes=beam", ("map", "votes", "beam")),
        ('map.votes="beam"', ("map", "votes", "beam")),
        ("a.b=c=d", ("a", "b", "c=d")),
        ("a.b=", ("a", "b", "")),
    ],
)
def test_parse_setting(text: str, want: tuple[str, str, object]) -> None:
    got = parse_setting(text)
    assert got == want
    assert type(got[2]) is type(want[2])


@pytest.mark.parametrize("text", ["", "x", "a.b", "a=1", ".b=1", "a.=1", "=1"])
def test_parse_setting_refuses(text: str) -> None:
    with pytest.raises(ConfigError, match=r"needs section\.field=value"):
        parse_setting(text)


def test_read_toml(tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_text('[map]\nresolution = 0.1\nvotes = "beam"\n')
    assert read_toml(file) == {"map": {"resolution": 0.1, "votes": "beam"}}
    file.write_text("\ufeff[map]\nresolution = 0.1\n", encoding="utf-8")  # as Notepad writes it
    assert read_toml(file) == {"map": {"resolution": 0.1}}
    for content in (b"[map", b"a = 1\na = 2", b"\xff\xfe"):
        file.write_bytes(content)
        with pytest.raises(ConfigError, match=r"a\.toml: not a TOML file"):
            read_toml(file)
    for text in ("map = 5", 'sensor = "kind"'):
        file.write_text(text)
        with pytest.raises(ConfigError, match=r"a\.toml: \[\w+\] is a section"):
            read_toml(file)
    for path in (tmp_path / "none.toml", tmp_path):
        with pytest.raises(ConfigError, match="cannot be read"):
            read_toml(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[map]\nresolution = " + "[" * 5000 + "]" * 5000, "not a TOML file (nested too deeply)"),
        ("[map]\nresolution = " + "9" * 5000, "not a TOML file (Exceeds the limit"),
        ("a." * 20_000 + "a = 1", "a.toml:1: a key of 20001 parts"),
        ("[map]\n[map." + "a." * 200 + "b]", "a.toml:2: a key of"),
        ("# " + "x" * 70_000, "not a configuration: 70002 bytes of TOML"),
    ],
)
def test_a_hostile_file_is_one_line(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "a.toml"
    file.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_toml(file)
    assert message in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("value", [10**400, -(2**63) - 1, 2**63])
def test_an_integer_beyond_all_floats_is_no_number(value: int) -> None:
    """TOML's integers have any number of digits."""
    for section, name in (("map", "resolution"), ("sensor", "range_max"), ("map", "t_ref_ns")):
        layer: dict[str, dict[str, Any]] = {"map": {"resolution": 1.0}, section: {name: value}}
        with pytest.raises(ConfigError, match=rf"{name} is a number that 64 bits can hold, got "):
            resolve(("a.toml", layer))
    with pytest.raises(ConfigError, match=r"--set map\.x: not a value"):
        parse_setting("map.x=" + "[" * 5000)


def test_configurations_are_frozen() -> None:
    needed = {"map": {"resolution": 1.0}, "cone": {"cone_deg": 20.0}}
    for holder, name, _ in FIELDS:
        value = HOLDERS[holder](**needed.get(holder, {}))
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(value, name, 0.3)
        assert not hasattr(value, "__dict__")
