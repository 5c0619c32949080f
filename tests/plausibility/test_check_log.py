# SPDX-License-Identifier: Apache-2.0
"""Good logs raise no doubt; each fault raises the one that names it, with its remedy."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import oddsmap
from oddsmap.scans.scan import Scan
from tests.plausibility.faults import (
    Change,
    headings_in_degrees,
    in_units,
    indoors,
    inverted,
    office,
    ranges_in_units,
    sonars,
    spoilt,
    street,
    w_first,
)

Good = Callable[[], tuple[Scan, ...]]
UNIT, RANGES = "divide positions by", "divide ranges by"


@pytest.mark.parametrize("good", [office, street, indoors, sonars])
def test_a_good_log_raises_no_doubt(good: Good) -> None:
    assert oddsmap.check_log(good()) == ()


@pytest.mark.parametrize(
    ("good", "changes", "code", "remedy"),
    [
        (office, [headings_in_degrees], "pose.headings_in_degrees", "write headings in radians"),
        (office, [inverted], "pose.inverted", "give their inverses"),
        (office, [in_units(1000)], "pose.unit", f"{UNIT} 1000"),
        (office, [ranges_in_units(1000)], "range.unit", f"{RANGES} 1000"),
        (office, [ranges_in_units(100)], "range.unit", f"{RANGES} 100"),
        (office, [headings_in_degrees, in_units(1000)], "pose.headings_in_degrees", UNIT),
        (office, [ranges_in_units(1000), in_units(1000)], "range.unit", f"{RANGES} 1000"),
        (street, [w_first], "pose.quaternion_order", "write them as qx qy qz qw"),
        (street, [inverted], "pose.inverted", "give their inverses"),
        (street, [in_units(1000)], "pose.unit", f"{UNIT} 1000"),
        (street, [ranges_in_units(1000)], "range.unit", f"{RANGES} 1000"),
        (indoors, [w_first], "pose.quaternion_order", "write them as qx qy qz qw"),
        (indoors, [in_units(1000)], "pose.unit", f"{UNIT} 1000"),
        (indoors, [ranges_in_units(1000)], "range.unit", f"{RANGES} 1000"),
        (sonars, [in_units(1000)], "pose.unit", f"{UNIT} 1000"),
    ],
)
def test_a_fault_is_named(good: Good, changes: list[Change], code: str, remedy: str) -> None:
    doubts = oddsmap.check_log(spoilt(good(), *changes))
    assert [doubt.code for doubt in doubts] == [code]
    assert doubts[0].severity == "warning"
    assert remedy in doubts[0]
