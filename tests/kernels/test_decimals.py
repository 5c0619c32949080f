# SPDX-License-Identifier: Apache-2.0
"""Numbers read by the kernel are Python's, to the bit, or are left to Python."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap.kernels.decimals import parse_decimals


def parsed(text: bytes, room: int = 8) -> list[float] | None:
    numbers = np.full(room, -7.0)
    count = parse_decimals(np.frombuffer(text, np.uint8), numbers)
    return None if count < 0 else list(numbers[:count])


def bits(numbers: list[float]) -> list[bytes]:
    return [np.float64(number).tobytes() for number in numbers]


digits = st.text("0123456789", max_size=19)
words = st.builds(
    "{}{}{}{}{}".format,
    st.sampled_from(["", "-", "+"]),
    digits,
    st.sampled_from(["", "."]),
    digits,
    st.sampled_from(["", "", "e0", "e-5", "E+07", "e22", "e-22", "e23", "e-30", "e308", "e99999"]),
)


@given(st.lists(words, max_size=5), st.sampled_from([" ", "  ", "\t", " \r\n", "\f", "\v"]))
@settings(max_examples=500)
def test_what_it_reads_python_reads_the_same(numbers: list[str], space: str) -> None:
    text = space.join(numbers).encode()
    got = parsed(text)
    if got is not None:
        assert bits(got) == bits([float(word) for word in text.split()])


in_a_log = st.floats(-1e6, 1e6).map("{:.6f}".format) | st.floats(1e-9, 1e9).map("{:.7g}".format)


@given(st.lists(in_a_log, min_size=1, max_size=8))
def test_it_reads_what_logs_hold(numbers: list[str]) -> None:
    got = parsed(" ".join(numbers).encode())
    assert got is not None
    assert bits(got) == bits([float(word) for word in numbers])


@pytest.mark.parametrize(
    "text",
    [
        *("", " ", "0", "-0", "-0.0 0", "1.", ".5", "+3", "  2.5  ", "1e5 1E-5 1e+2", "00012.50"),
        *("900719925474097.9", "9007199254740989", "123456789012345e-22", "1e22"),
    ],
)
def test_it_reads(text: str) -> None:
    got = parsed(text.encode())
    assert got is not None
    assert bits(got) == bits([float(word) for word in text.split()])


@pytest.mark.parametrize(
    "text",
    [
        *(
            "-",
            "+",
            ".",
            "-.",
            "e5",
            "1e",
            "1e+",
            "1.2.3",
            "--1",
            "1-",
            "1_0",
            "nan",
            "0x10",
            "1,5",
        ),
        *("12345678901234567890", "9007199254740993", "1e23", "1e-23", "1.5e-22", "1e99999"),
        *("inf", "1,5", "1\x00", "\u0661", "1 2 x", "1 2 3 4 5 6 7 8 9"),
    ],
)
def test_it_leaves_to_others(text: str) -> None:
    assert parsed(text.encode()) is None
