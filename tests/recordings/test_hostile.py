# SPDX-License-Identifier: Apache-2.0
"""Files that are made to fill memory or to take for ever: one line, and soon."""

from __future__ import annotations

import bz2
import sqlite3
import struct
from pathlib import Path

import pytest
from lz4.frame import compress as lz4_compress

from oddsmap import open_log
from oddsmap.errors import InputError
from oddsmap.recordings.chunk_content import chunk_content
from oddsmap.recordings.container import ChunkError
from oddsmap.recordings.recording_files import open_container
from oddsmap.recordings.sqlite_pages import SqlitePages
from tests.recordings.bags import Messages
from tests.recordings.test_recorded_log import drive
from tests.recordings.test_salvage import write


@pytest.mark.parametrize(("compress", "name"), [(bz2.compress, "bz2"), (lz4_compress, "lz4")])
def test_a_chunk_holds_what_it_states(compress: object, name: str) -> None:
    data = compress(bytes(1 << 20))  # type: ignore[operator]
    assert chunk_content(data, name, 1 << 20) == bytes(1 << 20)
    with pytest.raises(ChunkError, match="its content is not the 1,000 bytes it states"):
        chunk_content(data, name, 1000)
    with pytest.raises(ChunkError, match="its content is not the 1,048,577 bytes it states"):
        chunk_content(data, name, (1 << 20) + 1)
    with pytest.raises(ChunkError, match=r"states that it holds 4\d{3} MB"):
        chunk_content(data, name, (1 << 32) - 1)
    with pytest.raises(ChunkError, match="compressed by 'xz', which is not read"):
        chunk_content(data, "xz", 1 << 20)


def test_a_checksum_that_is_wrong() -> None:
    with pytest.raises(ChunkError, match="its checksum differs"):
        chunk_content(b"12345", "", 5, 1)


def test_a_bag_whose_index_has_a_chunk_many_times(tmp_path: Path) -> None:
    path = write("bag-bz2", tmp_path / "run")
    content = path.read_bytes()
    places = [k for k in range(len(content)) if content.startswith(b"chunk_pos=", k)]
    first = content[places[0] + 10 : places[0] + 18]
    for place in places:
        content = content[: place + 10] + first + content[place + 18 :]
    path.write_bytes(content)
    with pytest.raises(InputError, match="a chunk within another one"):
        open_log(path)


def test_a_bag_of_what_may_be_chunks_everywhere(tmp_path: Path) -> None:
    path = write("bag", tmp_path / "run")
    content = path.read_bytes()[:4500]
    path.write_bytes(content + b"\x04\0\0\0op=\x05" * 300_000)
    # Some tenths of a second; without a limit it would be minutes.
    with pytest.raises(InputError, match=r"the recording is cut, .* after"):
        open_container(str(path), skip_bad=False)
    assert open_container(str(path), skip_bad=True).damage


def test_an_mcap_whose_index_has_a_chunk_many_times(tmp_path: Path) -> None:
    path = write("mcap-zstd", tmp_path / "run")
    content = bytearray(path.read_bytes())
    content[-12:-8] = bytes(4)  # without a checksum of the summary
    place = struct.unpack_from("<Q", content, len(content) - 28)[0]
    first = None
    while content[place] != 2:
        kind, length = struct.unpack_from("<BQ", content, place)
        if kind == 8:
            first = first or bytes(content[place + 25 : place + 33])
            content[place + 25 : place + 33] = first
        place += 9 + length
    path.write_bytes(content)
    with pytest.raises(InputError, match="a chunk within another one"):
        open_log(path)


def test_a_view_that_never_ends_is_no_table_of_messages(tmp_path: Path) -> None:
    path = tmp_path / "a.db3"
    base = sqlite3.connect(path)
    base.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format)")
    base.execute(
        "CREATE VIEW messages AS WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n) "
        "SELECT k AS id, 1 AS topic_id, k AS timestamp, x'00' AS data FROM n"
    )
    base.close()
    with pytest.raises(InputError, match="without topics and messages: it is no recording"):
        open_log(path)


def test_a_tree_of_pages_that_goes_round(tmp_path: Path) -> None:
    messages = Messages("sqlite3")
    path = next(messages.write(tmp_path / "run", drive(messages)).glob("*.db3"))
    content = bytearray(path.read_bytes())
    # Page 1 as an inner page, all of whose children are itself.
    content[100:112] = bytes([5, 0, 0, 1, 0, 4, 0, 0, 0, 0, 0, 1])
    content[112:1200] = struct.pack(">H", 1200) * 544
    content[1200:1204] = struct.pack(">I", 1)
    path.write_bytes(content)
    assert SqlitePages(str(path)).table("topics") == []
    with pytest.raises(InputError):
        open_container(str(path), skip_bad=True)


def test_metadata_of_another_kind(tmp_path: Path) -> None:
    messages = Messages("mcap")
    folder = messages.write(tmp_path / "run", drive(messages))
    said = folder / "metadata.yaml"
    for text in ("[1, 2", "a: 1", "rosbag2_bagfile_information: 5", "", "&a [*a, *a]"):
        said.write_text(text)
        with pytest.raises(InputError, match=r"metadata\.yaml: .*repair or remove it"):
            open_log(folder)
        assert len(list(open_log(folder, skip_bad=True))) == 20


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"#ROSBAG V1.2\n", "a bag of another version than 2.0"),
        (b"#ROSBAG V2.0\n", "the file ends after 0.013 kB, within a record: copy"),
        (b"\x89MCAP0\r\n", "the file ends after 0.008 kB, within a record: copy"),
        (b"SQLite format 3\0", "the recording is damaged"),
    ],
)
def test_a_file_of_a_first_line(content: bytes, said: str, tmp_path: Path) -> None:
    path = tmp_path / "run"  # the name says nothing
    path.write_bytes(content)
    for skip_bad in (False, True):
        with pytest.raises(InputError, match=said):
            open_log(path, skip_bad=skip_bad)
