# SPDX-License-Identifier: Apache-2.0
"""A command loads what it uses: a library that is loaded for nothing is what people wait for."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import oddsmap

# Commands run twice: where kernels are compiled, in the first run, the compiler is loaded.
RUN = """
import json, os, sys
from oddsmap.cli import main
sys.argv = ["oddsmap", *sys.argv[1:]]
answer, sys.stdout = sys.stdout, open(os.devnull, "w")
try:
    main()
except SystemExit as ended:
    assert not ended.code, ended.code
json.dump(sorted(sys.modules), answer)
"""
COMPILER = {"numba.np.arraymath", "scipy.linalg"}
PICTURES = {"matplotlib", "PIL"}
HEAVY = {"numpy", "numba", "zarr", "rich", "yaml", "xarray"} | COMPILER | PICTURES


def loaded(*words: str | Path) -> set[str]:
    done = subprocess.run(
        [sys.executable, "-c", RUN, *map(str, words)],
        env={**os.environ, "PYTHONPATH": str(Path(oddsmap.__file__).parents[1])},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return set(json.loads(done.stdout))


@pytest.mark.parametrize("words", [["-h"], ["--version"], ["info", "-h"], ["export", "-h"]])
def test_help_loads_nothing_heavy(words: list[str]) -> None:
    assert not loaded(*words) & HEAVY


def test_settings_and_most_logs_need_no_kernels(tmp_path: Path) -> None:
    assert not loaded("config") & (HEAVY - {"numpy"})
    beams = np.array([[0.0, 0.0, 0.0, 1.0]] * 3, np.float32)
    np.savez(tmp_path / "log.npz", beams=beams, scan=[0, 0, 1], cone_deg=10.0, range_max=2.0)
    assert not loaded("info", tmp_path / "log.npz") & (HEAVY - {"numpy", "rich"})


@pytest.mark.skipif("NUMBA_DISABLE_JIT" in os.environ, reason="nothing is compiled")
def test_maps_are_made_and_read_without_the_compiler(office: Path, tmp_path: Path) -> None:
    made = tmp_path / "office.zarr"
    build = ("build", office, "--resolution", "0.1", "-o", made, "--force")
    for words in (build, ("info", made)):
        loaded(*words)
        assert not loaded(*words) & (COMPILER | PICTURES)
