# SPDX-License-Identifier: Apache-2.0
"""Names of sensors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from oddsmap.cli.sensor_names import (
    check_width,
    may_be_called,
    sensor_name,
    sensor_names,
)
from oddsmap.cli.setting_layers import read_layers
from oddsmap.errors import ConfigError
from oddsmap.readers import open_log
from oddsmap.sensors.registry import KINDS
from tests.cli.conftest import Run

PLANE, SPACE = [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]


def test_each_kind_of_sensor_has_a_name(run: Run) -> None:
    names = sensor_names()
    assert set(names.values()) == set(KINDS)
    page = " ".join(run("build", "--help").out.split())
    *others, last = names
    assert f"{', '.join(others)} or {last};" in page


@pytest.mark.parametrize(
    ("arrays", "name"),
    [
        ({"beams": np.array([PLANE])}, "lidar2d"),
        ({"beams": np.array([PLANE]), "cone_deg": 20.0}, "sonar"),
        ({"beams": np.array([SPACE])}, "lidar3d"),
        ({"beams": np.array([SPACE]), "cone_deg": 20.0}, "tof"),
        (
            {"grids": np.zeros((1, 2, 2), np.bool_), "poses": np.zeros((1, 3)), "pixel": 1},
            "overhead",
        ),
    ],
)
def test_the_sensor_of_a_log(tmp_path: Path, arrays: dict[str, object], name: str) -> None:
    np.savez(tmp_path / "log.npz", **arrays)  # type: ignore[arg-type]
    log = open_log(tmp_path / "log.npz")
    config = read_layers(None, ["map.resolution=1"]).resolve(log)
    assert sensor_name(log, config) == name
    assert config.sensor.kind == sensor_names()[name]
    for stated in sensor_names():
        cones = {name, stated} == {"sonar", "tof"}
        assert may_be_called(name, stated) == (stated == name or cones)
        if "cone_deg" not in arrays or stated in ("sonar", "tof"):
            check_width(log, stated)
        else:
            with pytest.raises(ConfigError, match=f"--sensor {stated} would lose that"):
                check_width(log, stated)
    check_width(log, None)
