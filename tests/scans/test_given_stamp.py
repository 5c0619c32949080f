# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from datetime import UTC, datetime, timedelta, timezone
from decimal import Decimal
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.errors import InputError
from oddsmap.scans.given_stamp import stamp_of

NOW = 1_700_000_000_123_456_789


@given(st.integers(-(2**63), 2**63 - 1))
def test_every_form_gives_the_same_nanoseconds(ns: int) -> None:
    assert stamp_of(None, None, ns) == ns
    assert stamp_of(None, Fraction(ns, 10**9), None) == ns
    assert stamp_of(None, Decimal(ns).scaleb(-9), None) == ns
    for names in (("sec", "nanosec"), ("secs", "nsecs")):
        message = SimpleNamespace(**dict(zip(names, divmod(ns, 10**9), strict=True)))
        assert stamp_of(message, None, None) == ns
    if ns > -(2**63):  # which stands for no time
        assert stamp_of(np.datetime64(ns, "ns"), None, None) == ns


@given(st.datetimes(datetime(1700, 1, 1), datetime(2200, 1, 1)), st.integers(-12, 12))
def test_datetimes(moment: datetime, hours: int) -> None:
    here = moment.replace(tzinfo=timezone(timedelta(hours=hours)))
    utc = np.datetime64(here.astimezone(UTC).replace(tzinfo=None), "us")
    assert stamp_of(here, None, None) == int(utc.astype(np.int64)) * 1000
    assert stamp_of(utc, None, None) == stamp_of(here, None, None)


def test_seconds() -> None:
    assert stamp_of(None, 12.5, None) == 12_500_000_000
    assert stamp_of(None, 12, None) == 12_000_000_000
    others: list[Any] = [np.float32(0.5), np.longdouble(0.5)]
    assert [stamp_of(None, value, None) for value in others] == [500_000_000] * 2
    number: Any = np.int32(3)
    assert stamp_of(None, number, None) == 3_000_000_000
    assert stamp_of(None, None, None) is None
    assert stamp_of(None, None, np.int64(NOW)) == NOW  # type: ignore[arg-type]
    assert stamp_of(np.datetime64("2023-11", "M"), None, None) == 1_698_796_800 * 10**9
    assert stamp_of(np.datetime64("2023-11-02", "W"), None, None) == 1_698_883_200 * 10**9


@pytest.mark.parametrize(
    ("stamps", "says"),
    [
        ((12.5, None, None), "stamp=12.5 is no time that knows its unit; say the unit: stamp_s="),
        ((NOW, None, None), "stamp_ns= for nanoseconds"),
        ((np.datetime64("NaT"), None, None), "no time that knows its unit"),
        ((datetime(2023, 1, 1), None, None), "it has no time zone"),
        ((np.datetime64(5, "ps"), None, None), "finer than nanoseconds"),
        ((None, np.nan, None), "a finite number of seconds, got nan"),
        ((None, "12", None), "a finite number of seconds, got '12'"),
        ((None, True, None), "a finite number of seconds"),
        ((None, NOW, None), "beyond int64 nanoseconds, got .*: is it in nanoseconds"),
        ((None, None, 1.5), "a whole number of nanoseconds, got 1.5: seconds are stamp_s="),
        ((None, None, True), "a whole number of nanoseconds"),
        ((None, None, 2**63), "beyond int64"),
        ((None, 1.0, 5), "one stamp, got stamp_s and stamp_ns"),
    ],
)
def test_what_is_no_stamp(stamps: tuple[Any, Any, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        stamp_of(*stamps)
