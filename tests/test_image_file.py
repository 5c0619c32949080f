# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from oddsmap import limits
from oddsmap.errors import InputError
from oddsmap.image_file import image_size, read_image

PIXELS = np.random.default_rng(1).integers(0, 60_000, (6, 9)).astype(np.uint16)


def encoded(pixels: np.ndarray = PIXELS, form: str = "PNG") -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, form)
    return file.getvalue()


@pytest.mark.parametrize("form", ["PNG", "TIFF"])
def test_pixels_come_back(form: str) -> None:
    assert np.array_equal(np.asarray(read_image("a", encoded(form=form))), PIXELS)
    assert image_size("a", encoded(form=form)) == (9, 6)


def test_no_flipped_bit_of_a_png_passes() -> None:
    """Pillow itself lets pixels through whose checksum is wrong, as another image."""
    content = encoded()
    for place in range(8 * len(content)):
        damaged = bytearray(content)
        damaged[place // 8] ^= 1 << (place % 8)
        with pytest.raises(InputError):
            read_image("a.png", bytes(damaged))
    for end in range(len(content)):
        with pytest.raises(InputError):
            read_image("a.png", content[:end])


def chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def png_of(width: int, height: int) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def test_a_bomb_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(InputError, match=r"a\.png: not an image that can be read \(Image size"):
        read_image("a.png", png_of(2**31 - 1, 2**31 - 1))
    monkeypatch.setattr(limits, "memory_limit", lambda: 1_000_000)
    with pytest.raises(InputError, match=r"a\.png: an image of 1000 x 900 takes 0\.0108 GB"):
        read_image("a.png", png_of(1000, 900))


@pytest.mark.parametrize(
    "content", [b"", b"hello", b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n"]
)
def test_other_files(content: bytes) -> None:
    with pytest.raises(InputError, match=r"a\.png: not an image that can be read: use PNG or PGM"):
        read_image("a.png", content)
