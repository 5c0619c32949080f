# SPDX-License-Identifier: Apache-2.0
"""Recordings that were cut, never closed, or damaged: what is left of them is read, and counted."""

from __future__ import annotations

import bz2
import json
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import apsw
import numpy as np
import pytest
import zstandard
from lz4.frame import LZ4FrameDecompressor
from mcap.writer import CompressionType
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag1 import Writer as Writer1
from typer.testing import CliRunner

from oddsmap import build_map, open_log
from oddsmap.cli.app import app
from oddsmap.errors import InputError
from oddsmap.recordings.recording_files import open_container
from oddsmap.recordings.ros_recording import open_ros_recording
from tests.recordings.bags import Messages, Said
from tests.recordings.plain_mcap import PlainMcap
from tests.recordings.test_recorded_log import SECOND, START, drive

Cut = tuple[str, int, bytes]
"""A topic, when it was written, and the bytes of a message."""

_CHUNKS = {
    "bag": "",
    "bag-bz2": "bz2",
    "bag-lz4": "lz4",
    "mcap": "",
    "mcap-lz4": "lz4",
    "mcap-zstd": "zstd",
    "mcap-no-chunks": "",
    "sqlite3": "",
}


def write(kind: str, path: Path) -> Path:
    """A recording of a drive in chunks of some messages each; one file."""
    messages = Messages(kind.split("-")[0])
    said = drive(messages)
    if kind.startswith("bag"):
        return write_bag(messages, said, path.with_suffix(".bag"), _CHUNKS[kind])
    if kind == "sqlite3":
        return next(messages.write(path, said).glob("*.db3"))
    return write_mcap(messages, said, path.with_suffix(".mcap"), kind)


def write_bag(messages: Messages, said: list[Said], path: Path, compression: str) -> Path:
    writer = Writer1(path)
    if compression:
        writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    writer.chunk_threshold = 2000
    with writer:
        topics = {}
        for topic, log_ns, message in said:
            kind = message.__msgtype__
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=messages.store)
            writer.write(topics[topic], log_ns, messages.store.serialize_ros1(message, kind))
    return path


def write_mcap(messages: Messages, said: list[Said], path: Path, kind: str) -> Path:
    compression = CompressionType[_CHUNKS[kind].upper() or "NONE"]
    chunk_size = None if kind == "mcap-no-chunks" else 2000
    file = PlainMcap(path, "ros2", compression, chunk_size)
    known = set()
    for topic, log_ns, message in said:
        name = message.__msgtype__
        if topic not in known:
            known.add(topic)
            text = messages.store.generate_msgdef(name, ros_version=2)[0]
            file.channel(topic, name, "cdr", "ros2msg", text.encode())
        file.write(topic, log_ns, bytes(messages.store.serialize_cdr(message, name)))
    file.close()
    return path


def all_messages(path: Path) -> list[Cut]:
    with AnyReader([path]) as reader:
        return [(c.topic, log_ns, bytes(raw)) for c, log_ns, raw in reader.messages()]


def readable(path: Path, kind: str, cut: int) -> bytes:
    """What of the messages is to be seen in the first bytes of a file, chunk by chunk."""
    content = path.read_bytes()
    if not _CHUNKS[kind]:
        return content[:cut]
    return b"".join(
        _started(_CHUNKS[kind], content[start : min(end, cut)])
        for start, end in chunks(path, content)
        if start < cut
    )


def chunks(path: Path, content: bytes) -> Iterator[tuple[int, int]]:
    """Where the compressed bytes of each chunk are."""
    if path.suffix == ".bag":
        with Reader1(path) as bag:
            for chunk in bag.chunks.values():
                yield chunk.datapos, chunk.datapos + chunk.datasize
        return
    place = 8
    while place < len(content) - 8:
        kind, length = struct.unpack_from("<BQ", content, place)
        place += 9
        if kind == 6:
            name = struct.unpack_from("<I", content, place + 28)[0]
            yield place + 32 + name + 8, place + length
        place += length


def _started(compression: str, data: bytes) -> bytes:
    """What the beginning of something compressed holds, byte by byte."""
    stream = {
        "bz2": bz2.BZ2Decompressor,
        "lz4": LZ4FrameDecompressor,
        "zstd": zstandard.ZstdDecompressor().decompressobj,
    }[compression]()
    return b"".join(stream.decompress(data[k : k + 1]) for k in range(len(data)))


def salvaged(path: Path) -> list[Cut]:
    file = open_container(str(path), skip_bad=True)
    topics = {key: channel.topic for key, channel in file.channels.items()}
    found = [(topics[key], log_ns, bytes(raw)) for key, log_ns, raw, _ in file.raw(topics)]
    assert sum(file.counts.values()) == len(found)
    assert len(file.damage) == 1
    return found


@pytest.mark.parametrize("kind", _CHUNKS)
def test_what_is_left_of_a_cut_file_is_what_a_naive_walk_finds(kind: str, tmp_path: Path) -> None:
    path = write(kind, tmp_path / "run")
    whole = all_messages(path)
    size = path.stat().st_size
    cut_file = tmp_path / f"cut{path.suffix}"
    counts = []
    for cut in np.linspace(20, size - 1, 20).astype(int).tolist():
        cut_file.write_bytes(path.read_bytes()[:cut])
        with pytest.raises(InputError) as caught:
            open_container(str(cut_file), skip_bad=False)
        text = str(caught.value)
        assert "\n" not in text
        seen = readable(path, kind, cut)
        want = [each for each in whole if each[2] in seen]
        found = []
        with suppress(InputError):  # nothing of it can be read
            found = salvaged(cut_file)
        if found:
            assert "after" in text
            assert "--skip-bad" in text
        assert found == want, f"cut at {cut} of {size}"
        counts.append(len(found))
    assert counts[0] == 0
    assert counts[-1] >= len(whole) - 1
    assert len(set(counts)) > 4


def test_long_rows_of_sqlite_go_on_on_other_pages(tmp_path: Path) -> None:
    messages = Messages("sqlite3")
    rng = np.random.default_rng(1)
    said: list[Said] = [
        ("/scan", START + k, messages.laser(START + k, "laser", rng.uniform(1, 9, size)))
        for k, size in enumerate(rng.integers(10, 6000, 60).tolist())
    ]
    path = next(messages.write(tmp_path / "run", said).glob("*.db3"))
    whole = all_messages(path)
    base = apsw.Connection(str(path))
    # By SQLite itself: the pages of a leaf and of the chains that its rows go on on.
    leaves: list[tuple[str, int, int]] = []
    chains: dict[str, list[int]] = {}
    for name, number, kind, cells in base.execute(
        "SELECT path, pageno, pagetype, ncell FROM dbstat WHERE name = 'messages' ORDER BY path"
    ):
        if kind == "leaf":
            leaves.append((name, number, cells))
        elif kind == "overflow":
            chains.setdefault(name.split("+")[0], []).append(number)
    pages = [
        [number, *chains.get(f"{name}{cell:03x}", [])]
        for name, number, cells in leaves
        for cell in range(cells)
    ]
    assert len(pages) == len(whole)
    size = path.stat().st_size // 4096
    for left in range(8, size, size // 20):
        cut_file = tmp_path / "cut.db3"
        cut_file.write_bytes(path.read_bytes()[: left * 4096])
        want = [each for each, needs in zip(whole, pages, strict=True) if max(needs) <= left]
        assert salvaged(cut_file) == want


def test_a_bag_that_was_never_closed(tmp_path: Path) -> None:
    path = write("bag", tmp_path / "run")
    whole = all_messages(path)
    content = bytearray(path.read_bytes())
    at = content.index(b"index_pos=") + 10
    index = int.from_bytes(content[at : at + 8], "little")
    content[at : at + 8] = bytes(8)
    path.write_bytes(content[:index])
    with pytest.raises(InputError, match=r"never closed: it has no index after .* --skip-bad"):
        open_log(path)
    assert salvaged(path) == whole


@pytest.mark.parametrize("kind", ["bag", "bag-bz2", "bag-lz4"])
def test_the_chunk_that_a_killed_recorder_was_writing(kind: str, tmp_path: Path) -> None:
    # Its header states the size 0 until it is closed, and its messages are behind it.
    path = write(kind, tmp_path / "run")
    whole = all_messages(path)
    content = bytearray(path.read_bytes())
    with Reader1(path) as bag:
        chunk = list(bag.chunks.values())[-2]
        behind = [each.datapos for each in bag.chunks.values()][-1]
    start, end = chunk.datapos, chunk.datapos + chunk.datasize
    before = readable(path, kind, start)
    there = [each for each in whole if each[2] in readable(path, kind, end)]
    assert len(there) > sum(each[2] in before for each in whole)
    assert end < behind
    content[start - 4 : start] = bytes(4)
    place = content.rindex(b"size=", 0, start)
    content[place + 5 : place + 9] = bytes(4)
    at = content.index(b"index_pos=") + 10
    content[at : at + 8] = bytes(8)
    active = tmp_path / "run.bag.active"
    active.write_bytes(content[:end])
    assert salvaged(active) == there
    active.write_bytes(content[:end] + bytes(40))  # as some file systems leave it
    assert salvaged(active) == there
    with pytest.raises(InputError, match="never closed"):
        open_log(active)


@pytest.mark.parametrize("kind", ["bag-bz2", "bag-lz4", "mcap-zstd", "mcap-lz4"])
@pytest.mark.parametrize("indexed", [True, False])
def test_a_damaged_chunk_is_lost_and_counted(kind: str, indexed: bool, tmp_path: Path) -> None:
    path = write(kind, tmp_path / "run")
    whole = all_messages(path)
    content = bytearray(path.read_bytes())
    start, end = list(chunks(path, bytes(content)))[2]
    # What is in it, by a cut before it and after it.
    lost = [
        each
        for each in whole
        if each[2] in readable(path, kind, end) and each[2] not in readable(path, kind, start)
    ]
    assert lost
    # In the middle; but LZ4 of bags has no checksum, and what it says of itself is at its start.
    content[start if kind == "bag-lz4" else (start + end) // 2] ^= 16
    path.write_bytes(content if indexed else content[:-60])
    with pytest.raises(InputError, match=r"damaged chunk|is cut") as caught:
        list(open_log(path))
    assert "--skip-bad" in str(caught.value)
    recording = open_ros_recording(str(path), skip_bad=True)
    found = [(each.topic, each.log_ns) for each in recording.messages(recording.topics)]
    assert found == [each[:2] for each in whole if each not in lost]
    known = [each for each in recording.damage if "chunk" in each.text]
    counted = [each.messages for each in known]
    assert counted == ([len(lost)] if indexed or kind.startswith("mcap") else [None])


def test_a_bag_without_an_index_is_gone_on_with_behind_damage(tmp_path: Path) -> None:
    path = write("bag-lz4", tmp_path / "run")
    whole = all_messages(path)
    content = bytearray(path.read_bytes())
    (start, end), (after, _) = list(chunks(path, bytes(content)))[2:4]
    lost = [
        each
        for each in whole
        if each[2] in readable(path, "bag-lz4", end)
        and each[2] not in readable(path, "bag-lz4", start)
    ]
    # The header of a chunk, and all up to the next one.
    content[start - 60 : after - 80] = bytes(range(256)) * 8
    path.write_bytes(content[:-60])
    with pytest.raises(InputError, match="bytes that are no records after"):
        open_log(path)
    file = open_container(str(path), skip_bad=True)
    topics = {key: channel.topic for key, channel in file.channels.items()}
    found = [(topics[key], log_ns, bytes(raw)) for key, log_ns, raw, _ in file.raw(topics)]
    assert found == [each for each in whole if each not in lost]
    assert len(file.damage) == 2


def test_a_log_says_what_it_lost(tmp_path: Path) -> None:
    path = write("mcap-zstd", tmp_path / "run")
    content = bytearray(path.read_bytes())
    start, end = list(chunks(path, bytes(content)))[2]
    content[(start + end) // 2] ^= 16
    path.write_bytes(content)
    log = open_log(path, skip_bad=True)
    scans = list(log)
    assert 0 < len(scans) < 20
    lost = log.skipped["container.truncated"]
    assert lost == 41 - len(all_left(path))
    assert [note.code for note in log.notes] == ["container.truncated"]
    assert f": {lost} messages (" in log.notes[0]
    report = build_map(log, 0.1).report
    assert report is not None
    assert report.skipped["container.truncated"] == lost


def test_info_lists_the_damage_and_the_command_that_goes_around_it(tmp_path: Path) -> None:
    path = write("mcap-zstd", tmp_path / "run")
    path.write_bytes(path.read_bytes()[:-5])
    done = CliRunner().invoke(app, ["info", str(path), "--json"])
    facts = json.loads(done.stdout)
    (damage,) = facts["damage"]
    assert damage.startswith("the recording is cut or was never closed: it ends after ")
    assert "--skip-bad" in facts["map it"][0]


def all_left(path: Path) -> list[int]:
    recording = open_ros_recording(str(path), skip_bad=True)
    return [each.log_ns for each in recording.messages(recording.topics)]


@pytest.mark.parametrize("container", ["sqlite3", "mcap"])
def test_metadata_say_how_much_is_lost(container: str, tmp_path: Path) -> None:
    messages = Messages(container)
    folder = messages.write(tmp_path / "run", drive(messages))
    file = next(folder.glob("run*"))
    kept = 0.9 if container == "sqlite3" else 0.6
    file.write_bytes(file.read_bytes()[: int(kept * file.stat().st_size)])
    recording = open_ros_recording(str(folder), skip_bad=True)
    left = list(recording.messages(recording.topics))
    (damage,) = recording.damage
    assert damage.messages == 41 - len(left)
    last = START + 19 * SECOND // 10
    assert damage.seconds == pytest.approx((last - left[-1].log_ns) / 1e9)


def test_metadata_that_list_more_than_there_is_are_a_warning(tmp_path: Path) -> None:
    messages = Messages("mcap")
    folder = messages.write(tmp_path / "run", drive(messages))
    said = folder / "metadata.yaml"
    said.write_text(said.read_text().replace("message_count: 41", "message_count: 50"))
    log = open_log(folder)
    assert len(list(log)) == 20
    assert "lists more messages than there are: 9 messages" in log.notes[0]


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "part", "count"),
    [("ros1/guardian_3.bag", 0.66, 34_229), ("nav2_turtlebot_tf_only.mcap", 0.55, 6_174)],
)
def test_cut_recordings_of_robots(
    name: str, part: float, count: int, data_folder: Path, tmp_path: Path
) -> None:
    path = data_folder / "ros" / name
    cut = tmp_path / f"cut{path.suffix}"
    cut.write_bytes(path.read_bytes()[: int(part * path.stat().st_size)])
    file = open_container(str(cut), skip_bad=True)
    assert sum(file.counts.values()) == count
