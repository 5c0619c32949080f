# SPDX-License-Identifier: Apache-2.0
"""MCAP files of other programs: any profile, each channel by its own encoding and schema."""

from __future__ import annotations

import base64
import json
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pb2 import FileDescriptorSet as Files
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from oddsmap import BeamSensor, Pose3, Scan, build_map, open_log
from oddsmap.errors import InputError
from oddsmap.recordings.container import Channel
from oddsmap.recordings.decoders import decoder_of
from oddsmap.recordings.ros_recording import open_ros_recording
from oddsmap.recordings.summary import describe
from tests.kit import votes_of
from tests.recordings.bags import Messages
from tests.recordings.plain_mcap import PlainMcap, write_json
from tests.recordings.test_recorded_log import SECOND, START, drive

SENSOR = BeamSensor(range_max=30.0)


def stamp(now: int) -> dict[str, int]:
    return {"sec": now // SECOND, "nsec": now % SECOND}


def vector(x: float, y: float, z: float) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}


def turn(yaw: float) -> dict[str, float]:
    return {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}


def transform(now: int, parent: str, child: str, at: Any, yaw: float) -> dict[str, Any]:
    return {
        "timestamp": stamp(now),
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": vector(*at),
        "rotation": turn(yaw),
    }


def laser(now: int, ranges: Any, **more: Any) -> dict[str, Any]:
    # The step of the ROS message is a float of 4 bytes.
    end = float(np.float32(0.1)) * (len(ranges) - 1)
    return {
        "timestamp": stamp(now),
        "frame_id": "laser",
        "start_angle": 0.0,
        "end_angle": end,
        "ranges": ranges,
        "intensities": [],
        **more,
    }


def foxglove_drive() -> list[tuple[str, int, str, Any]]:
    """The drive of the recordings of ROS, in Foxglove's messages."""
    rng = np.random.default_rng(0)
    fixed = transform(START, "base", "laser", (0.2, 0.0, 0.3), 0.0)
    said: list[tuple[str, int, str, Any]] = [
        ("/mount", START, "foxglove.FrameTransforms", {"transforms": [fixed]})
    ]
    for k in range(20):
        now = START + k * SECOND // 10
        moved = transform(now, "map", "base", (0.05 * k, 0.01 * k, 0.0), 0.02 * k)
        said.append(("/tf", now, "foxglove.FrameTransform", moved))
        ranges = rng.uniform(3.0, 5.0, 60).astype(np.float32).astype(float).tolist()
        said.append(("/scan", now, "foxglove.LaserScan", laser(now, ranges)))
    return said


def scans_of(path: Path, **how: Any) -> list[Scan]:
    return list(open_log(path, **how))


def same(one: list[Scan], other: list[Scan]) -> None:
    assert len(one) == len(other) == 20
    for a, b in zip(one, other, strict=True):
        assert a.stamp_ns == b.stamp_ns
        np.testing.assert_array_equal(a.map_from_sensor.translation, b.map_from_sensor.translation)
        np.testing.assert_array_equal(a.ranges, b.ranges)
        np.testing.assert_allclose(a.directions, b.directions, atol=1e-15)
    assert votes_of(build_map(one, 0.1, sensor=SENSOR)) == votes_of(
        build_map(other, 0.1, sensor=SENSOR)
    )


@pytest.fixture(scope="module")
def drive_of_ros(tmp_path_factory: pytest.TempPathFactory) -> list[Scan]:
    messages = Messages("mcap")
    return scans_of(messages.write(tmp_path_factory.mktemp("ros") / "run", drive(messages)))


@pytest.mark.parametrize("profile", ["", "custom-of-ours", "ros1"])
def test_json_of_foxglove_is_the_same_drive(
    profile: str, drive_of_ros: list[Scan], tmp_path: Path
) -> None:
    path = write_json(tmp_path / "run.mcap", foxglove_drive(), profile=profile)
    same(scans_of(path), drive_of_ros)
    log = open_log(path)
    assert dict(log.sensor) == {}  # its messages state no ranges
    assert log.format == "MCAP"


def test_protobuf_of_foxglove_is_the_same_drive(drive_of_ros: list[Scan], tmp_path: Path) -> None:
    files, kinds = foxglove_protobuf()
    file = PlainMcap(tmp_path / "run.mcap")
    known = set()
    for topic, now, kind, values in foxglove_drive():
        if topic not in known:
            known.add(topic)
            file.channel(topic, kind, "protobuf", "protobuf", files.SerializeToString())
        file.write(topic, now, filled(kinds(kind)(), values).SerializeToString())
    file.close()
    same(scans_of(tmp_path / "run.mcap"), drive_of_ros)


@pytest.mark.parametrize("encoding", ["ros1", "cdr", "cdr-idl"])
def test_messages_of_ros_in_a_file_of_another_profile(
    encoding: str, drive_of_ros: list[Scan], tmp_path: Path
) -> None:
    messages = Messages("bag" if encoding == "ros1" else "mcap")
    store = messages.store
    file = PlainMcap(tmp_path / "run.mcap", "of ours")
    known = set()
    for topic, now, message in drive(messages):
        kind = message.__msgtype__
        if topic not in known:
            known.add(topic)
            text = store.generate_msgdef(kind, ros_version=1 if encoding == "ros1" else 2)[0]
            name = kind.replace("/msg/", "/") if encoding == "ros1" else kind
            how = {"ros1": "ros1msg", "cdr": "ros2msg", "cdr-idl": "ros2idl"}[encoding]
            schema = text if how != "ros2idl" else idl_of(kind)
            file.channel(topic, name, encoding.removesuffix("-idl"), how, schema.encode())
        write = store.serialize_ros1 if encoding == "ros1" else store.serialize_cdr
        file.write(topic, now, bytes(write(message, kind)))
    file.close()
    same(scans_of(tmp_path / "run.mcap"), drive_of_ros)


def idl_of(kind: str) -> str:
    """The types of a message as IDL, each in a part of its own, as rosbag2 writes them."""
    store: Any = get_typestore(Stores.ROS2_JAZZY)
    parts, waiting = {}, [kind]
    words = {"float32": "float", "float64": "double", "string": "string", "int32": "int32"}
    words |= {"uint32": "uint32"}
    while waiting:
        name = waiting.pop()
        if name in parts:
            continue
        package, short = name.split("/msg/")
        fields = []
        for field, (node, what) in store.fielddefs[name][1]:
            inner, name_or_kind = what[0] if node == Nodetype.SEQUENCE else (node, what)
            if inner == Nodetype.NAME:
                waiting.append(name_or_kind)
                text = name_or_kind.replace("/", "::")
            else:
                text = words[name_or_kind[0]]
            fields.append(f"{f'sequence<{text}>' if node == Nodetype.SEQUENCE else text} {field};")
        body = " ".join(fields)
        parts[name] = f"module {package} {{ module msg {{ struct {short} {{ {body} }}; }}; }};\n"
    line = "=" * 80 + "\n"
    return "".join(f"{line}IDL: {name}\n{text}" for name, text in parts.items())


def cloud(now: int, points: Any, pose: Any = None, **more: Any) -> dict[str, Any]:
    table = np.zeros(len(points), [("x", "<f4"), ("y", "<f8"), ("z", "<i2"), ("t", "<u4")])
    for axis, name in enumerate("xyz"):
        table[name] = np.array(points)[:, axis]
    table["t"] = np.arange(len(points)) * 50_000_000
    kinds = {"<f4": "FLOAT32", "<f8": 8, "<i2": 4, "<u4": "UINT32"}
    return {
        "timestamp": stamp(now),
        "frame_id": "base",
        "pose": pose or {"position": vector(0, 0, 0), "orientation": turn(0.0)},
        "point_stride": table.dtype.itemsize,
        "fields": [
            {"name": name, "offset": offset, "type": kinds[kind.str]}
            for name, (kind, offset, *_) in (table.dtype.fields or {}).items()
        ],
        "data": base64.b64encode(table.tobytes()).decode(),
        **more,
    }


def test_clouds_with_packed_points_and_a_pose_of_their_own(tmp_path: Path) -> None:
    pose = {"position": vector(0.5, 0.0, 1.0), "orientation": turn(math.pi / 2)}
    points = [[3.0, 1.0, 2.0], [4.0, -1.5, -1.0]]
    said: list[tuple[str, int, str, Any]] = []
    for k in range(4):
        now = START + k * SECOND // 10
        here = {"position": vector(0.1 * k, 0, 0), "orientation": turn(0.0)}
        body = {"timestamp": stamp(now), "frame_id": "map", "pose": here}
        said.append(("/pose", now, "foxglove.PoseInFrame", body))
        said.append(("/points", now, "foxglove.PointCloud", cloud(now, points, pose)))
    path = write_json(tmp_path / "run.mcap", said)
    for k, scan in enumerate(open_log(path, poses="/pose", deskew=False)):
        moved = Pose3.from_quaternion_xyzw((0.1 * k, 0, 0), (0, 0, 0, 1))
        sensor = moved @ Pose3.from_quaternion_xyzw(
            (0.5, 0.0, 1.0), (0, 0, math.sin(math.pi / 4), math.cos(math.pi / 4))
        )
        np.testing.assert_allclose(scan.map_from_sensor.translation, sensor.translation)
        ends = scan.map_from_sensor.transform(scan.directions * scan.ranges[:, None])
        np.testing.assert_allclose(ends, sensor.transform(np.array(points)))
        assert scan.beam_times_ns is not None
        assert scan.stamp_ns is not None
        np.testing.assert_array_equal(scan.beam_times_ns - scan.stamp_ns, [0, 50_000_000])
    # Deskewed, the second point was seen half way to the next pose, from where the cloud was then.
    moving = list(open_log(path, poses="/pose"))
    for scan, at_once in zip(moving[:3], open_log(path, poses="/pose", deskew=False), strict=False):
        assert isinstance(scan, Scan)
        assert isinstance(at_once, Scan)
        assert scan.beam_origins is not None
        ends = scan.directions * scan.ranges[:, None]
        apart = scan.map_from_sensor.transform(scan.beam_origins + ends)
        still = at_once.map_from_sensor.transform(at_once.directions * at_once.ranges[:, None])
        way = np.array([[0.0, 0.0, 0.0], [0.05, 0.0, 0.0]])
        np.testing.assert_allclose(apart, still + way, atol=1e-12)


def test_scans_with_poses_of_their_own_need_no_others(tmp_path: Path) -> None:
    said: list[tuple[str, int, str, Any]] = []
    for k in range(4):
        now = START + k * SECOND // 10
        pose = {"position": vector(0.5 * k, 0.0, 0.0), "orientation": turn(0.1 * k)}
        body = laser(now, [2.0] * 5, frame_id="map", pose=pose)
        said.append(("/scan", now, "foxglove.LaserScan", body))
    log = open_log(write_json(tmp_path / "run.mcap", said, profile="x"))
    # The first is at the origin, which is no pose of its own: it says the same.
    assert [scan.map_from_sensor.translation.tolist() for scan in log] == [
        [0.5 * k, 0.0] for k in range(4)
    ]
    assert [note.code for note in log.notes] == ["pose.own"]


def test_what_json_has_for_no_return_and_for_time(tmp_path: Path) -> None:
    said = foxglove_drive()
    for k, (topic, now, kind, values) in enumerate(said):
        if topic == "/scan":
            values = {**values, "ranges": [None, *values["ranges"][1:]]}
            values["timestamp"] = f"2023-11-14T22:13:{20 + (now - START) / SECOND:04.1f}Z"
            said[k] = topic, now, kind, values
    scans = scans_of(write_json(tmp_path / "run.mcap", said))
    assert all(np.isnan(scan.ranges[0]) for scan in scans)
    first = scans[0].stamp_ns
    assert first is not None
    assert first % SECOND == 0


def test_topics_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    file = PlainMcap(tmp_path / "run.mcap")
    file.channel("/a", "foxglove.LaserScan", "flatbuffer", "flatbuffer", b"")
    file.channel("/b", "sensor_msgs/LaserScan", "cdr", "ros3", b"")
    file.channel("/c", "ours/Own", "cdr", "", b"")
    for topic in ("/a", "/b", "/c"):
        file.write(topic, START, b"1234")
    file.close()
    facts = describe(open_ros_recording(str(tmp_path / "run.mcap")))
    assert facts["topics"]["/a"] == {"type": "foxglove.LaserScan", "count": 1}
    assert facts["not read"] == {
        "/a": "'flatbuffer' messages are not read",
        "/b": "cdr messages with 'ros3' are not read",
        "/c": "its definition is not in the file",
    }
    with pytest.raises(InputError, match="/a cannot be read: 'flatbuffer' messages are not read"):
        open_log(tmp_path / "run.mcap", scans="/a")
    with pytest.raises(InputError, match="no topic of scans"):
        open_log(tmp_path / "run.mcap")


def test_a_message_that_is_none_is_one_line(tmp_path: Path) -> None:
    said = foxglove_drive()
    path = write_json(tmp_path / "run.mcap", said)
    file = PlainMcap(tmp_path / "bad.mcap")
    known = set()
    for topic, now, kind, values in said:
        if topic not in known:
            known.add(topic)
            file.channel(topic, kind, "json", "jsonschema", b"{}")
        content = json.dumps(values).encode()
        file.write(topic, now, content if now != START + SECOND else content[:-9])
    file.close()
    assert len(scans_of(path)) == 20
    with pytest.raises(InputError, match=r"a message cannot be decoded \(/tf: .*--skip-bad"):
        open_log(tmp_path / "bad.mcap")
    log = open_log(tmp_path / "bad.mcap", skip_bad=True)
    assert len(list(log)) == 19
    assert log.skipped == {"container.truncated": 2}
    assert "messages that cannot be decoded, the first: /tf: " in log.notes[0]


@pytest.mark.parametrize("missing", ["rosbags.typesys", "google.protobuf.descriptor_pb2"])
def test_a_library_that_is_missing_is_named(
    missing: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, missing, None)
    kinds = {
        "rosbags.typesys": ("cdr", "ros2msg"),
        "google.protobuf.descriptor_pb2": ("protobuf",) * 2,
    }
    channel = Channel("/a", "a/B", *kinds[missing], schema=f"int8 x{tmp_path.name[-3:]}".encode())
    with pytest.raises(InputError, match=r'run.mcap: /a: .*pip install "oddsmap\[ros\]"'):
        decoder_of("run.mcap", channel)


def test_protobuf_files_that_import_each_other() -> None:
    files = Files()
    for one, other in (("a", "b"), ("b", "a")):
        files.file.add(name=one, dependency=[other])
    channel = Channel("/a", "x.Y", "protobuf", "protobuf", files.SerializeToString())
    with pytest.raises(InputError, match="files that import each other"):
        decoder_of("run.mcap", channel)
    with pytest.raises(InputError, match="a damaged definition of"):
        decoder_of("run.mcap", Channel("/a", "x.Y", "protobuf", "protobuf", b"xx"))


def foxglove_protobuf() -> tuple[Files, Any]:
    """Foxglove's types as protobuf describes them, and what makes a class of one."""
    number, text, times = 1, 9, ".google.protobuf.Timestamp"
    shapes: dict[str, dict[str, Any]] = {
        "Vector3": dict.fromkeys("xyz", number),
        "Quaternion": dict.fromkeys("xyzw", number),
        "Pose": {"position": ".foxglove.Vector3", "orientation": ".foxglove.Quaternion"},
        "LaserScan": {
            "timestamp": times,
            "frame_id": text,
            "pose": ".foxglove.Pose",
            "start_angle": number,
            "end_angle": number,
            "ranges": [number],
            "intensities": [number],
        },
        "FrameTransform": {
            "timestamp": times,
            "parent_frame_id": text,
            "child_frame_id": text,
            "translation": ".foxglove.Vector3",
            "rotation": ".foxglove.Quaternion",
        },
        "FrameTransforms": {"transforms": [".foxglove.FrameTransform"]},
    }
    ours = FileDescriptorProto(name="foxglove.proto", package="foxglove", syntax="proto3")
    ours.dependency.append("time.proto")
    for name, fields in shapes.items():
        add_message(ours, name, fields)
    time = FileDescriptorProto(name="time.proto", package="google.protobuf", syntax="proto3")
    add_message(time, "Timestamp", {"seconds": 3, "nanos": 5})
    files = Files(file=[ours, time])  # what is imported comes last
    pool = DescriptorPool()
    pool.Add(time)
    pool.Add(ours)
    return files, lambda name: GetMessageClass(pool.FindMessageTypeByName(name))


def add_message(file: FileDescriptorProto, name: str, fields: dict[str, Any]) -> None:
    message = file.message_type.add(name=name)
    for k, (field, kind) in enumerate(fields.items(), start=1):
        label = FieldDescriptorProto.LABEL_OPTIONAL
        if isinstance(kind, list):
            (kind,) = kind
            label = FieldDescriptorProto.LABEL_REPEATED
        if isinstance(kind, str):
            message.field.add(name=field, number=k, label=label, type=11, type_name=kind)
        else:
            message.field.add(name=field, number=k, label=label, type=kind)


def filled(message: Any, values: dict[str, Any]) -> Any:
    for name, value in values.items():
        if name == "timestamp":
            message.timestamp.seconds, message.timestamp.nanos = value["sec"], value["nsec"]
        elif isinstance(value, dict):
            filled(getattr(message, name), value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for each in value:
                filled(getattr(message, name).add(), each)
        elif isinstance(value, list):
            getattr(message, name).extend(value)
        else:
            setattr(message, name, value)
    return message


@pytest.mark.realdata
def test_a_file_of_another_program_opens(data_folder: Path) -> None:
    path = data_folder / "ros" / "mcap" / "lichtblick_custom-camera-model.mcap"
    facts = describe(open_ros_recording(str(path)))
    assert facts["topics"]["/image/compressed"]["type"] == "foxglove.CompressedImage"
    assert facts["topics"]["/image/compressed"]["count"] == 10
