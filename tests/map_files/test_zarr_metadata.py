# SPDX-License-Identifier: Apache-2.0
"""The JSON files of a map are those that zarr-python writes, to the letter."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import zarr
from zarr.codecs import ZstdCodec

from oddsmap.map_files.zarr_metadata import array_json, axis_json, group_json

ATTRIBUTES: dict[str, Any] = {"a": 1.0, "b": [1, 2], "c": {"d": None, "é": "ü"}, "e": True}


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "uint32", "uint64", "float32"])
def test_an_array(d: int, dtype: str, tmp_path: Path) -> None:
    fill = -0.1 if dtype == "float32" else 0
    shape = (128, 64, 256)[:d]
    zarr.create_array(
        tmp_path / "a.zarr", shape=shape, shards=(64,) * d, chunks=(16,) * d, dtype=dtype,
        fill_value=fill, compressors=ZstdCodec(checksum=True),
        dimension_names=("z", "y", "x")[-d:], attributes=ATTRIBUTES,
    )  # fmt: skip
    written = (tmp_path / "a.zarr" / "zarr.json").read_text()
    assert array_json(shape, 64, 16, dtype, fill, ATTRIBUTES) == written


def test_an_axis(tmp_path: Path) -> None:
    zarr.create_array(
        tmp_path / "x", shape=(70,), chunks=(70,), dtype="float64", fill_value=0.0,
        compressors=ZstdCodec(checksum=True), dimension_names=("x",), attributes=ATTRIBUTES,
    )  # fmt: skip
    written = (tmp_path / "x" / "zarr.json").read_text()
    assert axis_json("x", 70, ATTRIBUTES) == written


def test_a_group(tmp_path: Path) -> None:
    zarr.open_group(tmp_path / "a.zarr", mode="w").attrs.update(ATTRIBUTES)
    assert group_json(ATTRIBUTES) == (tmp_path / "a.zarr" / "zarr.json").read_text()
