# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import bz2
import gzip
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import oddsmap.readers.compression
from oddsmap import limits
from oddsmap.errors import InputError
from oddsmap.readers.compression import HEAD_SIZE, open_source

# Incompressible, so that cutting the file cuts the content about as far.
CONTENT = np.random.default_rng(0).bytes(60_000)
# bzip2 decodes whole blocks of 100 to 900 kB: several are needed for a readable part.
LONG_CONTENT = np.random.default_rng(1).bytes(3_000_000)


@pytest.mark.parametrize("compress", [bytes, gzip.compress, bz2.compress])
def test_content_is_the_same_under_any_compression_and_suffix(
    tmp_path: Path, compress: Callable[[bytes], bytes]
) -> None:
    path = tmp_path / "log.txt"
    path.write_bytes(compress(LONG_CONTENT))
    source = open_source(path)
    assert source.content == LONG_CONTENT
    assert source.head == LONG_CONTENT[:HEAD_SIZE]
    assert source.damage is None
    assert not source.initial_skipped()
    assert source.initial_notes() == []


@pytest.mark.parametrize("compress", [gzip.compress, bz2.compress])
def test_appended_members_and_zero_padding_are_legal(
    tmp_path: Path, compress: Callable[[bytes], bytes]
) -> None:
    path = tmp_path / "log"
    path.write_bytes(compress(b"one\n") + compress(CONTENT) + compress(b"two\n") + bytes(512))
    assert open_source(path).content == b"one\n" + CONTENT + b"two\n"


def test_a_cut_gzip_is_refused_and_its_readable_part_is_used_on_request(tmp_path: Path) -> None:
    path = tmp_path / "hall.log.gz"
    path.write_bytes(gzip.compress(CONTENT)[:30_000])
    with pytest.raises(InputError) as caught:
        open_source(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: truncated gzip file after ")
    assert "copy the file again" in message
    assert "--skip-bad" in message
    assert "\n" not in message

    source = open_source(path, skip_bad=True)
    # All but what is still in the decompressor's hands.
    assert 29_000 < len(source.content) < 30_000
    assert CONTENT.startswith(source.content)
    assert source.initial_skipped() == {"container.truncated": 1}
    assert source.initial_notes() == ["truncated gzip file: only the readable part was used"]


def test_a_cut_bzip2_is_refused_and_its_readable_part_is_used_on_request(tmp_path: Path) -> None:
    path = tmp_path / "hall.log.bz2"
    path.write_bytes(bz2.compress(LONG_CONTENT)[:2_500_000])
    with pytest.raises(InputError, match="truncated bzip2 file after"):
        open_source(path)
    source = open_source(path, skip_bad=True)
    assert len(source.content) > 1_000_000
    assert LONG_CONTENT.startswith(source.content)


def test_a_wrong_checksum_is_corrupt(tmp_path: Path) -> None:
    path = tmp_path / "hall.log.gz"
    damaged = bytearray(gzip.compress(CONTENT))
    damaged[-5] ^= 0xFF  # the CRC is 8 to 5 bytes from the end
    path.write_bytes(damaged)
    with pytest.raises(InputError, match="corrupt gzip file"):
        open_source(path)
    assert open_source(path, skip_bad=True).damage == "corrupt gzip file"


def test_a_damaged_gzip_loses_little_before_the_damage(tmp_path: Path) -> None:
    path = tmp_path / "hall.log.gz"
    text = b"".join(b"FLASER %d 1.5\n" % i for i in range(100_000))
    damaged = bytearray(gzip.compress(text))
    middle = len(damaged) // 2
    damaged[middle : middle + 400] = b"\xff" * 400
    path.write_bytes(damaged)
    source = open_source(path, skip_bad=True)
    assert source.damage == "corrupt gzip file"
    assert text[: int(0.4 * len(text))] == source.content[: int(0.4 * len(text))]


@pytest.mark.parametrize("compress", [gzip.compress, bz2.compress])
def test_a_container_cannot_fill_the_memory(
    tmp_path: Path, compress: Callable[[bytes], bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A few bytes may stand for any number of zeros; a small file is read whole in any case."""
    monkeypatch.setattr(oddsmap.readers.compression, "_ALWAYS_HELD", 4 * 2**20)
    path = tmp_path / "zeros.log"
    for size in (4 * 2**20, 4 * 2**20 + 1, 40 * 2**20):
        path.write_bytes(compress(bytes(size)))
        if size == 4 * 2**20:
            assert len(open_source(path).content) == size
            continue
        tracemalloc.start()
        with pytest.raises(InputError, match=r"zeros.log: \d+ bytes of \w+ hold more than 4 MiB"):
            open_source(path, skip_bad=True)
        assert tracemalloc.get_traced_memory()[1] < 16 * 2**20
        tracemalloc.stop()


def test_other_bytes_after_the_data_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "hall.log.gz"
    path.write_bytes(gzip.compress(CONTENT) + b"rubbish")
    with pytest.raises(InputError, match="bytes that are not gzip follow the data"):
        open_source(path)
    assert open_source(path, skip_bad=True).content == CONTENT


def test_nothing_readable_is_an_error_even_with_skip_bad(tmp_path: Path) -> None:
    path = tmp_path / "hall.log.gz"
    path.write_bytes(gzip.compress(CONTENT)[:5])
    with pytest.raises(InputError, match="nothing in it can be read: copy the file again"):
        open_source(path, skip_bad=True)


def test_missing_directory_and_empty_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        open_source(tmp_path / "none.log")
    assert str(caught.value) == f"{tmp_path / 'none.log'}: no such file: check the path"
    with pytest.raises(InputError) as caught:
        open_source(tmp_path)
    assert str(caught.value).startswith(f"{tmp_path}: is a directory")
    for content in (b"", gzip.compress(b"")):
        (tmp_path / "empty.log").write_bytes(content)
        with pytest.raises(InputError, match=r"empty\.log: the file is empty: check"):
            open_source(tmp_path / "empty.log", skip_bad=True)


def test_an_unreadable_file_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "hall.log"
    path.touch()

    # Tests may run as root, who can read everything.
    def refuse(self: Path) -> bytes:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", refuse)
    with pytest.raises(InputError, match=r"hall\.log: cannot be read \(Permission denied\): check"):
        open_source(path)


@pytest.mark.parametrize("compress", [gzip.compress, bz2.compress])
def test_a_small_file_of_a_large_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compress: Callable[[bytes], bytes]
) -> None:
    path = tmp_path / "hall.log.gz"
    path.write_bytes(compress(bytes(10_000_000)))
    assert path.stat().st_size < 20_000
    assert len(open_source(path).content) == 10_000_000
    monkeypatch.setattr(limits, "memory_limit", lambda: 4_000_000)
    for skip_bad in (False, True):
        with pytest.raises(InputError, match=r"hall\.log\.gz: the decompressed content of the"):
            open_source(path, skip_bad=skip_bad)


def test_a_file_that_memory_would_not_hold(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "hall.log"
    path.write_bytes(bytes(3_000_000))
    monkeypatch.setattr(limits, "memory_limit", lambda: 4_000_000)
    with pytest.raises(InputError, match=r"hall\.log: the file takes 0\.003 GB, at most 0\.002 GB"):
        open_source(path)
