# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from oddsmap.errors import InputError
from oddsmap.maps.probability_map import load_ros
from oddsmap.odds import State, Thresholds

GREYS = np.array([[0, 100, 254], [205, 90, 255]], dtype=np.uint8)


def write_map(folder: Path, pixels: npt.NDArray[np.generic], **changes: object) -> Path:
    """Write a map of one's own: `changes` replace keys, None removes them."""
    name = str(changes.pop("name", "map.pgm"))
    Image.fromarray(pixels).save(folder / name)
    fields = {
        "image": name,
        "resolution": 0.5,
        "origin": "[-3, 2.5, 0]",
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    } | changes
    lines = [f"{key}: {value}" for key, value in fields.items() if value is not None]
    path = folder / "map.yaml"
    path.write_text("\n".join(lines))
    return path


class TestModes:
    def test_missing_mode_is_trinary(self, tmp_path: Path) -> None:
        grid = load_ros(write_map(tmp_path, GREYS))
        # The first row of the map is the last of the image.
        assert grid.state().tolist() == [[-1, -1, 0], [100, -1, 0]]
        assert grid.probability[1].tolist() == [1.0, 0.5, 1 / 255]
        assert (grid.resolution, grid.origin, grid.yaw) == (0.5, (-3.0, 2.5), 0.0)

    def test_limits_belong_to_free_and_occupied(self, tmp_path: Path) -> None:
        fifth = np.array([[204, 51]], dtype=np.uint8)  # darkness 0.2 and 0.8 exactly
        path = write_map(tmp_path, fifth, free_thresh=0.2, occupied_thresh=0.8)
        assert load_ros(path).state().tolist() == [[0, 100]]

    def test_state_of_the_file_is_the_default_state(self, tmp_path: Path) -> None:
        # Free by the file's 0.25, though darker than the default 0.196.
        greys = np.where(GREYS == 205, 204, GREYS).astype(np.uint8)
        path = write_map(tmp_path, greys, free_thresh=0.25, occupied_thresh=0.6)
        grid = load_ros(path)
        assert grid.state().tolist() == [[0, 100, 0], [100, 100, 0]]
        assert np.array_equal(grid.state(thresholds=Thresholds(0.25, 0.6)), grid.state())
        assert grid.notes == ()

    def test_what_a_saver_wrote_as_unknown_is_unknown(self, tmp_path: Path) -> None:
        """Nav2's saver writes 205 and free_thresh 0.25, by which its loader takes 205 for free."""
        path = write_map(tmp_path, GREYS, free_thresh=0.25)
        grid = load_ros(path)
        assert grid.state().tolist() == [[-1, -1, 0], [100, -1, 0]]
        (note,) = grid.notes
        assert (note.code, note.severity) == ("ros.unknown_as_free", "warning")
        assert note.startswith("1 pixels of grey 205 are read as unknown")
        # Where it is free nowhere, nothing is said; and with colours swapped it has no meaning.
        assert load_ros(write_map(tmp_path, GREYS)).notes == ()
        swapped = load_ros(write_map(tmp_path, GREYS, free_thresh=0.25, negate=1))
        assert swapped.state().tolist() == [[100, -1, 100], [0, -1, 100]]
        scaled = load_ros(write_map(tmp_path, GREYS, free_thresh=0.25, mode="scale"))
        assert scaled.observed.all()

    def test_scale_runs_between_the_thresholds(self, tmp_path: Path) -> None:
        greys = np.array([[255, 204, 153, 102, 51, 0]], dtype=np.uint8)
        path = write_map(tmp_path, greys, mode="scale", free_thresh=0.3, occupied_thresh=0.7)
        expected = [0.0, 0.2, 0.25, 0.75, 0.8, 1.0]
        assert load_ros(path).probability[0] == pytest.approx(expected, abs=1e-12)

    def test_raw_is_percent_and_above_100_unknown(self, tmp_path: Path) -> None:
        greys = np.array([[0, 37, 100, 101, 255]], dtype=np.uint8)
        grid = load_ros(write_map(tmp_path, greys, mode="raw", negate=1))
        assert grid.probability[0].tolist() == [0.0, 0.37, 1.0, 0.5, 0.5]
        assert grid.observed[0].tolist() == [True, True, True, False, False]

    @pytest.mark.parametrize("negate", [1, "true", "yes"])
    def test_negate_swaps_black_and_white(self, tmp_path: Path, negate: object) -> None:
        grid = load_ros(write_map(tmp_path, GREYS, negate=negate))
        assert grid.state().tolist() == [[100, -1, 100], [0, -1, 100]]


class TestImages:
    def test_transparent_is_unknown(self, tmp_path: Path) -> None:
        pixels = np.array([[[0, 255], [0, 254], [255, 255]]], dtype=np.uint8)
        for mode in ("trinary", "scale"):
            path = write_map(tmp_path, pixels, name="map.png", mode=mode)
            assert load_ros(path).state().tolist() == [[100, -1, 0]]

    def test_colours_are_averaged(self, tmp_path: Path) -> None:
        pixels = np.array([[[60, 30, 0], [255, 255, 252]]], dtype=np.uint8)
        grid = load_ros(write_map(tmp_path, pixels, name="map.png"))
        assert grid.probability[0].tolist() == pytest.approx([225 / 255, 1 / 255])

    def test_sixteen_bits(self, tmp_path: Path) -> None:
        pixels = (GREYS.astype(np.uint16)) * 257
        grid = load_ros(write_map(tmp_path, pixels, name="map.png"))
        assert grid.state().tolist() == [[-1, -1, 0], [100, -1, 0]]

    def test_pgm_with_comments_and_plain_pgm(self, tmp_path: Path) -> None:
        path = write_map(tmp_path, GREYS)
        expected = load_ros(path).probability
        binary = b"P5 # by hand\n# 10 10\n3 #w\n2\n255\n" + GREYS.tobytes()
        plain = b"P2\n3 2\n255\n" + " ".join(map(str, GREYS.ravel())).encode()
        for content in (binary, plain):
            (tmp_path / "map.pgm").write_bytes(content)
            assert np.array_equal(load_ros(path).probability, expected)

    def test_absolute_and_nested_image(self, tmp_path: Path) -> None:
        (tmp_path / "sub").mkdir()
        path = write_map(tmp_path, GREYS, name="sub/a b.pgm")
        assert load_ros(path).probability.shape == (2, 3)
        path = write_map(tmp_path, GREYS, image=tmp_path / "sub" / "a b.pgm")
        assert load_ros(path).probability.shape == (2, 3)


class TestErrors:
    @pytest.mark.parametrize(
        ("changes", "message"),
        [
            ({"image": None}, "map.yaml: no image; a ROS map needs"),
            ({"negate": None, "origin": None}, "no origin, negate;"),
            ({"image": "gone.pgm"}, "gone.pgm does not exist"),
            ({"image": "[1]"}, "image must be the name of a file"),
            ({"resolution": 0}, "resolution must be positive"),
            ({"resolution": -0.05}, "resolution must be positive"),
            ({"resolution": ".nan"}, "resolution must be a finite number"),
            ({"resolution": "fine"}, "resolution must be a finite number, got 'fine'"),
            ({"origin": "[1, 2]"}, "origin must be a list"),
            ({"origin": "[1, 2, x]"}, "origin must be a finite number"),
            ({"mode": "grey"}, "mode must be one of trinary, scale, raw, got 'grey'"),
            ({"negate": "maybe"}, "negate must be"),
            ({"free_thresh": 0.7}, "thresholds need 0 <= free < occupied <= 1"),
            ({"origin": "2001-99-01"}, "not YAML (month must be in 1..12"),
            ({"origin": "!!int ''"}, "not YAML ("),
            ({"origin": "!!float x"}, "not YAML ("),
            ({"origin": "[" * 3000}, "not YAML (nested too deeply)"),
            ({"negate": "9" * 4000}, "negate must be 0, 1, true or false, got "),
            ({"resolution": "9" * 4000}, "resolution must be a finite number, got a whole number"),
            ({"resolution": "&a [*a]"}, "not YAML (aliases (*name) have no place in a map)"),
            ({"mode": "[" + "[1]," * 4000 + "]"}, "mode must be one of trinary, scale, raw, got ["),
            ({"resolution": "1\nresolution: 2"}, "not YAML (resolution is there twice)"),
            ({"image": "~/gone/m.pgm"}, "/gone/m.pgm does not exist"),
            ({"image": "~nobody-of-that-name/m.pgm"}, "m.pgm"),
            ({"image": '"a\\0"'}, "map.yaml: "),
            ({"comment": "x" * 70_000}, "not the YAML of a map (70"),
        ],
    )
    def test_senseless_yaml(self, tmp_path: Path, changes: dict[str, object], message: str) -> None:
        path = write_map(tmp_path, GREYS, **changes)
        with pytest.raises(InputError) as caught:
            load_ros(path)
        assert message in str(caught.value)
        assert len(str(caught.value).removeprefix(str(tmp_path))) < 400
        assert "\n" not in str(caught.value)

    def test_a_billion_laughs(self, tmp_path: Path) -> None:
        """Nine lines that stand for 9^9 values, also as a merge."""
        for first, more in (("[1]", "[{}]"), ("{x: 1}", "{{<<: [{}]}}")):
            names = [f"a{i}" for i in range(10)]
            lines = [f"a0: &a0 {first}"]
            for below, name in pairwise(names):
                lines.append(f"{name}: &{name} {more.format(', '.join([f'*{below}'] * 9))}")
            path = write_map(tmp_path, GREYS)
            path.write_text("\n".join(lines) + "\n" + path.read_text())
            with pytest.raises(InputError, match=r"not YAML \(aliases"):
                load_ros(path)

    def test_an_image_at_home(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        home = tmp_path / "home"
        home.mkdir()
        monkeypatch.setenv("HOME", str(home))
        monkeypatch.setenv("USERPROFILE", str(home))
        path = write_map(tmp_path, GREYS, image="~/map.pgm")
        (tmp_path / "map.pgm").rename(home / "map.pgm")
        assert load_ros(path).probability.shape == (2, 3)

    def test_greys_of_unknown_scale(self, tmp_path: Path) -> None:
        for pixels, message in (
            (GREYS.astype(np.float32) / 255, "an image of real numbers, whose scale is not known"),
            (GREYS.astype(np.int32) * 1000, "greys of 32 bits, 0 to 255000, whose scale is not"),
        ):
            with pytest.raises(InputError, match=rf"map\.tif: {message}"):
                load_ros(write_map(tmp_path, pixels, name="map.tif"))

    @pytest.mark.parametrize("content", [b"image: [", b"P5\n1 1\n255\n\xff", b"", b"just text"])
    def test_not_the_yaml_of_a_map(self, tmp_path: Path, content: bytes) -> None:
        path = tmp_path / "map.yaml"
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"map\.yaml: not ") as caught:
            load_ros(path)
        assert "\n" not in str(caught.value)

    def test_no_file(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match="no such file"):
            load_ros(tmp_path / "none.yaml")

    @pytest.mark.parametrize(
        "content",
        [
            b"",
            b"hello",
            b"P5\n3 2\n255\n\x00",
            b"P5\n3 2\n65535\n\x00",
            b"P5\n0 2\n255\n\x00",
            b"P5\n99999999999 99999999999\n255\n\x00",
            b"P5\n" + b"9" * 5000 + b" 1\n255\n\x00",
        ],
    )
    def test_broken_image(self, tmp_path: Path, content: bytes) -> None:
        path = write_map(tmp_path, GREYS)
        (tmp_path / "map.pgm").write_bytes(content)
        with pytest.raises(InputError, match=r"map\.pgm") as caught:
            load_ros(path)
        assert "\n" not in str(caught.value)


@pytest.mark.realdata
class TestRealMaps:
    def test_depot(self, data_folder: Path) -> None:
        grid = load_ros(data_folder / "maps" / "depot.yaml")
        assert grid.probability.shape == (307, 604)
        state = grid.state()
        assert np.count_nonzero(state == State.OCCUPIED) == 5947
        # Nav2's loader takes them for free, by the 0.25 in the file.
        unknown = np.count_nonzero(state == State.UNKNOWN)
        assert grid.notes[0].startswith(f"{unknown} pixels of grey 205 are read as unknown")
        assert unknown == 8894

    def test_turtlebot_world(self, data_folder: Path) -> None:
        grid = load_ros(data_folder / "ros" / "turtlebot3_world.yaml")
        assert grid.origin == (-10.0, -10.0)
        found, count = np.unique(grid.state(), return_counts=True)
        assert found.tolist() == [-1, 0, 100]
        assert count.tolist() == [138683, 7903, 870]


@pytest.mark.parametrize(
    "value",
    [
        "!!python/object/apply:pathlib.Path.touch [!!python/object/apply:pathlib.Path [{made}]]",
        "!!python/object/apply:os.mkdir [{made}]",
        "!!python/object/new:os.mkdir [{made}]",
        "!!python/name:os.mkdir",
        "!!python/module:os",
        "!!python/tuple [0, 0, 0]",
    ],
)
def test_a_yaml_runs_no_code(tmp_path: Path, value: str) -> None:
    made = tmp_path / "made"
    path = write_map(tmp_path, GREYS, origin=value.format(made=made))
    with pytest.raises(InputError, match="not YAML"):
        load_ros(path)
    assert not made.exists()
