# SPDX-License-Identifier: Apache-2.0
"""`oddsmap build`: what scripts may rely on, and every way to fail."""

from __future__ import annotations

import bz2
import gzip
from pathlib import Path

import numpy as np
import pytest

import oddsmap
from tests.cli.conftest import Run, folder_bytes


def test_summary_as_json(run: Run, office: Path, tmp_path: Path) -> None:
    out = tmp_path / "office.zarr"
    facts = run("build", office, "--resolution", 0.05, "--threads", 2, "--json", "-o", out).json
    grid = oddsmap.load_map(out)
    _, hits, passes = grid.cells()
    assert facts["scans"] == 20
    no_return = facts["skipped"]["beam.no_return"]
    assert no_return > 0
    assert facts["beams"] + no_return == 20 * 180
    assert facts["hits"] == hits.sum() / 65536
    assert facts["passes"] == passes.sum() / 65536
    assert facts["cells_known"] == len(hits)
    assert facts["bytes_in_memory"] > 2 * len(hits)
    assert facts["bytes_on_disk"] == sum(map(len, folder_bytes(out).values()))
    assert facts["threads"] == 2
    for name in ("integrate_s", "compile_s", "read_s"):
        assert facts[name] >= 0


def test_summary_in_words(run: Run, office: Path, tmp_path: Path) -> None:
    out = tmp_path / "office.zarr"
    done = run("build", office, "--resolution", 0.1, "-o", out)
    assert done.status == 0
    for part in ("20 scans", "beam.no_return", "square metres", str(out), "oddsmap export"):
        assert part in done.out


def test_equals_python(run: Run, office: Path, tmp_path: Path) -> None:
    out = tmp_path / "office.zarr"
    run("build", office, "--resolution", 0.1, "--votes", "beam", "--clear-range", 3, "-o", out)
    log = oddsmap.open_log(office)
    sensor = oddsmap.BeamSensor(range_max=81.83, clear_range=3)
    grid = oddsmap.build_map(log, 0.1, votes="beam", sensor=sensor)
    for mine, theirs in zip(grid.cells(), oddsmap.load_map(out).cells(), strict=True):
        assert np.array_equal(mine, theirs)


def test_precedence(run: Run, office: Path, tmp_path: Path) -> None:
    toml = tmp_path / "lidar.toml"
    toml.write_text("[map]\nresolution = 0.2\n[sensor]\nrange_max = 5\np_hit = 0.8\n")
    first, second, third = (tmp_path / f"{i}.zarr" for i in range(3))
    run("build", office, "--config", toml, "-o", first)
    run("build", office, "--config", toml, "--range-max", 4, "-o", second)
    run("build", office, "--config", toml, "--set", "sensor.range_max=3", "-o", third)
    made = [oddsmap.load_map(path).config for path in (first, second, third)]
    assert [getattr(config.sensor, "range_max", None) for config in made] == [5, 4, 3]
    assert [config.sensor.p_hit for config in made] == [0.8] * 3
    assert [config.map.resolution for config in made] == [0.2] * 3


def test_several_logs_add_up(run: Run, office: Path, tmp_path: Path) -> None:
    one, two = tmp_path / "one.zarr", tmp_path / "two.zarr"
    run("build", office, "--resolution", 0.1, "-o", one)
    run("build", office, office, "--resolution", 0.1, "-o", two)
    _, hits, passes = oddsmap.load_map(one).cells()
    _, twice_hits, twice_passes = oddsmap.load_map(two).cells()
    assert np.array_equal(2 * hits, twice_hits)
    assert np.array_equal(2 * passes, twice_passes)
    assert [made["source"] for made in oddsmap.load_map(two).provenance] == ["office.log.gz"] * 2


@pytest.mark.parametrize("value", ["0", "-0.05", "nan", "inf"])
def test_resolution_must_be_a_length(run: Run, office: Path, tmp_path: Path, value: str) -> None:
    out = tmp_path / "x.zarr"
    line = run("build", office, f"--resolution={value}", "-o", out).line
    assert "map.resolution is a length above 0 m" in line
    assert not out.exists()


def test_resolution_too_fine_says_how_much_memory(run: Run, office: Path, tmp_path: Path) -> None:
    line = run("build", office, "--resolution", 1e-7, "-o", tmp_path / "x.zarr").line
    assert "GB of memory" in line
    assert "coarser resolution" in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "words",
    [
        ["--resolution", "fine"],
        [],
        ["--resolution", "0.1", "--votes", "all"],
        ["--resolution", "0.1", "--threads", "0"],
        ["--resolution", "0.1", "--unheard-of"],
    ],
)
def test_usage_errors_are_status_2(
    run: Run, office: Path, tmp_path: Path, words: list[str]
) -> None:
    done = run("build", office, "-o", tmp_path / "x.zarr", *words)
    assert done.status == 2
    assert "Error" in done.err
    assert done.out == ""


def test_existing_output_is_kept_without_force(run: Run, office: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.zarr"
    run("build", office, "--resolution", 0.2, "-o", out)
    before = folder_bytes(out)
    assert "--force" in run("build", office, "--resolution", 0.1, "-o", out).line
    assert folder_bytes(out) == before
    assert run("build", office, "--resolution", 0.1, "-o", out, "--force").status == 0
    assert oddsmap.load_map(out).resolution == 0.1
    assert [path.name for path in tmp_path.iterdir()] == ["x.zarr"]


def test_output_folder_must_exist(run: Run, office: Path, tmp_path: Path) -> None:
    line = run("build", office, "--resolution", 0.1, "-o", tmp_path / "no" / "x.zarr").line
    assert "does not exist" in line


@pytest.mark.parametrize("keep", [0.3, 0.9])
@pytest.mark.parametrize("packer", [gzip.compress, bz2.compress])
def test_truncated_container(
    run: Run, office: Path, tmp_path: Path, packer: object, keep: float
) -> None:
    assert callable(packer)
    whole = packer(gzip.decompress(office.read_bytes()))
    bad, out = tmp_path / "bad.log", tmp_path / "x.zarr"
    bad.write_bytes(whole[: int(keep * len(whole))])
    assert str(bad) in run("build", bad, "--resolution", 0.1, "-o", out).line
    assert not out.exists()


def test_skip_bad_uses_the_readable_part(run: Run, office: Path, tmp_path: Path) -> None:
    bad, out = tmp_path / "bad.log", tmp_path / "x.zarr"
    packed = office.read_bytes()
    bad.write_bytes(packed[: len(packed) // 2])
    facts = run("build", bad, "--resolution", 0.1, "-o", out, "--skip-bad", "--json").json
    assert facts["skipped"]["container.truncated"] == 1
    assert 0 < facts["scans"] < 20


def test_bad_lines_are_counted(run: Run, office: Path, tmp_path: Path) -> None:
    lines = gzip.decompress(office.read_bytes()).decode().splitlines()
    lasers = [i for i, line in enumerate(lines) if line.startswith("FLASER")]
    short = lines[lasers[0]].split()
    lines[lasers[0]] = " ".join(short[:2] + short[3:])
    for i, value in ((1, "nan"), (2, "inf")):
        fields = lines[lasers[i]].split()
        fields[2 + 180] = value
        lines[lasers[i]] = " ".join(fields)
    bad, out = tmp_path / "bad.log", tmp_path / "x.zarr"
    bad.write_text("\n".join(lines))
    facts = run("build", bad, "--resolution", 0.1, "-o", out, "--json").json
    assert facts["scans"] == 17
    assert facts["skipped"]["line.short"] == 1
    assert facts["skipped"]["scan.nan_pose"] == 2


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"ODOM 0 0 0 0 0 0 1 host 1\nPARAM a b\n", "no laser lines"),
        (b"\x89PNG\r\n\x1a\n", "unknown file type"),
        (b"", "empty"),
        (b"FLASER 2 1 1 nan 0 0 0 0 0 1 host 1\n", "scan.nan_pose"),
    ],
)
def test_nothing_usable(run: Run, tmp_path: Path, content: bytes, message: str) -> None:
    bad, out = tmp_path / "bad.log", tmp_path / "x.zarr"
    bad.write_bytes(content)
    line = run("build", bad, "--resolution", 0.1, "-o", out).line
    assert message in line
    assert str(bad) in line
    assert not out.exists()


def test_directory_and_missing_file(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "x.zarr"
    assert "no scans in this folder" in run("build", tmp_path, "--resolution", 0.1, "-o", out).line
    assert "no such file" in run("build", tmp_path / "n", "--resolution", 0.1, "-o", out).line


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--set", "sensor.rangemax=3"], 'did you mean "range_max"'),
        (["--set", "sesnor.range_max=3"], 'did you mean "sensor"'),
        (["--set", "sensor.range_max=far"], "is a number"),
        (["--set", "nonsense"], "section.field=value"),
        (["--sensor", "sonar"], "cone_deg"),
        (["--sweeps", "3"], "--estimator full-map"),
        (["--poses", __file__], "has poses"),
        (["--sensor", "lidar3d"], "the logs are of lidar2d"),
        (["--method", "projective"], "is for depth images"),
        (["--camera", "1 2 3"], "fx fy cx cy width height"),
        (["--camera", "500 500 320 240 nan 480"], "fx fy cx cy width height"),
        (["--config", "missing.toml"], "cannot be read"),
        (["--clear-range", "-1"], "sensor.clear_range"),
    ],
)
def test_settings_that_do_not_fit(
    run: Run, office: Path, tmp_path: Path, words: list[str], message: str
) -> None:
    out = tmp_path / "x.zarr"
    assert message in run("build", office, "--resolution", 0.1, "-o", out, *words).line
    assert not out.exists()


def test_a_failure_while_writing_keeps_the_old_map(
    run: Run, office: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from oddsmap.map_files.zarr_folder import NewFolder

    out = tmp_path / "x.zarr"
    run("build", office, "--resolution", 0.2, "-o", out)
    before = folder_bytes(out)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(NewFolder, "write", full)
    line = run("build", office, "--resolution", 0.1, "-o", out, "--force").line
    assert "No space left" in line
    assert folder_bytes(out) == before
    assert [path.name for path in tmp_path.iterdir()] == ["x.zarr"]


def test_npz_beam_log(run: Run, tmp_path: Path) -> None:
    beams = np.array([[0.5, 0.5, 0.0, 2.0], [0.5, 0.5, 1.5, 9.0]], np.float32)
    np.savez(tmp_path / "beams.npz", beams=beams, cone_deg=0.5, range_max=5.0)
    out = tmp_path / "x.zarr"
    facts = run("build", tmp_path / "beams.npz", "--resolution", 1, "-o", out, "--json").json
    assert (facts["scans"], facts["beams"], facts["hits"]) == (1, 2, 1)


def test_a_folder_of_clouds(run: Run, tmp_path: Path) -> None:
    clouds, out = tmp_path / "clouds", tmp_path / "x.zarr"
    clouds.mkdir()
    points = np.array([[1.55, 0.05, 0.05, 0.0], [0.05, 1.55, 1.05, 0.0]], np.float32)
    for i in range(2):
        points.tofile(clouds / f"{i:06d}.bin")
    poses = tmp_path / "poses.txt"
    poses.write_text("1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 5 0 1 0 0 0 0 1 0\n")
    words = ["build", clouds, "--resolution", 0.1, "-o", out, "--json"]
    assert "pose" in run(*words).line
    facts = run(*words, "--poses", poses, "--set", "sensor.mark_z_max=0.5").json
    assert (facts["scans"], facts["beams"], facts["hits"]) == (2, 4, 2)
    assert facts["skipped"] == {"hit.outside_heights": 2}
    assert facts["volume_m3"] > 0
    index, hits, _ = oddsmap.load_map(out).cells()
    assert {tuple(cell) for cell in index[hits > 0]} == {(15, 0, 0), (65, 0, 0)}
    moved = "0 0 0 0 0 0.7071067811865476 0.7071067811865476"  # a quarter turn to the left
    run(*words, "--poses", poses, "--body-from-sensor", moved, "--force")
    index, hits, _ = oddsmap.load_map(out).cells()
    assert (-1, 15, 0) in {tuple(cell) for cell in index[hits > 0]}


def test_a_doubtful_range_max_is_mentioned(run: Run, office: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.zarr"
    done = run("build", office, "--resolution", 0.2, "--range-max", 100, "-o", out, "--json")
    assert "such readings now count as obstacles" in done.err
    assert done.json["skipped"] == {}
