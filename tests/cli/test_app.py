# SPDX-License-Identifier: Apache-2.0
"""The command line as a whole: help, version, and how a command ends that is interrupted."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import oddsmap
from tests.cli.conftest import Run, folder_bytes

# Maps one log again and again, and says when it has begun: however slow the machine is, it is not
# done before it is interrupted. Whoever runs the tests in the background has Ctrl-C ignored, and
# hands that on.
_LONG_BUILD = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)

from oddsmap.cli import main
from oddsmap.integrate import add

add_log = add.add_log

def add_log_often(*args, **kwargs):
    add_log(*args, **kwargs)
    print("mapping", flush=True)
    for _ in range(100_000):
        add_log(*args, **kwargs)

add.add_log = add_log_often
main()
"""


def test_help_and_version(run: Run) -> None:
    assert "oddsmap build" in run("--help").out
    assert oddsmap.__version__ in run("--version").out


def test_interrupt_keeps_the_old_map(run: Run, office: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.zarr"
    run("build", office, "--resolution", 0.2, "-o", out)
    before = folder_bytes(out)
    command = [sys.executable, "-c", _LONG_BUILD, "build", str(office), "--resolution", "0.1"]
    with subprocess.Popen(
        [*command, "-o", str(out), "--force"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == "mapping\n", process.stderr.read()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate()
    assert process.returncode == 1
    assert err.strip().splitlines()[-1].startswith("oddsmap: interrupted")
    assert "Traceback" not in err
    assert folder_bytes(out) == before
    assert [path.name for path in tmp_path.iterdir()] == ["x.zarr"]
