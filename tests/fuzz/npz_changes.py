# SPDX-License-Identifier: Apache-2.0
"""Changes of NPZ files that keep the archive whole: headers of arrays, members, values."""

from __future__ import annotations

import io
import random
import struct
import warnings
import zipfile
from collections.abc import Sequence
from typing import Any

import numpy as np

__all__ = ["change_archive", "change_array", "npz", "repack"]

_HEADERS = (
    "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 4), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999999999, 4), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (4294967296, 4294967296), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (True, 4), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 4), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (0, 4), }",
    "{'descr': '<f8', 'fortran_order': True, 'shape': (2, 4), }",
    "{'descr': '<f8', 'fortran_order': 1, 'shape': (2, 4), }",
    "{'descr': '<f8', 'shape': (2, 4), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': 8, }",
    "{'descr': '|O', 'fortran_order': False, 'shape': (2, 4), }",
    "{'descr': '<U4', 'fortran_order': False, 'shape': (2, 2), }",
    "{'descr': '<c16', 'fortran_order': False, 'shape': (1, 4), }",
    "{'descr': '<m8[ns]', 'fortran_order': False, 'shape': (2, 4), }",
    "{'descr': [('a', '<f8'), ('b', '<f8')], 'fortran_order': False, 'shape': (4,), }",
    "{'descr': '<V0', 'fortran_order': False, 'shape': (2, 4), }",
    "{'descr': 'f' * 10**9, 'fortran_order': False, 'shape': (2, 4), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (" + "1," * 70 + "), }",
    "{'descr': '<f8",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (2, 4), ",
    "(" * 3000,
    "-" * 3000 + "1",
    "[" * 200 + "]" * 200,
    "{" + "'a': 1, " * 2000 + "}",
    "9" * 5000,
    "\0" * 20,
    "__import__('os').mkdir('made')",
)


def npz(arrays: dict[str, Any]) -> bytes:
    """An NPZ as NumPy writes it."""
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def repack(members: Sequence[tuple[str, bytes]], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """A zip archive of some members."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a name may be there twice
        for name, content in members:
            archive.writestr(zipfile.ZipInfo(name), content, method)
    return file.getvalue()


def members_of(content: bytes) -> list[tuple[str, bytes]]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return [(name, archive.read(name)) for name in archive.namelist()]


def change_array(rng: random.Random, content: bytes) -> tuple[bytes, str]:
    """Give an array another header, type, shape or value, or leave it out."""
    members = members_of(content)
    at = rng.randrange(len(members))
    name, data = members[at]
    array = np.load(io.BytesIO(data))
    kind = rng.choice(("header", "header", "value", "value", "type", "shape", "leave out", "name"))
    if kind == "header":
        header = rng.choice(_HEADERS).encode()
        version = rng.choice((1, 1, 1, 2, 3, 9))
        length = struct.pack("<H" if version == 1 else "<I", len(header))
        members[at] = name, b"\x93NUMPY" + bytes([version, 0]) + length + header + data[-64:]
        return repack(members), f"{name}: header {header[:60]!r}, version {version}"
    if kind == "leave out":
        del members[at]
        return repack(members), f"{name} left out"
    if kind == "name":
        members[at] = rng.choice(("x.npy", "", "../a.npy", name[:-4], "\u00e9.npy")), data
        return repack(members), f"{name} becomes {members[at][0]!r}"
    with np.errstate(all="ignore"):
        if kind == "type":
            types = ("f2", "f4", ">f8", "i1", "u8", "i8", "?", "c16", "U5", "S3", "f8")
            array = array.astype(rng.choice(types))
        elif kind == "shape":
            column = array.reshape(-1)
            changes = (column, column[:0], column[:1], array[None], array[..., None], array.T)
            array = rng.choice(changes) if array.ndim else np.full((2, 2), array)
        else:
            array = np.array(array)
            value = rng.choice((np.nan, np.inf, -np.inf, -1, 0, 1e9, 1e-9, 1e300, 1e-300, 2**31, 7))
            flat = array.reshape(-1)
            flat[rng.randrange(flat.size)] = np.asarray(value).astype(array.dtype)
    file = io.BytesIO()
    np.save(file, array)
    members[at] = name, file.getvalue()
    return repack(members), f"{name}: {kind}, {array.dtype} {array.shape}"


def change_archive(rng: random.Random, content: bytes) -> tuple[bytes, str]:
    """Keep the values: another compression, a member more, or a flag that a reader must heed."""
    members = members_of(content)
    kind = rng.choice(("method", "damaged method", "encrypted", "version", "more", "bomb", "twice"))
    method = rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA))
    if kind == "method":
        return repack(members, method), f"method {method}"
    if kind == "damaged method":
        out = bytearray(repack(members, method))
        for _ in range(rng.choice((1, 8))):
            out[rng.randrange(30, len(out) // 2)] ^= 1 << rng.randrange(8)
        return bytes(out), f"damaged, method {method}"
    if kind in ("encrypted", "version"):
        # The place of a field in the index of the archive, which is what readers look at.
        out = bytearray(content)
        index = out.index(b"PK\x01\x02")
        out[index + (8 if kind == "encrypted" else 6)] |= 1 if kind == "encrypted" else 0xFF
        return bytes(out), kind
    if kind == "more":
        return repack([*members, ("readme.txt", b"hello"), ("more.npy", b"")]), "members more"
    if kind == "bomb":
        bomb = b"\x93NUMPY\x01\0" + struct.pack("<H", 70)
        bomb += b"{'descr': '<f8', 'fortran_order': False, 'shape': (25000000,), }".ljust(70)
        return repack([*members, ("zeros.npy", bomb + bytes(1 << 24))]), "a large member"
    return repack([*members, members[0]]), "a member twice"
