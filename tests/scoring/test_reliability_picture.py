# SPDX-License-Identifier: Apache-2.0
"""The picture of a reliability curve."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from oddsmap.errors import ConfigError, InputError, OutputError
from oddsmap.scoring.picture import _short, _wilson, save_reliability_png
from oddsmap.scoring.reliability import Reliability


def curve(shift: float) -> Reliability:
    rng = np.random.default_rng(0)
    p = rng.random(5000)
    return Reliability.of(p, rng.random(5000) < np.clip(p + shift, 0, 1))


def test_it_shows_the_curve(tmp_path: Path) -> None:
    """Another curve is another picture; the same one the same, byte by byte."""
    paths = [tmp_path / f"{i}.png" for i in range(3)]
    for path, shift in zip(paths, (0.0, 0.0, 0.3), strict=True):
        assert save_reliability_png(curve(shift), path, title="sonar") == path
    assert paths[0].read_bytes() == paths[1].read_bytes() != paths[2].read_bytes()
    with Image.open(paths[0]) as picture:
        assert min(picture.size) > 500


def test_empty_bins_and_no_bins(tmp_path: Path) -> None:
    few = Reliability.of(np.array([0.1, 0.95]), np.array([False, True]))
    assert save_reliability_png(few, tmp_path / "few.png").exists()
    none = Reliability.of(np.empty(0), np.empty(0, np.bool_))
    assert np.isnan(none.ece)
    assert np.isnan(none.ece_of_bins)
    with pytest.raises(InputError, match="there is no prediction to draw"):
        save_reliability_png(none, tmp_path / "none.png")


def test_ece() -> None:
    """Nine of ten predictions of 0.05 are right, one of 0.9 is wrong."""
    p = np.array([0.05] * 9 + [0.9])
    reliability = Reliability.of(p, np.zeros(10, np.bool_))
    assert reliability.ece == pytest.approx((9 * 0.05 + 0.9) / 10)
    assert reliability.ece_of_bins == pytest.approx((0.05 + 0.9) / 2)
    assert reliability.rate[0] == 0.0
    assert reliability.mean_predicted[13] == pytest.approx(0.9)


def test_wrong_outputs(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    save_reliability_png(curve(0.0), path)
    with pytest.raises(OutputError, match="exists already"):
        save_reliability_png(curve(0.0), path)
    with pytest.raises(ConfigError, match=r"ends in \.png"):
        save_reliability_png(curve(0.0), tmp_path / "a.jpg")


def test_intervals_are_wilsons() -> None:
    """Against SciPy's, also where all or none of the events happened."""
    from scipy.stats import binomtest

    count = np.array([1, 4, 40, 40, 1000])
    happened = np.array([0, 4, 0, 13, 999])
    low, high = _wilson(happened / count, count)
    for k, n, a, b in zip(happened, count, low, high, strict=True):
        interval = binomtest(int(k), int(n)).proportion_ci(0.95, method="wilson")
        assert (a, b) == pytest.approx((interval.low, interval.high), abs=2e-4)


def test_vector_files_and_counts(tmp_path: Path) -> None:
    path = save_reliability_png(curve(0.1), tmp_path / "a.svg")
    assert "5,000 predictions" in path.read_text()
    assert [_short(n) for n in (7, 999, 1000, 12_345, 123_456, 3_400_000)] == [
        "7", "999", "1k", "12k", "123k", "3.4M",
    ]  # fmt: skip
