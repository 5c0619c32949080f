# SPDX-License-Identifier: Apache-2.0
"""Changes of E57 files whose pages get the checksum of what they then hold."""

from __future__ import annotations

import random

from tests.fuzz.bytes_and_lines import change_bytes, flip_bits

__all__ = ["change_pages"]

_PAGE, _HELD = 1024, 1020


def _table() -> list[int]:
    """CRC-32C, byte by byte."""
    table = []
    for value in range(256):
        for _ in range(8):
            value = (value >> 1) ^ (0x82F63B78 if value & 1 else 0)
        table.append(value)
    return table


_CRC = _table()


def change_pages(rng: random.Random, content: bytes) -> tuple[bytes, str]:
    """Change bits or bytes, of which nobody but their meaning tells."""
    changed, what = rng.choice((flip_bits, change_bytes))(rng, content)
    pages = []
    for start in range(0, len(changed), _PAGE):
        held = changed[start : start + _HELD].ljust(_HELD, b"\0")
        crc = 0xFFFFFFFF
        for byte in held:
            crc = (crc >> 8) ^ _CRC[(crc ^ byte) & 0xFF]
        pages.append(held + (crc ^ 0xFFFFFFFF).to_bytes(4, "big"))
    return b"".join(pages), f"{what}, with checksums"
