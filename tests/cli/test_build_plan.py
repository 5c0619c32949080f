# SPDX-License-Identifier: Apache-2.0
"""What `oddsmap build` refuses before it opens a log: the logs of these tests do not exist."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import typer

from oddsmap.cli.build_plan import BuildPlan, MapSettings
from oddsmap.errors import ConfigError
from tests.cli.conftest import Run


def plan(tmp_path: Path, *settings: str) -> BuildPlan:
    return BuildPlan(
        logs=[],
        output=tmp_path / "m.zarr",
        settings=MapSettings(resolution=0.1, settings=list(settings)),
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--sensor", "radar"],
            'not available, did you mean "lidar2d" or "lidar3d"? (known',
        ),
        (["--sweeps", "3"], "--sweeps belongs to --estimator full-map"),
        (["--estimator", "full-map", "--votes", "scan"], "--votes belongs to --estimator filter"),
        (
            ["--estimator", "full-map", "--method", "projective"],
            "--method projective belongs to --estimator filter",
        ),
        (["--set", "nonsense"], "section.field=value"),
        (["--set", "sensor.kind=laser"], "is one of beam, cone, overhead, got 'laser'"),
        (["--set", "full_map.sweeps=3"], "the filter would not look at it"),
        (["--config", "missing.toml"], "missing.toml: cannot be read"),
        (["--hold-out", "0.6"], "--hold-out 0.6: the share of scans kept back"),
        (["--camera", "1 2 3"], "fx fy cx cy width height"),
    ],
)
def test_refused(run: Run, tmp_path: Path, words: list[str], message: str) -> None:
    out = tmp_path / "m.zarr"
    assert message in run("build", "gone.log", "--resolution", 0.1, "-o", out, *words).line
    assert "gone.log: no such file" in run("build", "gone.log", "--resolution", 0.1, "-o", out).line


def test_the_output(run: Run, tmp_path: Path) -> None:
    log = tmp_path / "empty.log"
    log.touch()
    words = ("build", log, "--resolution", 0.1, "-o")
    assert "oddsmap export makes .png of it" in run(*words, tmp_path / "m.png").line
    assert "does not exist" in run(*words, tmp_path / "none" / "m.zarr").line
    out = tmp_path / "m.zarr"
    out.mkdir()
    assert "exists already" in run(*words, out).line
    assert "the file is empty" in run(*words, out, "--force").line


def test_a_map_needs_a_resolution(run: Run, tmp_path: Path) -> None:
    done = run("build", "gone.log", "-o", tmp_path / "m.zarr")
    assert done.status == 2
    assert "Invalid value for --resolution: a map needs one, in metres" in done.err
    with pytest.raises(typer.BadParameter):
        BuildPlan(logs=[], output=tmp_path / "m.zarr")
    toml = tmp_path / "map.toml"
    toml.write_text("[map]\nresolution = 0.2\n")
    for settings in (MapSettings(config=toml), MapSettings(settings=["map.resolution=0.2"])):
        assert BuildPlan(logs=[], output=tmp_path / "m.zarr", settings=settings).layers


def test_the_file_is_read_once(tmp_path: Path) -> None:
    toml = tmp_path / "map.toml"
    toml.write_text("[map]\nresolution = 0.2\n")
    made = BuildPlan(logs=[], output=tmp_path / "m.zarr", settings=MapSettings(config=toml))
    toml.unlink()
    assert made.layers.fields("map") == {"resolution"}


def test_a_plan_that_was_changed_is_checked_again(tmp_path: Path) -> None:
    made = plan(tmp_path, "posterior.prior=0.4")
    assert made.hold_out_every is None
    assert replace(made, hold_out=0.1).hold_out_every == 10
    with pytest.raises(ConfigError, match="a full map would not look at it"):
        replace(made, estimator="full-map")


def test_settings_in_layers(tmp_path: Path) -> None:
    settings = MapSettings(
        resolution=0.1, votes="beam", sensor="tof", range_max=9.0, clear_range=4.0,
        settings=["sensor.range_max=8"],
    )  # fmt: skip
    layers = settings.layers()
    assert list(layers) == [
        ("options", {"map": {"resolution": 0.1, "votes": "beam"}}),
        ("options", {"sensor": {"range_max": 9.0, "clear_range": 4.0, "kind": "cone"}}),
        ("options", {"full_map": {}}),
        ("--set sensor.range_max=8", {"sensor": {"range_max": 8}}),
    ]
