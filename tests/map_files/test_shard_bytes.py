# SPDX-License-Identifier: Apache-2.0
"""A shard unpacks to no more than it should, and is looked at before it is unpacked."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import zarr
from numcodecs.zstd import Zstd
from zarr.codecs import ZstdCodec

from oddsmap import load_map
from oddsmap.errors import InputError
from oddsmap.map_files.shard_bytes import (
    _crc32c,
    _unpacked_bytes,
    pack_shard,
    shard_index,
    unpack_chunk,
)
from tests.saved_maps_kit import KINDS

CHUNKS = 64


@pytest.fixture
def shard(tmp_path: Path) -> Path:
    KINDS["2D"].make(2).save(tmp_path / "a.zarr")
    return tmp_path / "a.zarr" / "hits" / "c" / "0" / "0"


@pytest.mark.parametrize("size", [1, 255, 256, 257, 65791, 65792, 1 << 20])
def test_the_length_of_a_frame(size: int) -> None:
    for content in (bytes(size), np.random.default_rng(0).bytes(size)):
        assert _unpacked_bytes(Zstd(checksum=True).encode(content)[:18]) == size
    assert _unpacked_bytes(b"\x28\xb5\x2f\xfd\x00\x58\x00") is None  # says nothing
    assert _unpacked_bytes(b"PK\x03\x04 and more") is None


def test_the_checksum_of_an_index() -> None:
    assert _crc32c(b"123456789") == 0xE3069283  # RFC 3720 has it so
    assert _crc32c(bytes(32)) == 0x8A9136AA


@pytest.mark.parametrize("dtype", ["u1", "u2", "u4", "u8", "f4"])
@pytest.mark.parametrize("d", [2, 3])
def test_what_zarr_packs(d: int, dtype: str, tmp_path: Path) -> None:
    shape = (64,) * d
    array = zarr.create_array(
        tmp_path / "a", shape=shape, shards=shape, chunks=(16,) * d, dtype=dtype, fill_value=7
    )
    wanted = np.full(shape, 7, dtype)
    corner = (slice(3, 20),) * d
    wanted[corner] = np.random.default_rng(0).integers(0, 200, (17,) * d)
    array[...] = wanted
    found = np.full(shape, 7, dtype)
    content = (tmp_path / "a" / "c" / "/".join("0" * d)).read_bytes()
    unpack(content, found, 16)
    np.testing.assert_array_equal(found, wanted)
    with pytest.raises(ValueError, match="does not match its checksum"):
        unpack(content[:-1] + b"x", found, 16)


def chunks_of(cells: npt.NDArray[Any], side: int) -> npt.NDArray[Any]:
    """All chunks of a shard in order, shape (n, cells of a chunk)."""
    grid = (cells.shape[0] // side,) * cells.ndim
    return np.stack([cells[where(at, side)].ravel() for at in np.ndindex(grid)])


def where(at: tuple[int, ...], side: int) -> tuple[slice, ...]:
    return tuple(slice(i * side, (i + 1) * side) for i in at)


def unpack(content: bytes, cells: npt.NDArray[Any], side: int) -> None:
    """All that is written of a shard."""
    grid = (cells.shape[0] // side,) * cells.ndim
    for number, frame in shard_index(content, int(np.prod(grid)), "a").items():
        chunk = np.empty(side**cells.ndim, cells.dtype)
        unpack_chunk(frame, chunk, "a")
        at = tuple(int(i) for i in np.unravel_index(number, grid))
        cells[where(at, side)] = chunk.reshape((side,) * cells.ndim)


def refused(shard: Path, content: bytes) -> str:
    shard.write_bytes(content)
    with pytest.raises(InputError) as caught:
        load_map(shard.parents[3])
    return str(caught.value)


def test_a_chunk_that_would_fill_the_memory(shard: Path) -> None:
    content = shard.read_bytes()
    index = np.frombuffer(content[-16 * CHUNKS - 4 : -4], "<u8").reshape(-1, 2)
    start = int(index[index[:, 0] < len(content)][0, 0])
    bomb = b"\x28\xb5\x2f\xfd\xe0" + (1 << 50).to_bytes(8, "little")
    assert "does not unpack to 16384 bytes" in refused(
        shard, content[:start] + bomb + content[start + len(bomb) :]
    )


def test_a_chunk_outside_its_file(shard: Path) -> None:
    content = shard.read_bytes()
    index = (1 << 63).to_bytes(8, "little") * (2 * CHUNKS)
    away = content[: -16 * CHUNKS - 4] + index + _crc32c(index).to_bytes(4, "little")
    assert "lies outside the file" in refused(shard, away)
    assert "is larger than its cells" in refused(shard, bytes(3 << 20))
    assert "less than its index" in refused(shard, content[:100])


def test_a_file_outside_the_map(shard: Path) -> None:
    (shard.parent / "7").write_bytes(shard.read_bytes())
    with pytest.raises(InputError, match=r"a file of shard \(0, 7\) lies outside the map"):
        load_map(shard.parents[3])


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("kind", ["u1", "u2", "<u8", "f4"])
@pytest.mark.parametrize("fill", [0, 3])
def test_what_is_packed_is_unpacked_and_read_by_zarr(
    d: int, kind: str, fill: int, tmp_path: Path
) -> None:
    rng = np.random.default_rng(d)
    cells = np.full((64,) * d, fill, kind)
    cells[(slice(0, 20),) * d] = rng.integers(0, 200, (20,) * d)
    cells[(slice(33, 34),) * d] = fill + 1
    chunks = chunks_of(cells, 16)
    content = pack_shard(np.arange(len(chunks)), chunks, len(chunks), fill)
    # Chunks of nothing may be left out as well.
    some = np.flatnonzero((chunks != fill).any(axis=1))
    assert pack_shard(some, chunks[some], len(chunks), fill) == content
    assert content is not None
    again = np.full_like(cells, fill)
    unpack(content, again, 16)
    np.testing.assert_array_equal(again, cells)
    array: Any = zarr.create_array(
        tmp_path / "a.zarr", shape=cells.shape, chunks=(16,) * d, shards=(64,) * d, dtype=kind,
        fill_value=fill, compressors=ZstdCodec(checksum=True),
    )  # fmt: skip
    file = (tmp_path / "a.zarr").joinpath("c", *"0" * d)
    array[...] = cells
    # The same frames as Zarr's own, which lie in another order.
    assert file.stat().st_size == len(content)
    file.write_bytes(content)
    np.testing.assert_array_equal(zarr.open_array(tmp_path / "a.zarr", mode="r")[...], cells)


def test_a_shard_of_nothing_is_no_file() -> None:
    assert pack_shard(np.arange(16), np.full((16, 256), 7, np.uint8), 16, 7) is None
