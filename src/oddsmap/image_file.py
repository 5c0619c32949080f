# SPDX-License-Identifier: Apache-2.0
"""Images from elsewhere: maps and depth images.

Pillow does not compare the checksums of a PNG's pixels, and knows formats (EPS) that run programs.
"""

from __future__ import annotations

import io
import struct
import zlib
from typing import TYPE_CHECKING

from oddsmap.decoding import decoding
from oddsmap.errors import InputError
from oddsmap.limits import check_content_size

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["image_size", "read_image"]

_FORMATS = ("PNG", "PPM", "BMP", "TIFF", "GIF", "JPEG")
_PNG = b"\x89PNG\r\n\x1a\n"
_FAULT, _ADVICE = "not an image that can be read", "use PNG or PGM, or copy the file again"

# A pixel takes so many bytes while its brightness is computed: four channels, and a float64.
_PIXEL_SIZE = 12


def image_size(where: object, content: bytes) -> tuple[int, int]:
    """Width and height, by the header alone.

    Raises:
        InputError: no image that can be read.
    """
    return _open(where, content).size


def read_image(where: object, content: bytes) -> Image:
    """An image with all its pixels.

    Args:
        where: the file, for messages.
        content: its bytes.

    Raises:
        InputError: no image that can be read, a damaged one, or one too large for memory.
    """
    if content.startswith(_PNG):
        _check_png(where, content)
    image = _open(where, content)
    width, height = image.size
    check_content_size(where, _PIXEL_SIZE * width * height, f"an image of {width} x {height}")
    with decoding(where, _FAULT, _ADVICE):
        image.load()
    return image


def _open(where: object, content: bytes) -> Image:
    from PIL import Image, UnidentifiedImageError

    with decoding(where, _FAULT, _ADVICE):
        try:
            return Image.open(io.BytesIO(content), formats=_FORMATS)
        except UnidentifiedImageError:  # its text is the address of a buffer
            raise InputError(f"{where}: {_FAULT}: {_ADVICE}") from None


def _check_png(where: object, content: bytes) -> None:
    """Compare the checksums of all chunks.

    Raises:
        InputError: one differs, or the file ends before its last chunk.
    """
    at, kind = len(_PNG), b""
    while kind != b"IEND":
        if at + 12 > len(content):
            raise InputError(f"{where}: the PNG is cut off: copy the file again")
        (length,) = struct.unpack_from(">I", content, at)
        kind = content[at + 4 : at + 8]
        end = at + 8 + length
        checksum = content[end : end + 4]
        if zlib.crc32(content[at + 4 : end]) != int.from_bytes(checksum, "big") or not checksum:
            raise InputError(
                f"{where}: the PNG is damaged or cut off (a checksum is wrong at byte {at}): "
                "copy the file again"
            )
        at = end + 4
