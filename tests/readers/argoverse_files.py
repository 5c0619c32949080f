# SPDX-License-Identifier: Apache-2.0
"""A small log of Argoverse 2: a car that turns left at 10 m/s."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from oddsmap.array_types import FloatArray

__all__ = ["CAR", "LIDARS", "STAMP", "argoverse_log", "sweep_columns"]

STAMP = 315_966_265_000_000_000
LIDARS = {"up_lidar": np.array([1.35, 0.0, 1.64]), "down_lidar": np.array([1.34, 0.1, 1.5])}
_SPEED = 10.0


def CAR(time: int) -> tuple[FloatArray, FloatArray]:  # noqa: N802 - a constant of the world
    """Place [m] and quaternion xyzw of the car, straight on, turned by a quarter."""
    half = np.sqrt(0.5)
    along = _SPEED * (time - STAMP) / 1e9
    return np.array([5000.0, 2400.0 + along, 60.0]), np.array([0.0, 0.0, half, half])


def sweep_columns() -> dict[str, Any]:
    """Points of both LIDARs, as float16 holds them."""
    rng = np.random.default_rng(4)
    points = rng.uniform(3.0, 30.0, (24, 3)).astype(np.float16).astype(np.float64)
    return {
        **{axis: points[:, i].tolist() for i, axis in enumerate("xyz")},
        "intensity": [7] * 24,
        "laser_number": [(i * 11) % 64 for i in range(24)],
        "offset_ns": [i * 4_000_000 for i in range(24)],
    }


def argoverse_log(folder: Path, sweeps: int = 2) -> Path:
    """Write a log."""
    (folder / "sensors" / "lidar").mkdir(parents=True)
    (folder / "calibration").mkdir()
    for i in range(sweeps):
        _write(folder / "sensors" / "lidar" / f"{STAMP + i * 10**8}.feather", sweep_columns())
    stamps = [STAMP + i * 10_000_000 for i in range(-10, 31)]
    places, turns = zip(*map(CAR, stamps), strict=True)
    _write(
        folder / "city_SE3_egovehicle.feather",
        {"timestamp_ns": stamps, **_columns(np.array(places), np.array(turns))},
    )
    places = (*LIDARS.values(), np.zeros(3))
    turns = (np.array([0.0, 0.0, 0.0, 1.0]),) * 3
    _write(
        folder / "calibration" / "egovehicle_SE3_sensor.feather",
        {"sensor_name": [*LIDARS, "camera"], **_columns(np.array(places), np.array(turns))},
    )
    return folder


def _columns(places: FloatArray, turns: FloatArray) -> dict[str, list[float]]:
    named = {f"q{axis}": turns[:, i].tolist() for i, axis in enumerate("xyzw")}
    return named | {f"t{axis}_m": places[:, i].tolist() for i, axis in enumerate("xyz")}


def _write(path: Path, columns: dict[str, Any]) -> None:
    import pyarrow as pa
    import pyarrow.feather

    types = {"x": pa.float16(), "y": pa.float16(), "z": pa.float16(), "laser_number": pa.uint8()}
    arrays = {
        name: pa.array(np.array(values, np.float16) if name in "xyz" else values, types.get(name))
        for name, values in columns.items()
    }
    pyarrow.feather.write_feather(pa.table(arrays), path)
