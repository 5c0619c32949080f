# SPDX-License-Identifier: Apache-2.0
"""Messages are one printable line, and ask about a word that is nearly right."""

from __future__ import annotations

import pickle

import pytest

from oddsmap.errors import (
    ConfigError,
    InputError,
    MapTooLargeError,
    OddsmapError,
    OutputError,
    as_line,
    did_you_mean,
    shown,
)

SENSORS = ("lidar2d", "lidar3d", "depth", "sonar", "tof", "overhead")


@pytest.mark.parametrize("kind", [ConfigError, InputError, MapTooLargeError, OutputError])
def test_a_message_is_one_line(kind: type[OddsmapError]) -> None:
    assert str(kind("hall.log:812: it has  two blanks")) == "hall.log:812: it has  two blanks"
    page = f"hall.log: got {'9' * 5000}: copy the file again"
    text = str(kind(page))
    assert len(text) < 400
    assert text.startswith("hall.log: got 999")
    assert text.endswith("999: copy the file again")
    # What a terminal would obey, and what it could not print: a name of bytes that are no UTF-8.
    assert str(kind("a\x1b[31m\nb\r\n\udcff\0")) == r"a\x1b[31m b  \udcff\x00"
    assert len(str(kind("\x7f" * 5000))) < 400
    assert str(pickle.loads(pickle.dumps(kind("a")))) == "a"


def test_a_line_of_a_given_length() -> None:
    assert as_line("x" * 100, 100) == "x" * 100
    assert as_line("a" * 50 + "b" * 51, 100) == "a" * 50 + "b" * 10 + " ... " + "b" * 35


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (3, "3"),
        (-0.5, "-0.5"),
        (None, "None"),
        ("grey", "'grey'"),
        ([1, 2], "[1, 2]"),
        ({"a": 1}, "{'a': 1}"),
        ({"a": 1, "b": 2}, "{'a': 1, ...}"),
        ([[[[1]]], 2, 3, 4], "[[[...]], 2, 3, ...]"),
        ("x" * 5000, f"'{'x' * 17}...{'x' * 18}'"),
    ],
)
def test_a_value_is_shown_in_short(value: object, text: str) -> None:
    assert shown(value) == text


def test_an_integer_of_pages_is_shown_in_short() -> None:
    assert shown(10**5000) == "a whole number of about 5001 digits"
    assert shown([-(10**20)]) == "[a whole number of about 21 digits]"


def test_a_tree_of_aliases_is_shown_at_once() -> None:
    """Its `repr` has 9^12 numbers."""
    tree: object = 1
    for _ in range(12):
        tree = [tree] * 9
    assert shown(tree) == "[[[...], [...], [...], ...], [[...], [...], [...], ...], [[...], [...], [...], ...], ...]"  # fmt: skip  # noqa: E501
    assert shown({"a": tree}).startswith("{'a': [[...]")


@pytest.mark.parametrize(
    ("said", "known", "asked"),
    [
        ("lidar", SENSORS, ', did you mean "lidar2d" or "lidar3d"?'),
        ("lidar2", SENSORS, ', did you mean "lidar2d"?'),
        ("Sonar", SENSORS, ', did you mean "sonar"?'),
        ("camera", SENSORS, ""),
        ("", SENSORS, ""),
        ("range_mx", {"range_min": 1, "range_max": 2}, ', did you mean "range_max"?'),
        ("x", (), ""),
    ],
)
def test_did_you_mean(said: str, known: tuple[str, ...], asked: str) -> None:
    assert did_you_mean(said, known) == asked
