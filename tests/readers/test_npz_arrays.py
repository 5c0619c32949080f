# SPDX-License-Identifier: Apache-2.0
"""Arrays of an NPZ file: those that are whole, and what is wrong with the others in one line."""

from __future__ import annotations

import io
import struct
import zipfile
from typing import Any

import numpy as np
import pytest

from oddsmap import limits
from oddsmap.errors import InputError
from oddsmap.readers.compression import Source
from oddsmap.readers.npz_arrays import load_arrays, load_found_arrays

VALUES = np.arange(12.0).reshape(3, 4)


def load(content: bytes) -> dict[str, Any]:
    return load_arrays(Source("a.npz", content), ("beams", "scan"), "beams", "write beams")


def archive(members: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as whole:
        for name, content in members.items():
            whole.writestr(name, content)
    return file.getvalue()


def npy(array: Any) -> bytes:
    file = io.BytesIO()
    np.save(file, array, allow_pickle=True)
    return file.getvalue()


def with_header(text: str, data: bytes = VALUES.tobytes(), version: int = 1) -> bytes:
    length = struct.pack("<H" if version == 1 else "<I", len(text))
    return b"\x93NUMPY" + bytes([version, 0]) + length + text.encode() + data


@pytest.mark.parametrize(
    "array",
    [
        VALUES,
        np.asfortranarray(VALUES),
        VALUES.astype(">f4"),
        np.array(3.5),
        np.zeros((0, 4)),
        np.arange(300_000),
        np.array([True, False]),
        np.arange(24, dtype=np.uint8).reshape(2, 3, 4).transpose(2, 0, 1),
    ],
)
@pytest.mark.parametrize("method", [0, 8, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_the_same_as_numpy_reads(array: Any, method: int) -> None:
    content = archive({"beams.npy": npy(array)}, method)
    theirs = np.load(io.BytesIO(content))["beams"]
    ours = load(content)["beams"]
    assert (ours.dtype, ours.shape) == (theirs.dtype, theirs.shape)
    assert np.array_equal(ours, theirs)
    assert ours.flags.c_contiguous == theirs.flags.c_contiguous


SHAPE = "{{'descr': '<f8', 'fortran_order': False, 'shape': {}, }}"


@pytest.mark.parametrize(
    ("header", "message"),
    [
        (
            SHAPE.format("(1000000000000, 4)"),
            "`beams` announces (1000000000000, 4) of float64, its data are 96 bytes, 12 numbers",
        ),
        (SHAPE.format("(99999999999999999999, 4)"), "its data are 96 bytes"),
        (SHAPE.format("(2, 4)"), "announces (2, 4) of float64, its data are 96 bytes"),
        (SHAPE.format("(True, 12)"), "no shape: (True, 12)"),
        (SHAPE.format("(-3, -4)"), "no shape: (-3, -4)"),
        (SHAPE.format("12"), "cannot be read: `beams` ("),
        ("{'descr': '<f8", "cannot be read: `beams` ("),
        ("(" * 3000, "cannot be read: `beams` ("),
        ("-" * 3000 + "1", "cannot be read: `beams` ("),
        ("{'descr': '|O', 'fortran_order': False, 'shape': (3,), }", "holds 'object', not numbers"),
        ("{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (12,), }", "not numbers"),
    ],
)
def test_headers_that_lie(header: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        load(archive({"beams.npy": with_header(header)}))
    assert message in str(caught.value)
    assert str(caught.value).startswith("a.npz: ")


def edited(content: bytes, offset: int, bits: int) -> bytes:
    """Change a byte of the first entry of the index."""
    out = bytearray(content)
    out[out.index(b"PK\x01\x02") + offset] ^= bits
    return bytes(out)


GOOD = archive({"beams.npy": npy(VALUES), "scan.npy": npy(np.arange(3))})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (edited(GOOD, 8, 1), "'beams.npy' in the NPZ file is encrypted: write it without a"),
        (edited(GOOD, 6, 0xFF), "corrupt or truncated NPZ file"),
        (edited(GOOD, 10, 0x7F), "compressed by method 119: write it with numpy"),
        (edited(GOOD, 46, 0x20), "corrupt or truncated NPZ file"),
        (edited(GOOD, 33, 0x01), r"corrupt or truncated NPZ file \(2 arrays are announced, 1"),
        (GOOD[:-30], "corrupt or truncated NPZ file"),
        (archive({"beams.npy": npy(VALUES)[:-8]}), "announces .3, 4. of float64, its data are 88"),
        (archive({"scan.npy": npy(VALUES)}), "no array `beams` in the NPZ file, found scan: write"),
        (archive({}), "no array `beams` in the NPZ file, found none"),
        (archive({"beams": npy(VALUES)}), "no array `beams` in the NPZ file, found beams"),
    ],
)
def test_archives_that_are_not_whole(content: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load(content)


def test_an_array_twice() -> None:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as whole:
        whole.writestr("beams.npy", npy(VALUES))
        with pytest.warns(UserWarning, match="Duplicate name"):
            whole.writestr("beams.npy", npy(VALUES + 1))
    with pytest.raises(InputError, match=r"the array 'beams\.npy' is in the NPZ file 2 times"):
        load(file.getvalue())


def test_no_flipped_bit_changes_a_value() -> None:
    """Dates and the like may change; a name that is left out may not."""
    rng = np.random.default_rng(1)
    for place in rng.integers(0, 8 * len(GOOD), 1000).tolist():
        damaged = bytearray(GOOD)
        damaged[place // 8] ^= 1 << (place % 8)
        try:
            arrays = load(bytes(damaged))
        except InputError:
            continue
        assert np.array_equal(arrays["beams"], VALUES), place
        assert np.array_equal(arrays["scan"], np.arange(3)), place


def test_a_small_file_of_a_large_array(monkeypatch: pytest.MonkeyPatch) -> None:
    content = archive({"beams.npy": npy(np.zeros((100_000, 4))), "other.npy": npy(VALUES)})
    assert len(content) < 10_000
    monkeypatch.setattr(limits, "memory_limit", lambda: 4_000_000)
    with pytest.raises(InputError, match=r"a\.npz: the decompressed NPZ file takes 0\.0032 GB"):
        load(content)
    # What a layout does not know is not decompressed, and does not count.
    assert list(load_found_arrays(Source("a.npz", content), ("other",))) == ["other"]
