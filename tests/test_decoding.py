# SPDX-License-Identifier: Apache-2.0
"""Whatever a library raises becomes one line."""

from __future__ import annotations

import lzma
import tokenize
import zlib

import pytest

from oddsmap.decoding import decoding
from oddsmap.errors import ConfigError, InputError, MapTooLargeError


@pytest.mark.parametrize(
    ("raised", "reason"),
    [
        (zlib.error("Error -3"), "Error -3"),
        (lzma.LZMAError("Corrupt input data"), "Corrupt input data"),
        (tokenize.TokenError("EOF in multi-line string", (1, 10)), "EOF in multi-line string"),
        (RuntimeError("is encrypted"), "is encrypted"),
        (RecursionError("maximum recursion depth exceeded"), "nested too deeply"),
        (MemoryError(), "too large or too deeply nested"),
        (IndexError(), "IndexError"),
        (OSError(5, "Input/output error"), "[Errno 5] Input/output error"),
        (ValueError("two\nlines  and\ta tab"), "two lines and a tab"),
    ],
)
def test_one_line(raised: Exception, reason: str) -> None:
    with (
        pytest.raises(InputError) as caught,
        decoding("a.npz", "corrupt NPZ file", "copy it again"),
    ):
        raise raised
    assert str(caught.value) == f"a.npz: corrupt NPZ file ({reason}): copy it again"
    assert caught.value.__suppress_context__


def test_what_passes() -> None:
    with pytest.raises(MapTooLargeError, match="ours"), decoding("a", "b", "c"):
        raise MapTooLargeError("ours")
    with pytest.raises(KeyboardInterrupt), decoding("a", "b", "c"):
        raise KeyboardInterrupt
    with pytest.raises(ConfigError, match=r"a: b \(1\): c"), decoding("a", "b", "c", ConfigError):
        raise ValueError("1")
