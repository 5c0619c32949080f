# SPDX-License-Identifier: Apache-2.0
"""Changes of PNG and PGM images that keep them whole."""

from __future__ import annotations

import random
import re
import struct
import zlib

__all__ = ["change_chunks", "change_pgm_header"]

_SIZES = (0, 1, 5, 7, 100, 2**16, 2**31 - 1, 2**31, 2**32 - 1, 13_000)


def change_chunks(rng: random.Random, content: bytes) -> tuple[bytes, str]:
    """Change a PNG's header or chunks, with checksums that fit."""
    chunks: list[tuple[bytes, bytes]] = []
    at = 8
    while at < len(content):
        (length,) = struct.unpack_from(">I", content, at)
        chunks.append((content[at + 4 : at + 8], content[at + 8 : at + 8 + length]))
        at += 12 + length
    kind = rng.choice(("size", "size", "depth", "colour", "interlace", "pixels", "order", "odd"))
    header = bytearray(chunks[0][1])
    if kind == "size":
        struct.pack_into(">I", header, rng.choice((0, 4)), rng.choice(_SIZES))
    elif kind in ("depth", "colour", "interlace"):
        header[{"depth": 8, "colour": 9, "interlace": 12}[kind]] = rng.choice(
            (0, 1, 2, 3, 4, 6, 8, 16)
        )
    elif kind == "pixels":
        data = rng.choice((b"", b"x" * 50, zlib.compress(bytes(10)), zlib.compress(bytes(1 << 22))))
        chunks = [(name, data if name == b"IDAT" else body) for name, body in chunks]
    elif kind == "order":
        rng.shuffle(chunks)
    else:
        odd = (
            (b"iCCP", b"x" * 2000),
            (b"zTXt", b"a\0\0" + zlib.compress(bytes(1 << 23))),
            (b"QQQQ", b""),
        )
        chunks.insert(1, rng.choice(odd))
    if kind in ("size", "depth", "colour", "interlace"):
        chunks[0] = chunks[0][0], bytes(header)
    out = content[:8]
    for name, body in chunks:
        out += (
            struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        )
    return out, f"PNG {kind}"


def change_pgm_header(rng: random.Random, content: bytes) -> tuple[bytes, str]:
    """Put other numbers or another magic word into the header."""
    head = re.match(rb"P5\s+\d+\s+\d+\s+\d+\s", content)
    assert head
    numbers = [int(number) for number in re.findall(rb"\d+", head[0][2:])]
    at = rng.randrange(3)
    new = rng.choice((*_SIZES, 99_999_999_999, 10**4000, 255, 65535, 1, -1))
    numbers[at] = new
    magic = rng.choice(("P5", "P5", "P5", "P2", "P6", "P4", "P7", "Pf"))
    words = " ".join(str(n) if n < 10**100 else "9" * 5000 for n in numbers)
    return f"{magic} {words}\n".encode() + content[head.end() :], f"PGM {magic} {words[:60]}"
