# SPDX-License-Identifier: Apache-2.0
"""The arrays of an NPZ file: which there are, and those that a layout knows.

Not by `numpy.load`, which allocates what the header of an array announces before it looks at what
the file holds, and passes over a member whose name is damaged.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections import Counter
from collections.abc import Collection, Sequence
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from oddsmap.decoding import decoding
from oddsmap.errors import InputError, shown
from oddsmap.limits import check_content_size
from oddsmap.readers.compression import Source

__all__ = ["array_names", "load_arrays", "load_found_arrays"]

_FAULT, _ADVICE = "corrupt or truncated NPZ file", "copy or write it again"
_SUFFIX = ".npy"
_PIECE_SIZE = 1 << 20  # bytes that are decompressed at a time

_METHODS = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA}
_ENCRYPTED = 0x1  # a bit of the flags
_END_OF_INDEX = b"PK\x05\x06"
_COUNT_ELSEWHERE = 0xFFFF  # in ZIP64's own end of the index


def array_names(source: Source) -> set[str]:
    """Names of the arrays in an NPZ file.

    The index is at the end of the file: no start of it would do, since the first array may be
    large.

    Raises:
        InputError: the index is damaged.
    """
    with _opened(source) as file:
        return {info.filename.removesuffix(_SUFFIX) for info in file.infolist()}


def load_arrays(source: Source, keys: Collection[str], main: str, write: str) -> dict[str, Any]:
    """Load the arrays that a layout knows; the others are not even decompressed.

    Args:
        source: the content of the file.
        keys: their names.
        main: the one that must be there.
        write: what to write as that one, for the message.

    Returns:
        Those of `keys` that are in the file.

    Raises:
        InputError: a corrupt file, an array of objects, or no `main`.
    """
    arrays = load_found_arrays(source, keys)
    if main not in arrays:
        found = ", ".join(sorted(array_names(source))[:12])
        raise InputError(
            f"{source.path}: no array `{main}` in the NPZ file, found {found or 'none'}: {write}"
        )
    return arrays


def load_found_arrays(source: Source, keys: Collection[str]) -> dict[str, npt.NDArray[Any]]:
    """Load those of some arrays that are in an NPZ file.

    Raises:
        InputError: a corrupt file, one that memory could not hold, or an array of objects.
    """
    with _opened(source) as file:
        infos = file.infolist()
        _check_members(source.path, source.content, file, infos)
        wanted = {
            name: info
            for info in infos
            if (name := info.filename.removesuffix(_SUFFIX)) in keys and name != info.filename
        }
        size = sum(info.file_size for info in wanted.values())
        check_content_size(source.path, size, "the decompressed NPZ file")
        return {name: _read_array(source.path, file, info) for name, info in wanted.items()}


def _opened(source: Source) -> zipfile.ZipFile:
    with decoding(source.path, _FAULT, _ADVICE):
        return zipfile.ZipFile(io.BytesIO(source.content))


def _check_members(
    path: str, content: bytes, file: zipfile.ZipFile, infos: Sequence[zipfile.ZipInfo]
) -> None:
    """Refuse an archive in which a member is not what the index says, known to a layout or not.

    A damaged name or length would leave arrays out without a word.
    """
    announced = _announced_count(content)
    if announced not in (len(infos), _COUNT_ELSEWHERE):
        raise InputError(
            f"{path}: {_FAULT} ({announced} arrays are announced, {len(infos)} found): {_ADVICE}"
        )
    names = Counter(info.filename for info in infos)
    for info in infos:
        name = shown(info.filename)
        if names[info.filename] > 1:
            raise InputError(
                f"{path}: the array {name} is in the NPZ file {names[info.filename]} times: "
                "write each once"
            )
        if info.flag_bits & _ENCRYPTED:
            raise InputError(
                f"{path}: {name} in the NPZ file is encrypted: write it without a password"
            )
        if info.compress_type not in _METHODS:
            raise InputError(
                f"{path}: {name} in the NPZ file is compressed by method {info.compress_type}: "
                "write it with numpy.savez or savez_compressed"
            )
        with decoding(path, _FAULT, _ADVICE), file.open(info):
            pass  # the name before its data is compared with that in the index


def _announced_count(content: bytes) -> int:
    """How many members the end of the index announces, which zipfile does not look at."""
    at = content.rfind(_END_OF_INDEX)
    return int.from_bytes(content[at + 10 : at + 12], "little")


def _read_array(path: str, file: zipfile.ZipFile, info: zipfile.ZipInfo) -> npt.NDArray[Any]:
    name = info.filename.removesuffix(_SUFFIX)
    with decoding(path, _FAULT, _ADVICE):
        member = file.open(info)
    with member:
        with decoding(path, _FAULT, _ADVICE):
            start = io.BytesIO(member.read(_PIECE_SIZE))
        shape, fortran_order, dtype = _read_header(path, name, start)
        count = math.prod(shape)
        held = info.file_size - start.tell()
        if count * dtype.itemsize != held:
            raise InputError(
                f"{path}: `{name}` announces {shown(shape)} of {dtype}, its data are {held} bytes, "
                f"{held // dtype.itemsize} numbers: copy or write the file again"
            )
        data = np.empty(held, np.uint8)
        with decoding(path, _FAULT, _ADVICE):
            _fill(start.read(), member, data)
    return data.view(dtype).reshape(shape, order="F" if fortran_order else "C")


def _read_header(
    path: str, name: str, member: io.BytesIO
) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    fault = f"an array in the NPZ file cannot be read: `{name}`"
    with decoding(path, fault, "write plain arrays of numbers"):
        version = np.lib.format.read_magic(member)
        if version == (1, 0):
            shape, fortran_order, dtype = np.lib.format.read_array_header_1_0(member)
        else:  # names what it does not know
            shape, fortran_order, dtype = np.lib.format.read_array_header_2_0(member)
        if dtype.hasobject or dtype.names is not None or dtype.subdtype is not None:
            raise ValueError(f"it holds {shown(str(dtype))}, not numbers")
        if any(type(side) is not int or side < 0 for side in shape) or len(shape) > 8:
            raise ValueError(f"no shape: {shown(shape)}")
        if dtype.itemsize == 0:
            raise ValueError(f"{dtype} has no bytes")
    return shape, fortran_order, dtype


def _fill(first: bytes, member: IO[bytes], data: npt.NDArray[np.uint8]) -> None:
    """Decompress into `data` what follows `first`; the checksum is compared at the end."""
    at, piece = 0, first
    while piece:
        data[at : at + len(piece)] = np.frombuffer(piece, np.uint8)
        at += len(piece)
        piece = member.read(_PIECE_SIZE)
    if at != len(data):
        raise EOFError(f"{at} of {len(data)} bytes")
