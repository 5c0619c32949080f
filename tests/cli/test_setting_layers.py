# SPDX-License-Identifier: Apache-2.0
"""Layers of settings, and the configuration that they make with a log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from oddsmap.cli.setting_layers import SettingLayers, read_layers
from oddsmap.config.config import Config, MapConfig
from oddsmap.errors import ConfigError
from oddsmap.readers import open_log
from oddsmap.scans.log import Log
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor


@pytest.fixture
def wide(tmp_path: Path) -> Log:
    """A log of one wide beam."""
    path = tmp_path / "wide.npz"
    np.savez(path, beams=np.array([[0.0, 0.0, 0.0, 1.0]]), cone_deg=20.0, range_max=3.0)
    return open_log(path)


def layers(*settings: str) -> SettingLayers:
    return read_layers(None, ["map.resolution=0.1", *settings])


def test_the_strongest_is_last(tmp_path: Path) -> None:
    toml = tmp_path / "a.toml"
    toml.write_text('[sensor]\nkind = "cone"\n')
    options = {"sensor": {"range_max": 3.0, "clear_range": None}}
    made = read_layers(toml, ["sensor.kind=beam"], options)
    assert [where for where, _ in made] == [str(toml), "options", "--set sensor.kind=beam"]
    assert made.fields("sensor") == {"kind", "range_max"}
    assert made.fields("map") == set()
    assert made.sensor_kind() == "beam"
    assert read_layers(toml, None).sensor_kind() == "cone"
    assert read_layers(None, None).sensor_kind() is None


def test_what_a_log_says_is_the_weakest(wide: Log) -> None:
    assert layers().resolve(wide).sensor == ConeSensor(cone_deg=20.0, range_max=3.0)
    narrower = layers("sensor.cone_deg=5").resolve(wide)
    assert narrower.sensor == ConeSensor(cone_deg=5, range_max=3.0)
    axes = layers("sensor.kind=beam").resolve(wide)
    assert axes.sensor == BeamSensor(range_max=3.0)


def test_above_the_configuration_of_a_map(wide: Log) -> None:
    stored = Config(map=MapConfig(resolution=0.2), sensor=ConeSensor(cone_deg=30.0, p_random=0.2))
    assert read_layers(None, []).resolve_above(stored, wide) == stored
    made = read_layers(None, ["sensor.p_random=0.1"]).resolve_above(stored, wide)
    assert made.sensor == ConeSensor(cone_deg=30.0, p_random=0.1)
    # Another kind of sensor has nothing of the map's: it is as the log says.
    made = read_layers(None, ["sensor.kind=beam"]).resolve_above(stored, wide)
    assert (made.map, made.sensor) == (stored.map, BeamSensor(range_max=3.0))


@pytest.mark.parametrize("kind", ["laser", "5", '["beam"]'])
def test_an_unknown_kind_of_sensor(kind: str) -> None:
    with pytest.raises(ConfigError, match=r"--set sensor\.kind=.*is one of beam, cone, overhead"):
        layers(f"sensor.kind={kind}")


def test_sections_that_a_command_does_not_look_at(tmp_path: Path) -> None:
    layers().check_sections("score", "map", "sensor")
    with pytest.raises(ConfigError, match=r"oddsmap score does not look at map\.\*, only at s"):
        layers().check_sections("score", "sensor")
    toml = tmp_path / "a.toml"
    toml.write_text("[map]\nresolution = 1\n")
    read_layers(toml, None).check_sections("score", "sensor")


def test_settings_of_the_other_estimator() -> None:
    prior, coupling = layers("posterior.prior=0.4"), layers("full_map.coupling=1")
    prior.check_estimator("filter")
    coupling.check_estimator("full-map")
    with pytest.raises(ConfigError, match=r"posterior\.prior belongs to --estimator filter"):
        prior.check_estimator("full-map")
    with pytest.raises(ConfigError, match=r"full_map\.coupling belongs to --estimator full-map"):
        coupling.check_estimator("filter")
