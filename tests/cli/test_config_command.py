# SPDX-License-Identifier: Apache-2.0
"""`oddsmap config`: every field there is, from its declaration, as a file for --config."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path

import pytest

from oddsmap.cli.setting_fields import all_fields, set_fields
from oddsmap.config.config import Config, MapConfig, PosteriorConfig, read_toml
from oddsmap.config.full_map import FullMapConfig
from oddsmap.sensors.beam import BeamSensor
from oddsmap.sensors.cone import ConeSensor
from oddsmap.sensors.registry import KINDS, NAMES
from tests.cli.conftest import Run


def names_of(section: str, kind: str | None = None) -> list[str]:
    return [f.name for f in all_fields() if (f.section, f.kind) == (section, kind)]


def test_all_fields_with_a_meaning() -> None:
    for section, holder in (
        ("map", MapConfig), ("posterior", PosteriorConfig), ("full_map", FullMapConfig)
    ):  # fmt: skip
        assert names_of(section) == [field.name for field in dataclasses.fields(holder)]
    for kind, sensor in KINDS.items():
        assert names_of("sensor", kind) == [field.name for field in dataclasses.fields(sensor)]
    for field in all_fields():
        assert len(field.meaning) > 10, field
        assert not {"None", "True", "False"} & set(field.meaning.replace(":", "").split()), field


def test_units_and_defaults() -> None:
    of = {(f.section, f.kind, f.name): f for f in all_fields()}
    resolution = of["map", None, "resolution"]
    assert (resolution.unit, resolution.required, resolution.default) == ("m", True, None)
    assert of["map", None, "half_life"].unit == "s"
    assert of["map", None, "t_ref_ns"].unit == "ns"
    assert of["sensor", "cone", "cone_deg"].unit == "deg"
    assert of["full_map", None, "tolerance"].unit == "nats"
    assert of["full_map", None, "coupling"].unit is None
    assert of["sensor", "beam", "p_hit"].default == BeamSensor().p_hit
    assert of["sensor", "cone", "share_hit"].default is True
    assert of["full_map", None, "method"].default == "sum-product"


def test_it_is_a_file_that_changes_nothing(run: Run, tmp_path: Path) -> None:
    done = run("config")
    assert done.status == 0
    assert [line for line in done.out.splitlines() if len(line) > 79] == []
    assert tomllib.loads(done.out) == {"map": {}, "sensor": {}, "posterior": {}, "full_map": {}}
    (tmp_path / "all.toml").write_text(done.out)
    assert set(read_toml(tmp_path / "all.toml")) == {"map", "sensor", "posterior", "full_map"}


@pytest.mark.parametrize("name", NAMES)
def test_without_its_marks_it_is_the_default(run: Run, name: str) -> None:
    page = run("config", "--sensor", name).out
    lines = [line.removeprefix("#") for line in page.splitlines() if not line.startswith("# ")]
    values = tomllib.loads("\n".join(line for line in lines if not line.endswith(" =")))
    needed = {"cone_deg": 20.0} if NAMES[name] == "cone" else {}
    made = Config.from_dict(
        {**values, "map": {**values["map"], "resolution": 0.1},
         "sensor": {**values["sensor"], **needed}}, "page",
    )  # fmt: skip
    assert made.sensor == KINDS[NAMES[name]](**needed)
    assert made.full_map == FullMapConfig()
    assert made.posterior == PosteriorConfig()


def test_one_section_and_one_field(run: Run) -> None:
    page = run("config", "posterior").out
    assert "#free = 0.196" in page
    assert "[map]" not in page
    page = run("config", "sensor.cone_deg").out
    assert "# Full opening angle [deg], up to 180. Required: here, or by what the log" in page
    assert "#cone_deg =\n" in page
    assert "range_max" not in page
    (field,) = run("config", "map.half_life", "--json").json["fields"]
    assert (field["unit"], field["default"]) == ("s", None)
    assert 'did you mean "sensor.cone_deg"?' in run("config", "sensor.cone_degg").line
    assert "(sections: map, sensor, posterior, full_map)" in run("config", "q").line
    assert "no such section or field" in run("config", "sensor.cone_deg", "--sensor", "depth").line
    assert 'did you mean "lidar2d" or "lidar3d"?' in run("config", "--sensor", "lidar").line


def test_what_is_not_the_default() -> None:
    sensor = ConeSensor(cone_deg=20.0, share_hit=False)
    made = Config(map=MapConfig(resolution=0.1), sensor=sensor)
    assert set_fields(made.to_dict()) == {
        "map.resolution": 0.1, "sensor.kind": "cone", "sensor.cone_deg": 20.0,
        "sensor.share_hit": False,
    }  # fmt: skip
