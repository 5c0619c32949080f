# SPDX-License-Identifier: Apache-2.0
"""The memory limit: the machine's, a container's, or that of `ulimit`, whichever is least."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from oddsmap import limits
from oddsmap.errors import ConfigError, InputError, MapTooLargeError
from oddsmap.evidence_map import build_map
from oddsmap.limits import check_content_size, memory_for, memory_limit
from oddsmap.readers import open_log
from oddsmap.sensors.beam import BeamSensor
from tests.kit import random_scans

GB = 1 << 30


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def container(folder: Path, groups: str) -> int:
    write(folder / "cgroup", groups)
    return limits._container_memory.__wrapped__(folder / "cgroup", folder / "mounted")


def test_a_container_of_version_2(tmp_path: Path) -> None:
    mounted = tmp_path / "mounted"
    write(mounted / "a" / "b" / "memory.max", "max\n")
    assert container(tmp_path, "0::/a/b\n") == 1 << 62
    write(mounted / "a" / "memory.max", f"{3 * GB}\n")
    assert container(tmp_path, "0::/a/b\n") == 3 * GB
    write(mounted / "a" / "b" / "memory.max", f"{2 * GB}\n")
    assert container(tmp_path, "0::/a/b\n") == 2 * GB
    # Inside of a container the path may be one of the host's, and the root the container's own.
    write(mounted / "memory.max", f"{GB}\n")
    assert container(tmp_path, "0::/docker/1234\n") == GB


@pytest.mark.skipif(sys.platform == "win32", reason="no colon in names")
def test_a_container_of_version_1(tmp_path: Path) -> None:
    name = "memory.limit_in_bytes"
    write(tmp_path / "mounted" / "memory" / name, "9223372036854771712\n")
    groups = "9:name=systemd:/\n4:cpu,memory:/a:b\n3:cpuset:/\n"
    assert container(tmp_path, groups) == 1 << 62
    write(tmp_path / "mounted" / "memory" / "a:b" / name, f"{2 * GB}\n")
    assert container(tmp_path, groups) == 2 * GB


@pytest.mark.parametrize("groups", ["", "nonsense\n", "0::\n", "1:memory\n"])
def test_no_container(tmp_path: Path, groups: str) -> None:
    assert container(tmp_path, groups) == 1 << 62
    assert limits._container_memory.__wrapped__(tmp_path / "gone", tmp_path) == 1 << 62


@pytest.mark.parametrize("which", ["_machine_memory", "_container_memory", "_ulimit_memory"])
def test_the_least_counts(which: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_machine_memory", "_container_memory", "_ulimit_memory"):
        monkeypatch.setattr(limits, name, lambda least=name == which: GB if least else 9 * GB)
    assert memory_limit() == int(0.8 * GB)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not keep RLIMIT_AS")
@pytest.mark.parametrize("which", ["RLIMIT_AS", "RLIMIT_DATA"])
def test_a_ulimit_counts(which: str) -> None:
    code = (
        f"import resource; resource.setrlimit(resource.{which}, ({GB}, {GB}));"
        "from oddsmap.limits import memory_limit; print(memory_limit())"
    )
    found = int(
        subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout
    )
    # Less what the interpreter takes already.
    assert 0.3 * GB < found < 0.8 * GB


def test_content_that_does_not_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(limits, "memory_limit", lambda: 4 * GB)
    check_content_size("a.npz", 2 * GB, "the file")
    message = r"a\.npz: the file takes 3\.22 GB, at most 2\.15 GB fit in memory here: split"
    with pytest.raises(InputError, match=message):
        check_content_size("a.npz", 3 * GB, "the file")


def test_memory_that_runs_out_is_one_line() -> None:
    message = r"no memory for the map: use a coarser resolution$"
    with (
        pytest.raises(MapTooLargeError, match=message) as caught,
        memory_for("the map", "use a coarser resolution"),
    ):
        raise MemoryError("Unable to allocate 29 TiB")
    assert caught.value.__suppress_context__
    with pytest.raises(MapTooLargeError, match=r"^ours$"), memory_for("the map", "use"):
        raise MapTooLargeError("ours")


def test_mapping_and_reading_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(BeamSensor, "segments", fail)
    with pytest.raises(MapTooLargeError, match="no memory for what the scans need: use a coarser"):
        build_map(random_scans(1, 1), 0.1)
    np.savez(tmp_path / "a.npz", beams=np.ones((2, 4)))
    monkeypatch.setattr("oddsmap.readers.npz_beams._directions", fail)
    with pytest.raises(MapTooLargeError, match=r"no memory for the log .*a\.npz: split it"):
        open_log(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("memory", "size"),
    [
        ("4GB", 4_000_000_000),
        (" 500 mb ", 500_000_000),
        ("1.5GiB", 3 << 29),
        ("64 MiB", 1 << 26),
        ("1TB", 10**12),
        (1 << 30, 1 << 30),
    ],
)
def test_sizes_of_memory(memory: int | str, size: int) -> None:
    assert limits.bytes_of(memory) == size


@pytest.mark.parametrize("memory", ["4", "", "GB", "-4GB", "4 GB more", "nan", True, 1.5, "1kB"])
def test_what_is_no_size_of_memory(memory: int | str) -> None:
    with pytest.raises(ConfigError, match="memory"):
        limits.bytes_of(memory)


def test_the_default_budget(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert 0 < limits.default_budget() <= limits.memory_limit() // 2
    facts = tmp_path / "meminfo"
    facts.write_text("MemTotal: 9 kB\nMemAvailable:     3000 kB\n")
    assert limits._available_memory(facts) == 3_072_000
    facts.write_text("MemTotal: 9 kB\n")
    assert limits._available_memory(facts) == 1 << 62
    assert limits._available_memory(tmp_path / "none") == 1 << 62
