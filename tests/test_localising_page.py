# SPDX-License-Identifier: Apache-2.0
"""The page on localising runs as it stands; its example stays on the corrected path of a log."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from examples.localise import Result, localise, odometry, resampled, wrapped

PAGE = Path(__file__).resolve().parents[1] / "docs" / "localising.md"


def test_the_blocks_do_what_the_page_says() -> None:
    names: dict[str, Any] = {"__name__": "__main__"}
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.S | re.M)
    assert len(blocks) == 4
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for block in blocks:
            exec(compile(block, PAGE.name, "exec"), names)
    assert np.abs(names["weights"] @ names["particles"] - names["here"]).max() < 0.1
    assert names["whole"] == pytest.approx(np.ones(3))
    met = names["view"].cast_rays(names["here"][:2], names["ways"], 20.0).distance
    # A wall's first cell may let a beam pass, so it is expected somewhat behind it.
    assert names["mean"] == pytest.approx(met, abs=0.4)
    assert np.hypot(*(names["best"] - names["here"])[:2]) < 0.2
    beam = names["beam"].log_likelihood(names["particles"], names["scan"], max_beams=60)
    assert np.hypot(*(names["particles"][np.argmax(beam)] - names["here"])[:2]) < 0.2


def test_motions_of_a_log_are_those_of_its_wheels(tmp_path: Path) -> None:
    """They start anew from each corrected pose."""
    log = tmp_path / "raw.log"
    laser = "FLASER 1 2.0 {0} 0 {1} {0} 0 {1} 0 host 0\n"
    log.write_text(
        "ODOM 0 0 0 0 0 0 0 host 0\n"
        + laser.format(5, 1.5)
        + "ODOM 5 0 1.5707963267948966 0 0 0 0 host 0\n"
        "ODOM 5 1 1.5707963267948966 0 0 0 0 host 0\n"
        "ODOM 5 2 1.8 0 0 0 0 host 0\n"
        + laser.format(9, 0.0)
        + laser.format(9, 0.0)
    )  # fmt: skip
    motions = odometry(log)
    assert motions == pytest.approx(
        np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 1.8 - np.pi / 2], [0.0, 0.0, 0.0]]), abs=1e-12
    )


def test_particles_go_on_by_their_weights() -> None:
    weights = np.array([0.5, 0.0, 0.25, 0.25])
    chosen = resampled(weights, np.random.default_rng(0))
    assert np.bincount(chosen, minlength=4).tolist() == [2, 0, 1, 1]
    assert wrapped(np.array([3.5 * np.pi, -np.pi])) == pytest.approx([-0.5 * np.pi, -np.pi])


@pytest.mark.realdata
@pytest.mark.parametrize("model", ["field", "beam"])
def test_the_filter_stays_on_the_corrected_path(model: str, data_folder: Path) -> None:
    result: Result = localise(
        data_folder / "laser2d" / "intel-corrected.log.gz",
        particle_count=500,
        model=model,
        scan_count=240,
    )
    away, angle = result.errors(result.mean)
    assert len(away) == 120
    assert np.median(away) < 0.12
    assert away.max() < 1.0
    assert np.median(angle) < 1.5
    assert result.errors(result.reckoned)[0].max() > 5.0
