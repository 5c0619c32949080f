# SPDX-License-Identifier: Apache-2.0
"""The readers under test: a sample, what may happen to it, and what reads it."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tests.fuzz import answers
from tests.fuzz.answers import Answer
from tests.fuzz.bytes_and_lines import (
    append_noise,
    change_bytes,
    change_text,
    cut,
    cut_a_member,
    flip_bits,
    put_absurd_number,
)
from tests.fuzz.e57_changes import change_pages
from tests.fuzz.image_changes import change_chunks, change_pgm_header
from tests.fuzz.mutant import Change, Files, Mutator, on_file
from tests.fuzz.npz_changes import change_archive, change_array
from tests.fuzz.samples import GRIDS, SAMPLES, SCANS, SCANS_3D
from tests.fuzz.text_changes import change_json, change_toml, change_yaml
from tests.readers.argoverse_files import STAMP

__all__ = ["READERS", "Reader"]


@dataclass(frozen=True)
class Reader:
    """One row of the table of outcomes.

    Args:
        name: also that of its sample.
        read: reads the file or folder, with all that a user would do next.
        path: what is read, below the folder of the sample.
        mutators: what may happen; one of them is drawn for a case.
    """

    name: str
    read: Callable[[Path], Answer]
    path: str
    mutators: tuple[Mutator, ...]

    def sample(self) -> Files:
        """The valid files."""
        return SAMPLES[self.name]()


def _text(name: str) -> tuple[Mutator, ...]:
    """Of texts: no checksum, each digit could be another."""
    return (*[on_file(name, change_text, "any")] * 4, on_file(name, change_bytes, "any"))


def _binary(name: str, counted: bool = True) -> tuple[Mutator, ...]:
    """Of headers in text and records in binary, where the header says how many there are."""
    expected = "same" if counted else "any"
    return (
        *[on_file(name, change_bytes, "any")] * 2,
        on_file(name, change_text, "any"),
        on_file(name, cut, expected),  # type: ignore[arg-type]
        on_file(name, append_noise, expected),  # type: ignore[arg-type]
    )


def _checked(name: str, shorten: Change = cut) -> tuple[Mutator, ...]:
    """Of containers with checksums: damage does not pass."""
    return tuple(on_file(name, change, "same") for change in (flip_bits, change_bytes, shorten))


_NPZ = (
    *_checked("a.npz"),
    *[on_file("a.npz", change_array, "any")] * 4,
    *[on_file("a.npz", change_archive, "same")] * 2,
)


def _zarr(*arrays: str) -> tuple[Mutator, ...]:
    """Of a saved map: shards have checksums, and nothing in an array's header could be another."""
    return (
        *[on_file("a.zarr/zarr.json", change_json, "any")] * 2,
        on_file("a.zarr/zarr.json", change_bytes, "any"),
        *(on_file(f"a.zarr/{array}/zarr.json", change_json, "same") for array in arrays),
        *(
            on_file(f"a.zarr/{array}/c/*", change, "same")
            for array in arrays
            for change in (flip_bits, cut)
        ),
    )


def _log(name: str, path: str, *mutators: Mutator) -> Reader:
    return Reader(name, answers.of_log, path, mutators)


def _recording(name: str, path: str) -> Reader:
    """Of containers whose messages have no checksum; one that is cut is never the same."""
    mutators = (
        *[on_file(path, put_absurd_number, "any")] * 3,
        *[on_file(path, change_bytes, "any")] * 2,
        on_file(path, flip_bits, "any"),
        on_file(path, cut, "same"),
        on_file(path, append_noise, "same"),
    )
    return Reader(name, answers.of_recording, path, mutators)


def _settings(name: str, read: Callable[[Path], Answer]) -> Reader:
    return Reader(
        name, read, "a.toml", (*[on_file("a.toml", change_toml, "any")] * 4, *_text("a.toml"))
    )


# Written by rosbags, an extra: pip install "oddsmap[ros]".
RECORDINGS = (
    (
        _recording("recording-bag", "a.bag"),
        _recording("recording-bag-lz4", "a.bag"),
        _recording("recording-sqlite3", "a.db3"),
        _recording("recording-mcap", "a.mcap"),
        _recording("recording-mcap-json", "a.mcap"),
    )
    if importlib.util.find_spec("rosbags")
    else ()
)

READERS: dict[str, Reader] = {
    reader.name: reader
    for reader in (
        _log("carmen", "a.log", *_text("a.log")),
        _log("carmen-robotlaser", "a.log", *_text("a.log")),
        _log("carmen-gz", "a.log.gz", *_checked("a.log.gz")),
        _log("carmen-bz2", "a.log.bz2", *_checked("a.log.bz2")),
        _log("carmen-two-members", "a.gz", *_checked("a.gz", cut_a_member)),
        _log("npz-beams2", "a.npz", *_NPZ),
        _log("npz-beams3", "a.npz", *_NPZ),
        _log("npz-cones", "a.npz", *_NPZ),
        _log("npz-grids", "a.npz", *_NPZ),
        Reader("landmark-csv", answers.of_landmarks, "a.csv", _text("a.csv")),
        Reader("landmark-npz", answers.of_landmarks, "a.npz", _NPZ),
        Reader(
            "landmark-json",
            answers.of_landmark_map,
            "a.json",
            (*[on_file("a.json", change_json, "any")] * 3, *_text("a.json")[-2:]),
        ),
        _log("pcd-ascii", "a.pcd", *_text("a.pcd")),
        _log("pcd-binary", "a.pcd", *_binary("a.pcd")),
        _log("pcd-binary_compressed", "a.pcd", *_binary("a.pcd")),
        _log("ply-ascii", "a.ply", *_text("a.ply")),
        _log("ply-binary_little_endian", "a.ply", *_binary("a.ply", counted=False)),
        _log("ply-binary_big_endian", "a.ply", *_binary("a.ply", counted=False)),
        _log("kitti-bin", ".", *_binary("000001.bin", counted=False)),
        _log("poses-kitti", ".", *_text("poses.txt"), *_text("times.txt")),
        _log("poses-tum", ".", *_text("poses.txt"), *_text("times.txt")),
        _log(
            "rgbd-7scenes",
            ".",
            *_checked("frame-000001.depth.png"),
            *[on_file("frame-000001.depth.png", change_chunks, "any")] * 2,
            *_text("frame-000000.pose.txt"),
            *_text("camera-intrinsics.txt"),
        ),
        _log(
            "rgbd-tum",
            ".",
            *_checked("depth/1.png"),
            *[on_file("depth/*", change_chunks, "any")] * 2,
            *_text("depth.txt"),
            *_text("groundtruth.txt"),
        ),
        *RECORDINGS,
        _log("poses-csv", ".", *_text("poses.txt")),
        _log("kitti-raw", ".", *_text("calib_velo_to_cam.txt")),
        _log("ptx", "a.ptx", *_text("a.ptx")),
        _log("rawlog", "a.rawlog", *_binary("a.rawlog", counted=False)),
        Reader(
            "las",
            lambda path: answers.of_log(path, poses="track.csv"),
            "a.las",
            (*_binary("a.las", counted=False), *_text("track.csv")[:2]),
        ),
        *(
            Reader(
                name,
                lambda path: answers.of_log(path, poses="track.csv"),
                "a.laz",
                _binary("a.laz", counted=False),
            )
            for name in ("laz", "laz-layers")
        ),
        Reader(
            "gpx",
            lambda path: answers.of_log(path, poses="t.gpx"),
            "a.las",
            (*_text("t.gpx"), *_binary("a.las", counted=False)[:2]),
        ),
        _log("e57", "a.e57", *_checked("a.e57"), *[on_file("a.e57", change_pages, "any")] * 6),
        _log("argoverse-sweep", ".", *_binary(f"sensors/lidar/{STAMP}.feather", counted=False)),
        _log("argoverse-poses", ".", *_binary("city_SE3_egovehicle.feather", counted=False)),
        _log("octomap-graph", "a.graph", *_binary("a.graph", counted=False)),
        Reader("octomap-bt", answers.of_octomap, "a.bt", _binary("a.bt")),
        Reader("octomap-bt-dense", answers.of_octomap, "a.bt", _binary("a.bt")),
        Reader("octomap-ot", answers.of_octomap, "a.ot", _binary("a.ot")),
        Reader(
            "ros-yaml",
            answers.of_ros,
            "m.yaml",
            (*[on_file("m.yaml", change_yaml, "any")] * 4, *_text("m.yaml")),
        ),
        Reader(
            "ros-pgm",
            answers.of_ros,
            "m.yaml",
            (*[on_file("m.pgm", change_pgm_header, "any")] * 3, *_binary("m.pgm", counted=False)),
        ),
        Reader(
            "ros-png",
            answers.of_ros,
            "m.yaml",
            (*_checked("m.png"), *[on_file("m.png", change_chunks, "any")] * 3),
        ),
        _settings("toml", lambda path: answers.of_config(path, SCANS)),
        _settings("toml-cones", lambda path: answers.of_config(path, SCANS)),
        _settings("toml-3d", lambda path: answers.of_config(path, SCANS_3D)),
        _settings("toml-overhead", lambda path: answers.of_config(path, GRIDS)),
        _settings("toml-full-map", lambda path: answers.of_full_map_config(path, SCANS)),
        Reader("zarr-2d", answers.of_map, "a.zarr", _zarr("hits", "passes")),
        Reader("zarr-3d", answers.of_map, "a.zarr", _zarr("hits", "passes")),
        Reader("zarr-full", answers.of_map, "a.zarr", _zarr("log_odds", "marks")),
    )
}
