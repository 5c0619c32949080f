# SPDX-License-Identifier: Apache-2.0
"""Builds `mrpt_simple.cpp` where MRPT's headers are installed, and runs it."""

from __future__ import annotations

import re
import shutil
import struct
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from oddsmap import Scan

__all__ = ["Grid", "Mrpt", "build"]

_SOURCE = Path(__file__).with_name("mrpt_simple.cpp")
# Debian's MRPT has no pkg-config files: each module has its own folder of headers.
_INCLUDE = Path("/usr/include/mrpt")
_LIBRARIES = ("maps", "obs", "poses", "math", "serialization", "rtti", "core")
_HEADER = struct.Struct("<2q7d")


@dataclass(frozen=True, slots=True)
class Grid:
    """MRPT's map: p(occupied), shape (rows, columns), and its lower left corner [m], shape (2,)."""

    corner: npt.NDArray[np.float64]
    probability: npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Mrpt:
    """The program, and a folder for its files."""

    program: Path
    version: str

    def write(
        self,
        scans: Sequence[Scan],
        angles: tuple[float, float],
        resolution: float,
        lo: npt.NDArray[np.int64],
        hi: npt.NDArray[np.int64],
    ) -> Path:
        """Write scans for the program; the map will cover the cells lo - 2 to hi + 2."""
        path = self.program.with_name("scans.bin")
        (x_min, y_min), (x_max, y_max) = (lo - 2) * resolution, (hi + 2) * resolution
        first, last = angles
        beams = len(scans[0].ranges)
        box = (resolution, x_min, x_max, y_min, y_max)
        with path.open("wb") as file:
            file.write(_HEADER.pack(len(scans), beams, *box, (first + last) / 2, last - first))
            for scan in scans:
                x, y = scan.map_from_sensor.translation
                cos, sin = scan.map_from_sensor.rotation[:, 0]
                file.write(struct.pack("<3d", x, y, np.arctan2(sin, cos)))
                ranges = np.where(np.isfinite(scan.ranges), scan.ranges, 0.0)
                file.write(ranges.astype("<f4").tobytes())
        return path

    def seconds(self, scans: Path) -> float:
        """Time of insertion alone [s]."""
        done = subprocess.run(
            [str(self.program), str(scans), "1"], check=True, capture_output=True, text=True
        )
        return float(done.stdout)

    def map(self, scans: Path) -> Grid:
        """The map it makes."""
        path = self.program.with_name("grid.bin")
        command = [str(self.program), str(scans), "1", str(path)]
        subprocess.run(command, check=True, capture_output=True)
        raw = path.read_bytes()
        columns, rows, x_min, y_min = struct.unpack_from("<2q2d", raw)
        probability = np.frombuffer(raw, "<f4", offset=32).reshape(rows, columns)
        return Grid(np.array([x_min, y_min]), probability)


def build(folder: Path) -> tuple[Mrpt | None, str]:
    """Compile the program; None, and why, where that cannot be done."""
    header = _INCLUDE / "maps" / "include" / "mrpt" / "maps" / "COccupancyGridMap2D.h"
    if not header.exists():
        return None, "MRPT not installed (apt install libmrpt-maps-dev)"
    compiler = shutil.which("g++")
    if compiler is None:
        return None, "MRPT not measured: no g++ (apt install g++)"
    program = folder / "mrpt_simple"
    command = [compiler, "-std=c++17", "-O3", "-march=native", str(_SOURCE), "-o", str(program)]
    for include in [*sorted(_INCLUDE.glob("*/include")), Path("/usr/include/eigen3")]:
        command += ["-isystem", str(include)]
    command += [f"-lmrpt-{name}" for name in _LIBRARIES]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[0]
        return None, f"MRPT not measured: {last}"
    found = re.search(r"MRPT_VERSION 0x(\w)(\w)(\w)", (_INCLUDE / "version.h").read_text())
    version = ".".join(found.groups()) if found else "of unknown version"
    return Mrpt(program, f"MRPT {version}"), ""
