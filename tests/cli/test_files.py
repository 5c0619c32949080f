# SPDX-License-Identifier: Apache-2.0
"""In which order a command looks at what it is given: mistakes first, `--force` last of all."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from oddsmap.cli.files import check_files, check_suffix
from oddsmap.errors import ConfigError, InputError, OutputError
from tests.cli.conftest import Run


@pytest.fixture
def there(tmp_path: Path) -> Path:
    """A folder with outputs of each kind that exist, and with inputs."""
    (tmp_path / "m.zarr").mkdir()
    for name in ("m.png", "m.npz", "m.toml", "m.csv", "m.ot", "m.html"):
        (tmp_path / name).write_text("x")
    (tmp_path / "seen.csv").write_text("x,y,theta,range,bearing,id\n0,0,0,1,0,1\n")
    np.savez(tmp_path / "hall.npz", beams=np.array([[0.0, 0.0, 0.0, 1.0]]))
    return tmp_path


# Of each command: all mistakes at once, and what is said of them; each is mended in turn, and the
# last one is that the output exists. A pair is a mistake and what mends it; None: nothing.
Mistake = tuple[str, list[str], list[str]]
ORDER: dict[str, list[Mistake]] = {
    "build": [
        ("--sensor lidar: not available", ["--sensor", "lidar"], []),
        ("--sweeps belongs to --estimator full-map", ["--sweeps", "3"], []),
        ("--hold-out 0.7", ["--hold-out", "0.7"], []),
        ("missing.toml: cannot be read", ["--config", "missing.toml"], []),
        ("--set nonsense: needs section.field", ["--set", "nonsense"], []),
        ('did you mean "range_max"', ["--set", "sensor.range_mx=3"], []),
        ("map.resolution is a length above 0 m", ["--resolution", "-1"], ["--resolution", "1"]),
        ("sensor.p_hit lies between 0.5 and 1, got 2", ["--set", "sensor.p_hit=2"], []),
        ('did you mean ".zarr"?', ["-o", "m.zar"], ["-o", "m.zarr"]),
        ("gone.npz: no such file", ["gone.npz"], ["hall.npz"]),
        ("gone.txt: no such file", ["--poses", "gone.txt"], []),
    ],
    "calibrate": [
        ('did you mean "range_max"', ["--set", "sensor.range_mx=3"], []),
        ("map.resolution is a length above 0 m", ["--resolution", "-1"], ["--resolution", "1"]),
        ("sensor.p_random is a rate", ["--set", "sensor.p_random=2"], []),
        ("a name that ends in .toml", ["-o", "m.tml"], ["-o", "m.toml"]),
        ("gone.npz: no such file", ["gone.npz"], ["hall.npz"]),
    ],
    "score": [
        ('did you mean "sigma"', ["--set", "sensor.sigm=3"], []),
        ("sensor.sigma is a length", ["--set", "sensor.sigma=-1"], []),
        ("a name that ends in .png", ["--plot", "m.pgn"], ["--plot", "m.png"]),
        ("gone.zarr: no such file", ["gone.zarr"], ["m.zarr"]),
        ("gone.npz: no such file", ["gone.npz"], ["hall.npz"]),
    ],
    "landmarks": [
        ("--sigma-range -1: a standard deviation is positive", ["--sigma-range", "-1"], []),
        ("gate", ["--gate", "2"], []),
        ("the suffix says what to write", ["-o", "m.cvs"], ["-o", "m.csv"]),
        ("gone.csv: no such file", ["gone.csv"], ["seen.csv"]),
    ],
    "view": [
        ("--port and --no-browser say how a map is served", ["--port", "80"], []),
        ("a page has a name that ends in .html", ["-o", "m.htlm"], ["-o", "m.html"]),
        ("gone.zarr: no such file", ["gone.zarr"], ["m.zarr"]),
    ],
    "export": [
        ("--level belongs to --posterior reflection or decay", ["--level", "0.5"], []),
        ("--mode says how a ROS map is written", ["--mode", "raw"], []),
        ("--free and --occupied decide", ["--free", "0.1"], []),
        ("--prior gone.yaml: neither a number nor a file", ["--prior", "gone.yaml"], []),
        ("p_hit is a probability", ["--p-hit", "2"], []),
        ("--z-min has to lie below --z-max", ["--z-min", "2", "--z-max", "1"], []),
        ("gone.zarr: no such file", ["gone.zarr"], ["m.zarr"]),
        ("", ["m.png"], ["m.png"]),
    ],
}  # fmt: skip


@pytest.mark.parametrize("command", ORDER)
def test_what_is_said_first(
    run: Run, there: Path, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    monkeypatch.chdir(there)
    mistakes = ORDER[command]
    for first, (message, _, _) in enumerate(mistakes):
        words = [
            word
            for k, (_, wrong, right) in enumerate(mistakes)
            for word in (right if k < first else wrong)
        ]
        assert message in run(command, *words).line
    mended = [word for _, _, right in mistakes for word in right]
    assert "exists already; use --force" in run(command, *mended).line


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--posterior", "reflection", "--level", "2"], "level"),
        (["--posterior", "decay", "--level", "2"], "level"),
        (["--posterior", "reflexion"], 'did you mean "reflection"? (known: log-odds'),
    ],
)
def test_values_of_views(
    run: Run, there: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], message: str
) -> None:
    monkeypatch.chdir(there)
    assert message in run("export", "m.zarr", "m.npz", *words).line


def test_what_is_read(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="-: standard input is not read; write it to a file"):
        check_files([Path("-")], force=False)
    with pytest.raises(InputError, match="no such file"):
        check_files([None, tmp_path / "gone"], force=False)
    with pytest.raises(InputError, match="cannot be read"):
        check_files([Path("a\0b")], force=False)
    file = tmp_path / "file"
    file.touch()
    with pytest.raises(InputError, match=r"cannot be read \(Not a directory\)"):
        check_files([file / "in_it"], force=False)
    check_files([file], force=False)


def test_a_file_without_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "file"
    file.touch()
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may read anything
    with pytest.raises(InputError, match=r"cannot be read \(Permission denied\)"):
        check_files([file], force=False)


def test_what_is_written(tmp_path: Path) -> None:
    file, other = tmp_path / "a.png", tmp_path / "b.png"
    file.touch()
    with pytest.raises(ConfigError, match="is the input"):
        check_files([file], tmp_path / ".." / tmp_path.name / "a.png", force=True)
    with pytest.raises(OutputError, match="exists already"):
        check_files([], file, force=False)
    check_files([file], other, force=False)


def test_what_is_written_beside_it(
    run: Run, there: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The image of a ROS map, before anything is loaded: the map here cannot be."""
    monkeypatch.chdir(there)
    Path("a.pgm").touch()
    for words in (
        ("export", "m.zarr", "a.yaml"),
        ("export", "m.zarr", "m.yaml", "--mode", "scale"),
        ("export", "m.zarr", "m.yaml", "--posterior", "reflection"),
        ("costmap", "m.zarr", "a.yaml", "--inscribed-radius", 0.2),
    ):
        image = f"{Path(words[2]).stem}.{'png' if words[2] == 'm.yaml' else 'pgm'}"
        assert run(*words).line.startswith(f"{image}: exists already; use --force to replace it")
        assert "not a saved map" in run(*words, "--force").line


def test_a_map_where_a_log_is_needed(run: Run, there: Path) -> None:
    grid = there / "m.zarr"
    (grid / "zarr.json").touch()
    for words in (
        ("build", grid, "--resolution", 1, "-o", there / "n.zarr"),
        ("calibrate", grid, "--resolution", 1, "-o", there / "n.toml"),
        ("score", grid, grid),
    ):
        assert "m.zarr: is a saved map, not a log: give the log" in run(*words).line


def test_suffixes() -> None:
    known = (".png", ".yaml")
    check_suffix(Path("a.PNG"), known, "a picture or a map")
    with pytest.raises(ConfigError, match=r'^a\.pgn: a or b; got "\.pgn", did you mean "\.png"\?$'):
        check_suffix(Path("a.pgn"), known, "a or b")
    with pytest.raises(ConfigError, match=r'^a: a or b; got ""$'):
        check_suffix(Path("a"), known, "a or b")
