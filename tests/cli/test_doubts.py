# SPDX-License-Identifier: Apache-2.0
"""Settings that do not fit a log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from oddsmap.cli.doubts import doubt_of_estimator, doubt_of_sensor, doubts_of_settings
from oddsmap.cli.setting_layers import read_layers
from oddsmap.readers import open_log
from oddsmap.scans.log import Log
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor


@pytest.fixture
def wide(tmp_path: Path) -> Log:
    """A log of one beam, 20 degrees wide, that reaches 3 m."""
    path = tmp_path / "wide.npz"
    np.savez(path, beams=np.array([[0.0, 0.0, 0.0, 1.0]]), cone_deg=20.0, range_max=3.0)
    return open_log(path)


@pytest.mark.parametrize(
    ("settings", "starts"),
    [
        ([], []),
        (["sensor.range_max=2"], []),
        (["sensor.range_max=4"], ["range_max 4 is above the 3 m that this log writes"]),
        (["sensor.kind=beam"], ["beams are 20 degrees wide, sensor.kind beam maps their axes"]),
        (
            ["sensor.body_min=[-1,-1]", "sensor.body_max=[1,1]"],
            ["sensor.body_min is in the sensor frame, and this log has the directions of its"],
        ),
        (["sensor.kind=beam", "sensor.angle_max=1"], ["beams are 20", "sensor.angle_max is in"]),
        (["sensor.kind=beam", "sensor.range_max=4"], ["beams are 20", "range_max 4 is above"]),
    ],
)
def test_of_settings(wide: Log, settings: list[str], starts: list[str]) -> None:
    config = read_layers(None, ["map.resolution=1", *settings]).resolve(wide)
    found = doubts_of_settings(wide, config)
    assert len(found) == len(starts)
    assert all(doubt.startswith(start) for doubt, start in zip(found, starts, strict=True))


@pytest.mark.parametrize(
    ("settings", "estimator", "names"),
    [
        (["sensor.sigma=0.1", "sensor.detection=0.9"], "filter", "sensor.detection, sensor.sigma"),
        (["sensor.sigma=0.1", "sensor.detection=0.9"], "full-map", None),
        (["sensor.cone_deg=30", "sensor.p_hit=0.8"], "filter", None),
        (["sensor.sigma=0.1", "sensor.kind=beam"], "filter", None),
    ],
)
def test_of_the_estimator(
    wide: Log, settings: list[str], estimator: str, names: str | None
) -> None:
    """The filter takes less from a sensor of wide beams than calibration finds."""
    layers = read_layers(None, ["map.resolution=1", *settings])
    doubt = doubt_of_estimator(layers, layers.resolve(wide), estimator)
    assert (doubt is None) == (names is None)
    if doubt is not None:
        assert doubt.startswith(f"the filter does not look at {names} of wide beams")
        assert "--estimator full-map" in doubt


def test_of_the_sensor_that_a_map_was_made_with(wide: Log) -> None:
    nothing, asked = read_layers(None, []), read_layers(None, ["sensor.cone_deg=40"])
    assert doubt_of_sensor(wide, ConeSensor(cone_deg=29.0), nothing) is None
    doubt = doubt_of_sensor(wide, ConeSensor(cone_deg=31.0), nothing)
    assert doubt is not None
    assert (
        "its beams are 20 degrees wide (sensor.kind cone), those of the map's sensor are" in doubt
    )
    assert "are 31 degrees wide (sensor.kind cone)" in doubt
    assert doubt_of_sensor(wide, ConeSensor(cone_deg=40.0), asked) is None
    narrow = doubt_of_sensor(wide, BeamSensor(), nothing)
    assert narrow is not None
    assert "those of the map's sensor are narrow (sensor.kind beam)" in narrow
    assert doubt_of_sensor(wide, BeamSensor(), read_layers(None, ["sensor.kind=beam"])) is None
