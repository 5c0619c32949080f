# SPDX-License-Identifier: Apache-2.0
"""Changes of any bytes, and of the lines and numbers of any text."""

from __future__ import annotations

import gzip
import random
import re
import zlib
from contextlib import suppress

__all__ = [
    "HOSTILE_NUMBERS",
    "append_noise",
    "change_bytes",
    "change_text",
    "cut",
    "cut_a_member",
    "flip_bits",
    "put_absurd_number",
]

HOSTILE_NUMBERS = (
    "1e999999", "9" * 5000, "-1", "nan", "-nan", "NaN", "inf", "-inf", "99999999999", "0",
    "1e308", "-1e308", "1e-320", "0x10", "1_0", "\u0663", "", "4294967296",
    "18446744073709551616", "1e9", "1e-9", "-0", "2147483648", "'", "true", "1e300", "1e-300",
    "9223372036854775807", "1e22", "1,5", "1" * 400, "3.5", "-99999999999999999999",
)  # fmt: skip

_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


def flip_bits(rng: random.Random, content: bytes) -> tuple[bytes, str]:
    """One to four bits."""
    out = bytearray(content)
    places = [rng.randrange(8 * max(1, len(out))) for _ in range(rng.choice((1, 1, 2, 4)))]
    for place in places:
        if out:
            out[place // 8] ^= 1 << (place % 8)
    return bytes(out), f"bits {places}"


def cut(rng: random.Random, content: bytes) -> tuple[bytes, str]:
    """The end is missing."""
    end = rng.randrange(len(content) + 1)
    return content[:end], f"cut at {end} of {len(content)}"


def cut_a_member(rng: random.Random, content: bytes) -> tuple[bytes, str]:
    """As `cut`, of gzip members, but never between two of them: what is left there is whole."""
    left, what = cut(rng, content)
    with suppress(OSError, EOFError, zlib.error):
        gzip.decompress(left)
        return left[:-1], f"{what}, less one"
    return left, what


def change_bytes(rng: random.Random, content: bytes) -> tuple[bytes, str]:
    """Flip bits, or overwrite, remove, repeat, exchange or insert a block."""
    n = len(content)
    start = rng.randrange(n + 1)
    end = min(n, start + rng.choice((1, 2, 4, 8, 64, 512)))
    block = content[start:end]
    kind = rng.choice(("flip", "flip", "overwrite", "remove", "repeat", "exchange", "insert"))
    if kind == "flip" or not block:
        return flip_bits(rng, content)
    if kind == "overwrite":
        fill = rng.choice((b"\0", b"\xff", b"\x7f", rng.randbytes(1))) * len(block)
        out = content[:start] + fill + content[end:]
    elif kind == "remove":
        out = content[:start] + content[end:]
    elif kind == "repeat":
        out = content[:end] + block * rng.choice((1, 2, 50)) + content[end:]
    elif kind == "exchange":
        other = rng.randrange(n + 1)
        out = content[:other] + block + content[other + len(block) :]
    else:
        out = content[:start] + rng.randbytes(rng.choice((1, 4, 100))) + content[start:]
    return out, f"{kind} {start}:{end}"


def put_absurd_number(rng: random.Random, content: bytes) -> tuple[bytes, str]:
    """Another number of 1 to 8 bytes at some place, as counts, sizes and places are."""
    size = rng.choice((1, 2, 4, 4, 8, 8))
    place = rng.randrange(max(1, len(content) - size))
    old = int.from_bytes(content[place : place + size], "little")
    values = (0, 1, old + 1, old * 2, len(content), 10**6, 1 << 20, 1 << 31, 1 << 40, (1 << 63) - 1)
    value = rng.choice((*values, (1 << 64) - 1)) % (1 << 8 * size)
    order = rng.choice(("little", "little", "big"))
    new = value.to_bytes(size, order)  # type: ignore[arg-type]
    return content[:place] + new + content[place + size :], f"{value} at {place}"


def append_noise(rng: random.Random, content: bytes) -> tuple[bytes, str]:
    """Bytes after the end."""
    tail = rng.choice((b"\0" * rng.choice((1, 16, 4096)), rng.randbytes(20), b"\n"))
    return content + tail, f"{len(tail)} bytes after the end"


def change_text(rng: random.Random, content: bytes) -> tuple[bytes, str]:
    """Put a hostile number, or remove, repeat, exchange or damage lines."""
    kind = rng.choice(
        ("number", "number", "number", "remove", "repeat", "exchange", "word", "long", "odd", "end")
    )
    if kind == "number":
        return _put_number(rng, content)
    lines = content.split(b"\n")
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    if kind == "remove":
        del lines[at]
    elif kind == "repeat":
        lines[at:at] = [lines[at]] * rng.choice((1, 2, 100))
    elif kind == "exchange":
        lines[at], lines[other] = lines[other], lines[at]
    elif kind == "word":
        words = lines[at].split(b" ")
        words[rng.randrange(len(words))] = rng.choice((b"", b"x", b"-", b"\xff\xfe", b'"', b"a b"))
        lines[at] = b" ".join(words)
    elif kind == "long":
        lines[at] += rng.choice((b" 1", b"x", b"[", b"(")) * 5000
    elif kind == "odd":
        odd = rng.choice((b"\xef\xbb\xbf", b"\0", b"\r", b"\x1b[31m", "\u2028".encode(), b"\t"))
        lines[at] = odd + lines[at]
    else:
        return content.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\n"))), "other line ends"
    return b"\n".join(lines), f"{kind} line {at + 1}"


def _put_number(rng: random.Random, content: bytes) -> tuple[bytes, str]:
    found = list(_NUMBER.finditer(content))
    if not found:
        return flip_bits(rng, content)
    # Those of the header, which come first, as often as all the others together.
    place = rng.choice(found[:12] if rng.random() < 0.5 else found)
    word = rng.choice(HOSTILE_NUMBERS)
    out = content[: place.start()] + word.encode() + content[place.end() :]
    return out, f"{place[0][:20].decode()} at {place.start()} becomes {word[:20]}"
