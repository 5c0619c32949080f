# SPDX-License-Identifier: Apache-2.0
"""What stands in front of a file and is known last: how many of what there are in it."""

from __future__ import annotations

from typing import BinaryIO

__all__ = ["put_in_front"]

_BLOCK = 1 << 20


def put_in_front(file: BinaryIO, header: bytes) -> None:
    """Write a header before all that a file holds, which moves on: a count is known at the end."""
    end = file.seek(0, 2)
    while end > 0:
        begin = max(0, end - _BLOCK)
        file.seek(begin)
        block = file.read(end - begin)
        file.seek(begin + len(header))
        file.write(block)
        end = begin
    file.seek(0)
    file.write(header)
