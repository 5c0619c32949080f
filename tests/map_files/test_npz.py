# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap.errors import ConfigError, InputError, OutputError
from oddsmap.map_files.npz import Column, all_true, save_npz


def cells(**changes: Any) -> dict[str, Any]:
    return {
        "index": np.array([[-3, 70_000_000_000], [0, 1], [5, -1]]),
        "hits": np.array([0.0, 1.25, 3.0]),
        "passes": np.array([2.0, 0.0, 1e9]),
        "probability": np.array([0.1, 0.9, 1.0]),
        "observed": np.array([True, False, True]),
        "resolution": 0.05,
    } | changes


@pytest.mark.parametrize("dimensions", [2, 3])
def test_names_types_and_values(tmp_path: Path, dimensions: int) -> None:
    index = np.arange(3 * dimensions, dtype=np.int32).reshape(3, dimensions) - 4
    given = cells(index=index)
    assert save_npz(tmp_path / "m.npz", **given) == tmp_path / "m.npz"
    assert [file.name for file in tmp_path.iterdir()] == ["m.npz"]
    with np.load(tmp_path / "m.npz") as found:
        types = {name: found[name].dtype for name in found.files}
        assert types == {
            "index": np.int64,
            "hits": np.float64,
            "passes": np.float64,
            "probability": np.float32,
            "observed": np.bool_,
            "resolution": np.float64,
        }
        assert found["resolution"].shape == ()
        assert float(found["resolution"]) == 0.05
        for name in ("index", "hits", "passes", "observed"):
            assert np.array_equal(found[name], given[name])
        assert found["probability"] == pytest.approx(given["probability"], rel=1e-7)


def test_large_indices_stay_exact(tmp_path: Path) -> None:
    save_npz(tmp_path / "m.npz", **cells())
    with np.load(tmp_path / "m.npz") as found:
        assert found["index"][0].tolist() == [-3, 70_000_000_000]


def test_no_cells(tmp_path: Path) -> None:
    none = {name: np.zeros(0) for name in ("hits", "passes", "probability")}
    empty = cells(index=np.zeros((0, 2), np.int64), observed=np.zeros(0, np.bool_), **none)
    save_npz(tmp_path / "m.npz", **empty)
    with np.load(tmp_path / "m.npz") as found:
        assert found["index"].shape == (0, 2)


def test_same_map_same_bytes(tmp_path: Path) -> None:
    save_npz(tmp_path / "a.npz", **cells())
    save_npz(tmp_path / "b.npz", **cells())
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"index": np.zeros(3, np.int64)}, r"index must have shape \(n, 2\) or \(n, 3\)"),
        ({"index": np.zeros((3, 4), np.int64)}, "index must have shape"),
        ({"index": np.zeros((3, 2))}, "index must hold integers, got float64"),
        ({"hits": np.zeros(2)}, r"hits must have shape \(3,\) like index, got \(2,\)"),
        ({"passes": np.zeros((3, 1))}, "passes must have shape"),
        ({"observed": np.zeros(2, np.bool_)}, "observed must have shape"),
        ({"observed": np.zeros(3)}, "observed must hold bool"),
        ({"hits": np.array([0.0, -1.0, np.nan])}, "hits must be finite and >= 0, 2 values"),
        ({"probability": np.array([0.0, 1.5, np.nan])}, "probability must lie in .* 2 values"),
    ],
)
def test_wrong_arrays(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        save_npz(tmp_path / "m.npz", **cells(**changes))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("resolution", [0.0, -1.0, float("nan"), float("inf")])
def test_wrong_resolution(tmp_path: Path, resolution: float) -> None:
    with pytest.raises(ConfigError, match="resolution must be positive"):
        save_npz(tmp_path / "m.npz", **cells(resolution=resolution))


def test_wrong_suffix(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"ends in \.npz"):
        save_npz(tmp_path / "m.zip", **cells())


def test_existing_file_needs_force(tmp_path: Path) -> None:
    (tmp_path / "m.npz").write_text("mine")
    with pytest.raises(OutputError, match="exists already"):
        save_npz(tmp_path / "m.npz", **cells())
    assert (tmp_path / "m.npz").read_text() == "mine"
    save_npz(tmp_path / "m.npz", force=True, **cells())
    with np.load(tmp_path / "m.npz") as found:
        assert len(found["index"]) == 3


@pytest.mark.parametrize("name", ["hits", "passes"])
def test_the_least_negative_weight_is_refused(tmp_path: Path, name: str) -> None:
    weights = np.array([0.0, 0.0, -1e-300])
    with pytest.raises(InputError, match=f"{name} must be finite and >= 0, 1 values are not"):
        save_npz(tmp_path / "m.npz", **cells(**{name: weights}))
    assert not list(tmp_path.iterdir())


def in_parts(values: npt.NDArray[Any], sizes: list[int]) -> Column:
    """The same rows some at a time."""
    return Column(values.shape, lambda: np.split(values, np.cumsum(sizes)))


def test_columns_made_in_parts_give_the_bytes_of_numpy(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    index = rng.integers(-9, 9, (500_000, 3))
    hits, passes = rng.integers(0, 9, (2, 500_000)) / 4
    p = rng.random(500_000).astype(np.float32)
    save_npz(
        tmp_path / "m.npz",
        index=in_parts(index, [1, 70_000, 0, 3]),
        hits=in_parts(hits, [499_999]),
        passes=passes,
        probability=in_parts(p, [123_456, 300_000]),
        observed=all_true(500_000),
        resolution=0.05,
        extra={"std": in_parts(p.astype(np.float64), [10])},
    )
    with (tmp_path / "plain.npz").open("wb") as file:
        np.savez_compressed(
            file, index=index, hits=hits, passes=passes, probability=p,
            observed=np.ones(500_000, np.bool_), resolution=np.float64(0.05), std=p,
        )  # fmt: skip
    assert (tmp_path / "m.npz").read_bytes() == (tmp_path / "plain.npz").read_bytes()


def test_wrong_columns(tmp_path: Path) -> None:
    p = np.array([0.5, 2.0, -1.0])
    with pytest.raises(InputError, match=r"probability must lie in .* 2 values"):
        save_npz(tmp_path / "m.npz", **cells(probability=in_parts(p, [1, 1])))
    with pytest.raises(InputError, match=r"hits must have shape \(3,\) like index, got \(2,\)"):
        save_npz(tmp_path / "m.npz", **cells(hits=in_parts(p[:2], [1])))
    with pytest.raises(InputError, match="index must have shape"):
        save_npz(tmp_path / "m.npz", **cells(index=in_parts(p, [1])))
    assert not list(tmp_path.iterdir())
