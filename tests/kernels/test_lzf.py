# SPDX-License-Identifier: Apache-2.0
"""The kernel that unpacks LZF against the readable version, on sound and on damaged streams."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from oddsmap.readers.lzf import decompress
from tests.naive.lzf import decompress as readable

literals = st.binary(min_size=1, max_size=32).map(lambda run: bytes([len(run) - 1]) + run)
# Short and long repeats; most refer to something that is there.
repeats = st.builds(
    lambda length, far, near: (
        bytes([length << 5 | far, near]) if length < 7 else bytes([0xE0 | far, length * 9, near])
    ),
    st.integers(1, 7),
    st.sampled_from([0, 0, 0, 1, 31]),
    st.integers(0, 255),
)
streams = st.lists(st.one_of(literals, literals, repeats), max_size=40).map(b"".join)


def outcome(unpack: object, data: bytes, size: int) -> bytes | str:
    try:
        return bytes(unpack(data, size))  # type: ignore[operator]
    except ValueError as error:
        return str(error)


@given(streams, st.integers(0, 30))
@settings(max_examples=500)
def test_both_unpack_and_refuse_the_same(stream: bytes, cut: int) -> None:
    for data in (stream, stream[: max(0, len(stream) - cut)]):
        told = outcome(readable, data, 1 << 16)
        assert isinstance(told, str)
        held = int(told.split()[2]) if told.startswith("it holds") else 0
        for size in (held, held + 1, max(held - 1, 0), 1 << 16):
            want, got = outcome(readable, data, size), outcome(decompress, data, size)
            # Both refuse what is damaged in two ways, one for the one, one for the other.
            assert want == got if isinstance(want, bytes) else isinstance(got, str), size


def test_a_size_that_no_stream_has_takes_no_memory() -> None:
    assert outcome(decompress, b"\x00a", 1 << 60) == f"it holds 1 bytes, {1 << 60} are announced"
