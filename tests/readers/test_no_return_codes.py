# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from oddsmap.readers.no_return_codes import (
    NoReturnCode,
    describe_codes,
    find_codes,
    find_doubtful_code,
)

FloatArray = npt.NDArray[np.float64]


def readings(*top: tuple[float, int], each: int = 1) -> FloatArray:
    """200 distinct readings from 1 to 10 m, `each` times, below (value, count) pairs."""
    usual = np.repeat(np.linspace(1.0, 10.0, 200), each)
    return np.concatenate([usual, *(np.full(count, value) for value, count in top)])


def codes(ranges: FloatArray) -> list[tuple[float, int]]:
    return [(code.value, code.count) for code in find_codes(ranges)]


def test_a_value_that_stands_out_at_the_top_is_a_code() -> None:
    assert codes(readings((81.83, 40))) == [(81.83, 40)]


def test_several_codes_end_at_the_first_usual_value() -> None:
    # orebro
    ranges = readings((32.767, 463), (32.765, 7), (32.763, 465), (32.759, 33), (32.63, 1))
    assert codes(ranges) == [(32.767, 463), (32.765, 7), (32.763, 465), (32.759, 33)]


def test_a_frequent_value_below_a_usual_one_is_not_a_code() -> None:
    # aces-raw: 49.81 occurs 40 times, under 49.91 with 2
    assert codes(readings((50.0, 100), (49.91, 2), (49.81, 40))) == [(50.0, 100)]


def test_a_spike_under_a_few_readings_is_a_code() -> None:
    assert codes(readings((50.0, 1), (49.0, 100))) == [(49.0, 100)]
    # Two neighbours, with noise above them; and above a value that looked like a code by itself.
    top = (51.25, 1), (51.2, 1), (51.16, 7), (51.15, 1114), (51.14, 350)
    assert codes(readings(*top)) == [(51.15, 1114), (51.14, 350)]
    assert codes(readings((60.0, 9), (55.0, 1), (51.15, 1114))) == [(51.15, 1114)]


def many_below(*top: tuple[float, int]) -> FloatArray:
    """`readings` among 50,000 more far below them."""
    return np.concatenate([readings(*top), np.linspace(0.1, 0.9, 50_000)])


@pytest.mark.parametrize(
    ("ranges", "found"),
    [
        (readings((50.0, 1), (49.0, 20)), True),
        (readings((50.0, 1), (49.0, 19)), False),  # not 20 times as often as the others
        (readings((51.0, 2), (50.0, 3), (49.0, 100)), True),
        (readings((51.0, 2), (50.0, 4), (49.0, 100)), False),  # too many above
        (many_below((50.0, 1), (49.0, 260)), True),
        (many_below((50.0, 1), (49.0, 240)), False),  # a robot that stood still
        (readings(*((50.0 + k, 1) for k in range(19)), (49.0, 400)), True),
        (readings(*((50.0 + k, 1) for k in range(20)), (49.0, 400)), False),  # too far below
    ],
)
def test_what_is_asked_of_a_spike_below_the_top(ranges: FloatArray, found: bool) -> None:
    assert [value for value, _ in codes(ranges)] == [49.0] * found


@pytest.mark.parametrize(
    ("ranges", "doubtful"),
    [
        (many_below((50.0, 1), (49.0, 240)), 49.0),
        (readings((51.0, 2), (50.0, 4), (49.0, 100)), 49.0),
        (readings((51.0, 1), (50.0, 100)), None),  # a code
        (many_below((50.0, 1), (49.0, 24)), None),  # too few to matter
        (readings((50.0, 1), (49.0, 3)), None),
    ],
)
def test_what_is_odd_and_not_sure(ranges: FloatArray, doubtful: float | None) -> None:
    code = find_doubtful_code(ranges, find_codes(ranges))
    assert (code and code.value) == doubtful


@pytest.mark.parametrize(("count", "found"), [(4, False), (5, True)])
def test_five_times_at_least(count: int, found: bool) -> None:
    assert bool(codes(readings((20.0, count)))) is found


@pytest.mark.parametrize(("count", "found"), [(14, False), (15, True)])
def test_five_times_the_median_at_least(count: int, found: bool) -> None:
    assert bool(codes(readings((20.0, count), each=3))) is found


def test_only_the_next_50_values_are_the_reference() -> None:
    lower = np.repeat(np.linspace(1.0, 2.0, 500), 100)
    near = np.linspace(5.0, 6.0, 50)
    assert codes(np.concatenate([lower, near, np.full(10, 9.0)])) == [(9.0, 10)]


@pytest.mark.parametrize(("lower_count", "found"), [(9, False), (10, True)])
def test_too_few_other_values_say_nothing(lower_count: int, found: bool) -> None:
    ranges = np.concatenate([np.linspace(1.0, 2.0, lower_count), np.full(100, 3.0)])
    assert bool(codes(ranges)) is found


def test_nan_and_infinities_are_no_codes() -> None:
    ranges = np.concatenate([readings((81.83, 9)), np.repeat([np.inf, -np.inf, np.nan], 50)])
    assert codes(ranges) == [(81.83, 9)]
    assert codes(np.full(100, np.nan)) == []
    assert codes(np.empty(0)) == []


def test_the_sentence_names_values_and_counts() -> None:
    one = NoReturnCode(81.83, 4172)
    assert describe_codes((one,)) == (
        "81.83 m occurs 4172 times at the top of the range: taken as 'no return'"
    )
    assert describe_codes((one,), 2).endswith("taken as 'no return', like 2 larger readings")
    two = describe_codes((NoReturnCode(32.767, 463), NoReturnCode(32.765, 7)))
    assert two.startswith("32.767 m (463 times), 32.765 m (7 times) ")
