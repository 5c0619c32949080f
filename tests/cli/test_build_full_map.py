# SPDX-License-Identifier: Apache-2.0
"""`oddsmap build --estimator full-map`, and what info and export make of its maps."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import oddsmap
from oddsmap.config.full_map import FullMapConfig
from oddsmap.full_map.estimator import build_full_map
from oddsmap.full_map.full_map import load_full_map
from oddsmap.maps.voxel_map import load_octomap
from oddsmap.poses.pose import Pose2
from oddsmap.sensors.cone import ConeSensor
from tests.cli.conftest import Run
from tests.full_map.kit import room, same, wall_of_space

FULL = ("--resolution", 0.1, "--estimator", "full-map")


@pytest.fixture(scope="module")
def sonar(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The room of the kit as an NPZ beam log."""
    beams = []
    for scan in room(60):
        pose = scan.map_from_sensor
        assert isinstance(pose, Pose2)
        headings = pose.theta + np.arctan2(scan.directions[:, 1], scan.directions[:, 0])
        z = np.minimum(scan.ranges, 3.0)
        beams.append(np.stack([np.full(12, pose.x), np.full(12, pose.y), headings, z], axis=1))
    path = tmp_path_factory.mktemp("logs") / "sonar.npz"
    np.savez(
        path, beams=np.concatenate(beams), cone_deg=25.0, range_max=3.0, p_random=0.02,
        p_dropout=0.03,
    )  # fmt: skip
    return path


@pytest.fixture(scope="module")
def tof(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A 3D wall as an NPZ beam log."""
    beams = [
        np.column_stack(
            [
                np.tile(scan.map_from_sensor.translation, (scan.size, 1)),
                scan.directions,
                scan.ranges,
            ]
        )
        for scan in wall_of_space(2.0, 60)
    ]
    path = tmp_path_factory.mktemp("logs") / "tof.npz"
    np.savez(path, beams=np.concatenate(beams), cone_deg=8.0, range_max=4.0)
    return path


@pytest.fixture(scope="module")
def flat_map(sonar: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("maps") / "flat.zarr"
    build_full_map(oddsmap.open_log(sonar), 0.1).save(path)
    return path


@pytest.fixture(scope="module")
def space_map(tof: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("maps") / "space.zarr"
    build_full_map(oddsmap.open_log(tof), 0.1).save(path)
    return path


def test_a_sonar_log(run: Run, sonar: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.zarr"
    done = run("build", sonar, *FULL, "-o", out, "--json", "--threads", 2)
    assert done.status == 0
    facts = done.json
    assert set(facts) == {
        "output", "resolution", "estimator", "method", "sweeps", "residual", "converged", "hits",
        "passes",
        "cells_known", "area_m2", "bytes_in_memory", "bytes_on_disk", "scans", "beams", "skipped",
        "read_s", "threads", "integrate_s", "compile_s",
    }  # fmt: skip
    assert (facts["estimator"], facts["beams"], facts["threads"]) == ("full-map", 720, 2)
    assert (facts["hits"], facts["passes"]) == (None, None)
    assert facts["converged"] is True
    assert facts["residual"] < 2e-3
    grid = load_full_map(out)
    assert facts["cells_known"] == grid.cell_count > 2000
    assert facts["area_m2"] == pytest.approx(0.01 * grid.cell_count)
    assert facts["bytes_in_memory"] == grid.nbytes
    assert facts["bytes_on_disk"] == sum(
        file.stat().st_size for file in out.rglob("*") if file.is_file()
    )
    # The same as from Python, with what the log says of its sensor.
    assert grid.config.sensor == ConeSensor(
        cone_deg=25.0, range_max=3.0, p_random=0.02, p_dropout=0.03
    )
    assert same(grid, build_full_map(oddsmap.open_log(sonar), 0.1))
    assert grid.provenance[0]["source"] == "sonar.npz"


def test_words(run: Run, sonar: Path, tmp_path: Path) -> None:
    done = run("build", sonar, *FULL, "-o", tmp_path / "m.zarr")
    assert done.status == 0
    assert "720 beams" in done.out
    assert "messages at rest (residual " in done.out
    assert f"oddsmap export {tmp_path / 'm.zarr'} " in done.out


@pytest.mark.parametrize(
    ("method", "message"),
    [
        ("gibbs", "sweeps   3, marginals NOT at rest: more full_map.samples may be needed (resid"),
        ("map", "cells at rest (residual 0)"),
    ],
)
def test_other_methods(run: Run, sonar: Path, tmp_path: Path, method: str, message: str) -> None:
    out = tmp_path / "m.zarr"
    sets = ("--set", f"full_map.method={method}", "--set", "full_map.samples=3")
    done = run("build", sonar, *FULL, *sets, "-o", out)
    assert done.status == 0
    assert message in done.out
    settings = FullMapConfig(method=method, samples=3)
    assert same(load_full_map(out), build_full_map(oddsmap.open_log(sonar), 0.1, settings=settings))
    assert run("info", out, "--json").json["method"] == method
    assert run("export", out, tmp_path / "m.png").status == 0


def test_not_at_rest(run: Run, sonar: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.zarr"
    done = run("build", sonar, *FULL, "--sweeps", 1, "-o", out)
    assert done.status == 0
    assert "sweeps   1, messages NOT at rest: more --sweeps may be needed (residual " in done.out
    assert not load_full_map(out).converged
    assert "converged    False" in run("info", out).out
    assert run("export", out, tmp_path / "m.png").status == 0
    again = run("build", sonar, *FULL, "--sweeps", 1, "-o", out, "--force", "--json").json
    assert (again["sweeps"], again["converged"]) == (1, False)


def test_settings(run: Run, sonar: Path, tmp_path: Path) -> None:
    out, toml = tmp_path / "m.zarr", tmp_path / "a.toml"
    toml.write_text('[full_map]\nschedule = "sequential"\nsweeps = 9\n[sensor]\nsigma = 0.05\n')
    words = ("--config", toml, "--sweeps", 3, "--set", "full_map.coupling=0.5")
    assert run("build", sonar, *FULL, *words, "-o", out).status == 0
    config = load_full_map(out).config
    assert config.full_map == FullMapConfig(schedule="sequential", sweeps=3, coupling=0.5)
    assert isinstance(config.sensor, ConeSensor)
    assert (config.sensor.sigma, config.sensor.p_dropout) == (0.05, 0.03)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--set", "sensor.p_random=0"), "sensor.p_random lies above 0"),
        (("--set", "full_map.prior=1"), "full_map.prior lies between 0 and 1, got 1"),
        (("--set", "full_map.swep=1"), 'is called "swep", did you mean "sweeps"'),
        (("--set", "sensor.cone_deg=200"), "up to 180 degrees, got 200"),
        (("--set", "map.half_life=9"), "map.half_life is for the filter"),
        (("--set", "sensor.mark_z_min=0.1"), "sensor.mark_z_min is for the filter"),
        (("--method", "projective"), "--method projective belongs to --estimator filter"),
        (
            ("--set", "posterior.prior=0.5"),
            "--set posterior.prior=0.5: posterior.prior belongs to --estimator filter, a full map "
            "would not look at it: set full_map.prior",
        ),
    ],
)
def test_refused(
    run: Run, sonar: Path, tmp_path: Path, words: tuple[str, ...], message: str
) -> None:
    out = tmp_path / "m.zarr"
    assert message in run("build", sonar, *FULL, *words, "-o", out).line
    assert not out.exists()


def test_sweeps_are_of_the_full_map(run: Run, sonar: Path, tmp_path: Path) -> None:
    words = ("--resolution", 0.1, "--sweeps", 4, "-o", tmp_path / "m.zarr")
    assert "--sweeps belongs to --estimator full-map" in run("build", sonar, *words).line


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("full_map.coupling=0.8", "full_map.coupling belongs to --estimator full-map, the filter "
         "would not look at it: leave it out, or add --estimator full-map"),
        ("full_map.prior=0.2", "set posterior.prior for the filter, or add --estimator full-map"),
    ],
)  # fmt: skip
def test_settings_of_the_full_map_are_not_the_filters(
    run: Run, sonar: Path, tmp_path: Path, setting: str, message: str
) -> None:
    out, toml = tmp_path / "m.zarr", tmp_path / "a.toml"
    words = ("build", sonar, "--resolution", 0.1, "-o", out)
    line = run(*words, "--set", setting).line
    assert line.startswith(f"--set {setting}: full_map.")
    assert message in line
    name, value = setting.removeprefix("full_map.").split("=")
    toml.write_text(f"[full_map]\n{name} = {value}\n")
    line = run(*words, "--config", toml).line
    assert line.startswith(f"{toml}: full_map.")
    assert message in line
    assert not out.exists()
    # What both estimators look at, and a section with nothing in it, are no mistakes.
    toml.write_text("[full_map]\n[posterior]\noccupied = 0.7\n")
    assert run(*words, "--config", toml, "--set", "posterior.prior=0.4").status == 0
    assert run(*words, "--estimator", "full-map", "--config", toml, "--force").status == 0
    assert load_full_map(out).thresholds.occupied == 0.7


def test_a_pose_far_off_spoils_no_map(run: Run, sonar: Path, tmp_path: Path) -> None:
    """Mapped where it says it is, or skipped and counted where no precision is left there."""
    with np.load(sonar) as arrays:
        beams, remainder = arrays["beams"], {k: v for k, v in arrays.items() if k != "beams"}
    for metres, skipped in ((1e9, {}), (1e13, {"scan.pose_too_far": 1})):
        log, out = tmp_path / f"{metres:g}.npz", tmp_path / f"{metres:g}.zarr"
        np.savez(log, beams=np.concatenate([beams, [[metres, 0.0, 0.0, 1.0]]]), **remainder)
        facts = run("build", log, *FULL, "-o", out, "--json").json
        assert facts["skipped"] == skipped
        assert facts["beams"] == 720 + (not skipped)
        filtered = run("build", log, "--resolution", 0.1, "-o", tmp_path / "f.zarr", "--force",
                       "--json").json  # fmt: skip
        assert (filtered["skipped"], filtered["beams"]) == (skipped, facts["beams"])
        _, hi = load_full_map(out).bounds() or (np.zeros(2), np.zeros(2))
        assert (hi[0] > 1e9) == (not skipped)
        scored = run("score", out, log, "--json").json
        assert (scored["skipped"], scored["beams"]) == (skipped, facts["beams"])


def test_a_log_of_grids_is_refused(run: Run, tmp_path: Path) -> None:
    path, out = tmp_path / "grids.npz", tmp_path / "m.zarr"
    np.savez(path, grids=np.zeros((1, 3, 4), np.bool_), poses=np.zeros((1, 3)), pixel=0.1)
    assert "a sensor of kind overhead" in run("build", path, *FULL, "-o", out).line
    assert not out.exists()


def test_a_log_without_range_max_is_refused(run: Run, tmp_path: Path) -> None:
    path, out = tmp_path / "bare.npz", tmp_path / "m.zarr"
    np.savez(path, beams=np.array([[0.0, 0.0, 0.0, 1.0]]), cone_deg=20.0)
    assert "sensor.range_max is needed by the forward model" in (
        run("build", path, *FULL, "-o", out).line
    )
    assert not out.exists()
    assert run("build", path, *FULL, "-o", out, "--range-max", 3).status == 0


def test_logs_that_disagree_of_their_sensor(run: Run, sonar: Path, tmp_path: Path) -> None:
    other, out = tmp_path / "other.npz", tmp_path / "m.zarr"
    with np.load(sonar) as arrays:
        np.savez(other, **{**arrays, "cone_deg": 30.0})
    assert "say different things of their sensor" in (
        run("build", sonar, other, *FULL, "-o", out).line
    )
    words = ("--set", "sensor.cone_deg=25", "--json")
    assert run("build", sonar, other, *FULL, *words, "-o", out).json["beams"] == 1440


def test_an_old_map_stays_until_the_new_one_is_there(
    run: Run, sonar: Path, flat_map: Path, tmp_path: Path
) -> None:
    out = tmp_path / "m.zarr"
    load_full_map(flat_map).save(out)
    assert "exists already" in run("build", sonar, *FULL, "-o", out).line
    assert same(load_full_map(out), load_full_map(flat_map))


def test_info(run: Run, flat_map: Path, space_map: Path) -> None:
    facts = run("info", flat_map, "--json").json
    grid = load_full_map(flat_map)
    assert (facts["estimator"], facts["cells known"]) == ("full-map", grid.cell_count)
    assert (facts["sweeps"], facts["converged"]) == (grid.sweeps, True)
    assert facts["config"]["full_map"]["sweeps"] == 40
    assert set(facts) > {"x [m]", "y [m]"}
    assert "z [m]" in run("info", space_map, "--json").json


def test_info_has_the_prior_that_the_dimension_chose(
    run: Run, sonar: Path, flat_map: Path, space_map: Path, tmp_path: Path
) -> None:
    for path, prior, coupling in ((flat_map, 0.475, 0.8), (space_map, 0.1, 0.4)):
        (entry,) = run("info", path, "--json").json["made from"]
        assert (entry["prior"], entry["coupling"]) == (prior, coupling)
        lines = [line.strip() for line in run("info", path).out.splitlines()]
        assert f"prior {prior}" in lines
        assert f"coupling {coupling}" in lines
    own = tmp_path / "own.zarr"
    run("build", sonar, *FULL, "--set", "full_map.prior=0.3", "-o", own)
    (entry,) = run("info", own, "--json").json["made from"]
    assert (entry["prior"], entry["coupling"]) == (0.3, 0.8)


def test_export_of_the_plane(run: Run, flat_map: Path, tmp_path: Path) -> None:
    grid = load_full_map(flat_map)
    for name in ("m.png", "m.yaml", "m.npz"):
        assert run("export", flat_map, tmp_path / name).status == 0
        assert (tmp_path / name).stat().st_size > 0
    ros = oddsmap.load_ros(tmp_path / "m.yaml")
    lo, hi = grid.bounds() or (np.zeros(2), np.zeros(2))
    assert ros.observed.shape == tuple((hi - lo)[::-1])
    occupied = grid.state() == oddsmap.State.OCCUPIED
    np.testing.assert_array_equal((ros.probability > 0.9) & ros.observed, occupied)
    with np.load(tmp_path / "m.npz") as arrays:
        assert np.count_nonzero(arrays["observed"]) == grid.cell_count
        assert len(arrays["observed"]) > grid.cell_count
        assert not arrays["hits"].any()
    for name in ("m.ply", "m.bt"):
        assert "this one is 2D" in run("export", flat_map, tmp_path / name).line


def test_export_of_space(run: Run, space_map: Path, tmp_path: Path) -> None:
    grid = load_full_map(space_map)
    for name in ("m.ply", "m.bt", "m.ot", "m.npz"):
        assert run("export", space_map, tmp_path / name).status == 0
    index, p = grid.cells()
    back = load_octomap(tmp_path / "m.ot")
    assert back.cell_count == len(index)
    picture = tmp_path / "m.png"
    assert "say which heights" in run("export", space_map, picture).line
    assert run("export", space_map, picture, "--z-min", -0.3, "--z-max", 0.3).status == 0
    assert picture.stat().st_size > 0
    assert math.isclose(back.resolution, 0.1)
    assert np.count_nonzero(p > 0.5) > 50


@pytest.mark.parametrize("option", ["--prior", "--p-hit", "--p-miss"])
def test_a_full_map_has_no_counts_to_look_at_anew(
    run: Run, flat_map: Path, tmp_path: Path, option: str
) -> None:
    value = 0.4 if option == "--p-miss" else 0.6
    line = run("export", flat_map, tmp_path / "m.png", option, value).line
    assert "a full map has no counts" in line


def test_a_full_map_is_no_reflection_map(run: Run, flat_map: Path, tmp_path: Path) -> None:
    words = ("export", flat_map, tmp_path / "m.png", "--posterior", "reflection")
    assert "needs hits and passes" in run(*words).line


def test_the_posterior_of_a_full_map_by_its_name(run: Run, flat_map: Path, tmp_path: Path) -> None:
    words = ("--posterior", "full-map", "--occupied", 0.8, "--free", 0.1)
    assert run("export", flat_map, tmp_path / "a.yaml", *words).status == 0
    assert run("export", flat_map, tmp_path / "b.yaml", *words[2:]).status == 0
    assert (tmp_path / "a.pgm").read_bytes() == (tmp_path / "b.pgm").read_bytes()
    grid = oddsmap.EvidenceMap(0.1)
    grid.add(oddsmap.Scan.from_angles((0.0, 0.0, 0.0), [0.0], [1.0]))
    grid.save(tmp_path / "filter.zarr")
    line = run("export", tmp_path / "filter.zarr", tmp_path / "c.yaml", *words).line
    assert "not a full map" in line
    assert "oddsmap build LOG --estimator full-map makes one" in line
