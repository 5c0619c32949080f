# SPDX-License-Identifier: Apache-2.0
"""Recordings of several files, with and without metadata.yaml, and compressed ones."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
import zstandard
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from oddsmap import open_log
from oddsmap.errors import InputError
from oddsmap.recordings.ros_recording import open_ros_recording
from tests.recordings.bags import CONTAINERS, Messages, Said
from tests.recordings.test_recorded_log import SECOND, START, drive

STAMPS = [START + k * SECOND // 10 for k in range(20)]


def stamps_of(path: Path) -> list[int | None]:
    return [scan.stamp_ns for scan in open_log(path)]


def parts(container: str, folder: Path) -> Path:
    """A folder of three files; the first in time is the last by name."""
    messages = Messages(container)
    said = drive(messages)
    folder.mkdir()
    for name, part in zip("cab", (said[:15], said[15:31], said[31:]), strict=True):
        path = messages.write(folder.parent / name, part)
        file = path if path.is_file() else next(path.glob(f"{name}*"))
        file.rename(folder / file.name)
    return folder


@pytest.mark.parametrize("container", CONTAINERS)
def test_files_without_metadata_are_read_in_the_order_of_their_times(
    container: str, tmp_path: Path
) -> None:
    folder = parts(container, tmp_path / "run")
    assert stamps_of(folder) == STAMPS
    recording = open_ros_recording(str(folder))
    assert recording.topics["/scan"].count == 20
    assert recording.span_ns == (START, STAMPS[-1])


@pytest.mark.parametrize("container", ["sqlite3", "mcap"])
def test_files_with_metadata(container: str, tmp_path: Path) -> None:
    folder = parts(container, tmp_path / "run")
    said = yaml.safe_load((tmp_path / "a" / "metadata.yaml").read_text())
    found = said["rosbag2_bagfile_information"]
    suffix = {"sqlite3": "db3", "mcap": "mcap"}[container]
    found["relative_file_paths"] = [f"{name}.{suffix}" for name in "cab"]
    found["message_count"] = 41
    (folder / "metadata.yaml").write_text(yaml.safe_dump(said))
    (folder / f"other.{suffix}").write_bytes(b"not of this recording")
    assert stamps_of(folder) == STAMPS
    (folder / f"a.{suffix}").unlink()
    with pytest.raises(InputError, match=rf"a.{suffix} is missing, which metadata.yaml lists"):
        open_log(folder)
    log = open_log(folder, skip_bad=True)
    list(log)
    assert log.skipped["container.truncated"] == 16


@pytest.mark.parametrize("container", ["sqlite3", "mcap"])
@pytest.mark.parametrize("mode", [CompressionMode.FILE, CompressionMode.MESSAGE])
def test_zstd_of_files_and_messages(container: str, mode: CompressionMode, tmp_path: Path) -> None:
    messages = Messages(container)
    plugin = StoragePlugin[container.upper()]
    writer = Writer2(tmp_path / "run", version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topics = {}
        for topic, log_ns, message in drive(messages):
            kind = message.__msgtype__
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=messages.store)
            writer.write(topics[topic], log_ns, messages.store.serialize_cdr(message, kind))
    assert stamps_of(tmp_path / "run") == STAMPS
    if mode == CompressionMode.FILE:
        (tmp_path / "run" / "metadata.yaml").unlink()
        assert stamps_of(tmp_path / "run") == STAMPS
        file = next((tmp_path / "run").glob("*.zstd"))
        file.write_bytes(file.read_bytes()[:-20])
        with pytest.raises(InputError, match="copy the recording again"):
            open_log(tmp_path / "run")


def test_a_file_of_zeros_does_not_fill_the_disk(tmp_path: Path) -> None:
    stream = zstandard.ZstdCompressor().compressobj()
    content = b"".join(stream.compress(bytes(1 << 20)) for _ in range(300)) + stream.flush()
    (tmp_path / "a.mcap.zstd").write_bytes(content)
    with pytest.raises(InputError, match="holds more than 268 MB, as no recording does"):
        open_log(tmp_path)


def test_two_kinds_of_files_are_asked_about(tmp_path: Path) -> None:
    for container in ("mcap", "sqlite3"):
        messages = Messages(container)
        path = messages.write(tmp_path / container, drive(messages))
        file = next(path.glob(f"{container}*"))
        file.rename(tmp_path / file.name)
    with pytest.raises(InputError, match="files of db3 and mcap in one folder"):
        open_log(tmp_path)


def test_clouds_beside_a_bag_are_what_is_meant(tmp_path: Path) -> None:
    messages = Messages("bag")
    messages.write(tmp_path / "run", drive(messages))
    (tmp_path / "1.pcd").write_text("none")
    with pytest.raises(InputError, match=r"1\.pcd|poses"):
        open_log(tmp_path)


@pytest.mark.parametrize("suffix", ["wal", "journal"])
def test_a_file_beside_a_db3_is_not_passed_over(suffix: str, tmp_path: Path) -> None:
    messages = Messages("sqlite3")
    folder = messages.write(tmp_path / "run", drive(messages))
    beside = folder / f"run.db3-{suffix}"
    beside.write_bytes(b"the last messages")
    with pytest.raises(InputError, match=rf"never closed: run\.db3-{suffix} .* --skip-bad"):
        open_log(folder)
    log = open_log(folder, skip_bad=True)
    assert len(list(log)) == 20
    assert log.skipped == {"container.truncated": 1}
    beside.write_bytes(b"")
    assert open_log(folder).notes == ()


def test_two_topics_of_one_name_and_two_types(tmp_path: Path) -> None:
    messages = Messages("bag")
    said: list[Said] = drive(messages)
    path = messages.write(tmp_path / "a", said)
    other = tmp_path / "run"
    other.mkdir()
    path.rename(other / "a.bag")
    messages.write(other / "b", [("/scan", START, said[1][2])])
    recording = open_ros_recording(str(other))
    assert "two types" in recording.topics["/scan"].problem
    with pytest.raises(InputError, match="/scan cannot be read: it has messages of two types"):
        open_log(other, scans="/scan")
