# SPDX-License-Identifier: Apache-2.0
"""Configuration: checked, explained, and without a field that changes nothing."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from oddsmap import BeamSensor, Scan, build_map
from oddsmap.config import Config, MapConfig, PosteriorConfig, parse_setting, read_toml, resolve
from oddsmap.errors import ConfigError
from oddsmap.poses import Pose2, Pose3

SECTIONS = {"map": MapConfig, "sensor": BeamSensor, "posterior": PosteriorConfig}
FIELDS = [
    (section, field.name, str(field.type))
    for section, kind in SECTIONS.items()
    for field in dataclasses.fields(kind)
]

# Four beams 0.02 rad apart, of all sorts: one short, two that share cells, one that saw nothing.
ANGLES = np.array([0.0, 0.02, 0.04, 1.0, 2.0])
LOG = [
    Scan(
        Pose2(0.05, 0.05, 0.0),
        np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=1),
        np.array([2.03, 1.02, 2.04, 0.3, math.inf]),
    )
]
BASE: dict[str, dict[str, Any]] = {
    "map": {"resolution": 0.1},
    "sensor": {"range_max": 3.0, "hit_width": 0.45},
}

# Beams of space ahead, back and up: for the filters of what may mark.
AXES = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
SPACE = [Scan(Pose3(np.eye(3), np.zeros(3)), AXES, np.full(3, 1.05))]
SPACE_BASE: dict[str, dict[str, Any]] = {
    "map": {"resolution": 0.1},
    "sensor": {
        "mark_z_min": -1.0,
        "mark_z_max": 2.0,
        "body_min": [-0.5, -0.5, -0.5],
        "body_max": [0.5, 0.5, 0.5],
    },
}
FILTERS = {f"sensor.{name}" for name in SPACE_BASE["sensor"]}

# A value that changes what comes out of LOG, for each field.
CHANGES: dict[str, Any] = {
    "map.resolution": 0.05,
    "map.votes": "beam",
    "sensor.range_min": 0.5,
    "sensor.range_max": 2.0,
    "sensor.clear_range": 1.0,
    "sensor.hit_width": 0.0,
    "sensor.share_hit": True,
    "sensor.p_hit": 0.9,
    "sensor.p_miss": 0.45,
    "sensor.mark_z_min": 0.5,
    "sensor.mark_z_max": 0.5,
    "sensor.body_min": [-3.0, -3.0, -3.0],
    "sensor.body_max": [2.0, 0.5, 0.5],
    "posterior.prior": 0.2,
    "posterior.free": 0.45,
    "posterior.occupied": 0.75,
}


def result(config: Config, log: list[Scan]) -> tuple[bytes, ...]:
    evidence = build_map(log, config.map.resolution, sensor=config.sensor, votes=config.map.votes)
    evidence.config = config
    view = evidence.log_odds()
    parts: list[np.ndarray[Any, Any]] = [*evidence.cells(), view.probability()]
    if evidence.ndim == 2:
        parts.append(view.state())
    return tuple(part.tobytes() for part in parts)


def test_every_field_has_a_case() -> None:
    assert {f"{section}.{name}" for section, name, _ in FIELDS} == set(CHANGES)
    assert {field.name for field in dataclasses.fields(Config)} == set(SECTIONS)


@pytest.mark.parametrize("setting", CHANGES)
def test_each_field_changes_the_result(setting: str) -> None:
    section, name = setting.split(".")
    log, values = (SPACE, SPACE_BASE) if setting in FILTERS else (LOG, BASE)
    base = resolve(("base", values))
    changed = resolve(("base", values), ("changed", {section: {name: CHANGES[setting]}}))
    assert base != changed
    assert result(base, log) == result(base, log)
    assert result(base, log) != result(changed, log)


@pytest.mark.parametrize(("section", "name", "kind"), FIELDS)
def test_bounds(section: str, name: str, kind: str) -> None:
    if "float" not in kind or f"sensor.{name}" in FILTERS:
        return  # the filters: any height, any box (below)
    bad = [math.nan, math.inf, -math.inf, -1.0]
    if (section, name) not in {
        ("sensor", "range_min"), ("sensor", "hit_width"), ("posterior", "free")
    }:  # fmt: skip
        bad.append(0.0)
    if "range" not in name and name not in {"resolution", "hit_width"}:
        bad.append(1.5)
    for value in bad:
        with pytest.raises(ConfigError, match=r"got|thresholds") as caught:
            resolve(("file.toml", {"map": {"resolution": 1.0}}), ("set", {section: {name: value}}))
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
    ],
)
def test_bounds_of_filters(sensor: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=r"got|both or none"):
        resolve(("file.toml", {"map": {"resolution": 1.0}, "sensor": sensor}))


def test_filters_are_for_space() -> None:
    with pytest.raises(ConfigError, match="of the plane"):
        build_map(LOG, 0.1, sensor=BeamSensor(mark_z_min=0.0))


@pytest.mark.parametrize(("section", "name", "kind"), FIELDS)
def test_types(section: str, name: str, kind: str) -> None:
    wrong: list[Any] = [[], {}, 1 + 2j]
    wrong += [] if kind == "bool" else [True]
    wrong += [] if kind == "str" else ["far"]
    wrong += [] if kind.startswith("float") else [0.5, 1]
    wrong += [] if "None" in kind else [None]
    for value in wrong:
        with pytest.raises(ConfigError, match=f"file.toml: {section}.{name} is "):
            resolve(("file.toml", {section: {name: value}}))


def test_whole_numbers_are_numbers() -> None:
    assert resolve(("a", {"map": {"resolution": 1}, "sensor": {"range_max": 30}})) == Config(
        map=MapConfig(resolution=1.0), sensor=BeamSensor(range_max=30.0)
    )


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"sensr": {}}, '"sensr"; did you mean "sensor"'),
        ({"sensor": {"range_mx": 3.0}}, '"range_mx"; did you mean "range_max"'),
        ({"map": {"votse": "beam"}}, '"votse"; did you mean "votes"'),
        ({"posterior": {"priors": 0.5}}, '"priors"; did you mean "prior"'),
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
    for content in (b"[map", b"a = 1\na = 2", b"\xff\xfe"):
        file.write_bytes(content)
        with pytest.raises(ConfigError, match=r"a\.toml: not a TOML file"):
            read_toml(file)
    for path in (tmp_path / "none.toml", tmp_path):
        with pytest.raises(ConfigError, match="cannot be read"):
            read_toml(path)


def test_configurations_are_frozen() -> None:
    for section, name, _ in FIELDS:
        value = {"map": MapConfig(resolution=1.0)}.get(section) or SECTIONS[section]()
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(value, name, 0.3)
        assert not hasattr(value, "__dict__")
