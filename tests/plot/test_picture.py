# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image

from oddsmap.errors import ConfigError, InputError, OutputError
from oddsmap.maps.probability_map import ProbabilityMap
from oddsmap.plot import frame
from oddsmap.plot.frame import round_length
from oddsmap.plot.picture import cell_colours, save_picture

UNKNOWN = (199, 213, 227)
OCCUPIED = (17, 20, 26)
FREE = (255, 255, 255)
LINE = (228, 87, 46)


def world(ny: int, nx: int, walls: list[tuple[int, int]]) -> ProbabilityMap:
    """Free everywhere but in the cells (row, column) of `walls`."""
    probability = np.zeros((ny, nx))
    for row, column in walls:
        probability[row, column] = 1.0
    return ProbabilityMap(probability, np.ones((ny, nx), np.bool_), 0.1, (-2.0, 7.0))


def pixels(path: Path) -> npt.NDArray[np.uint8]:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def where(picture: npt.NDArray[np.uint8], colour: tuple[int, int, int]) -> npt.NDArray[np.bool_]:
    return np.asarray((picture == np.array(colour, np.uint8)).all(axis=2))


def map_part(picture: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Cut out the rectangle of the observed cells: what the unknown margin surrounds."""
    unknown = where(picture, UNKNOWN)
    rows = np.flatnonzero(unknown.mean(axis=1) > 0.5)
    columns = np.flatnonzero(unknown.mean(axis=0) > 0.5)
    inner_rows = np.flatnonzero(np.diff(rows) > 1)[0]
    inner_columns = np.flatnonzero(np.diff(columns) > 1)[0]
    return picture[
        rows[inner_rows] + 1 : rows[inner_rows + 1],
        columns[inner_columns] + 1 : columns[inner_columns + 1],
    ]


class TestCells:
    def test_every_cell_is_a_square_and_none_is_flipped(self, tmp_path: Path) -> None:
        grid = world(30, 40, [(0, 0), (0, 1), (29, 3), (17, 39)])
        part = map_part(pixels(save_picture(grid, tmp_path / "m.png")))
        scale = part.shape[0] // 30
        assert part.shape == (30 * scale, 40 * scale, 3)
        # The middle of each cell; the top row of the picture is the highest y.
        middle = part[scale // 2 :: scale, scale // 2 :: scale][::-1]
        assert np.array_equal(where(middle, OCCUPIED), grid.probability == 1.0)
        assert np.array_equal(where(middle, FREE), grid.probability == 0.0)

    def test_wall_of_one_cell_survives_a_large_map(self, tmp_path: Path) -> None:
        probability = np.zeros((4100, 8200), np.float64)
        probability[1111, :] = 1.0
        probability[:, 2222] = 1.0
        grid = ProbabilityMap(probability, np.ones(probability.shape, np.bool_), 0.05)
        picture = pixels(save_picture(grid, tmp_path / "m.png"))
        assert max(picture.shape) <= 4200
        part = where(map_part(picture), OCCUPIED)
        assert part.all(axis=1).sum() == 3
        assert part.all(axis=0).sum() == 3

    @pytest.mark.parametrize("cells", [1240, 1880, 3100, 5000])
    def test_a_wall_of_one_cell_is_seen_at_the_size_of_a_screen(
        self, tmp_path: Path, cells: int
    ) -> None:
        """No hairline: shrunk to 1000 pixels a wall has half of its black left, or more."""
        probability = np.zeros((cells // 8, cells))
        probability[:, cells // 3] = 1.0
        probability[cells // 10 :, cells // 2] = 1.0  # a door: open below
        grid = ProbabilityMap(probability, np.ones(probability.shape, np.bool_), 0.05)
        with Image.open(save_picture(grid, tmp_path / "m.png")) as image:
            shade = map_part(np.asarray(image.convert("RGB"))).mean(axis=2)
        small = np.asarray(
            Image.fromarray(shade).resize((1000, shade.shape[0] * 1000 // shade.shape[1]),
                                          Image.Resampling.BOX)
        )  # fmt: skip
        darkness = (255.0 - small) / (255.0 - np.mean(OCCUPIED))
        wall, door = (slice(at - 4, at + 5) for at in (1000 // 3, 500))
        assert darkness[:, wall].sum(axis=1).min() >= 0.5
        assert darkness[: len(small) // 8, door].sum(axis=1).min() >= 0.5
        assert darkness[len(small) // 3 :, door].max() == 0.0
        assert darkness[:, 600:].max() == 0.0

    def test_bold_spreads_what_is_occupied_alone(self) -> None:
        probability = np.array([[0.1, 0.2, 0.1, 0.3, 0.1], [0.1, 0.1, 0.1, 0.1, 0.8]])
        observed = np.array([[1, 1, 1, 0, 1], [1, 1, 1, 1, 1]], np.bool_)
        plain, bold = (cell_colours(probability, observed, bold=bold) for bold in (False, True))
        assert np.array_equal(bold[:, :3], plain[:, :3])
        assert (bold[:, 3:] == plain[1, 4]).all()

    def test_the_free_cells_of_a_block_are_averaged(self) -> None:
        probability = np.array([[0.0, 0.4, 0.4], [0.2, 0.2, 0.6]])
        observed = np.array([[1, 1, 1], [0, 1, 1]], np.bool_)
        colours = cell_colours(probability, observed, block=2)
        one = np.ones((1, 1), np.bool_)
        assert tuple(colours[0, 0]) == tuple(cell_colours(np.array([[0.2]]), one)[0, 0])
        assert tuple(colours[0, 1]) == tuple(cell_colours(np.array([[0.6]]), one)[0, 0])

    def test_block_takes_its_most_occupied_cell(self) -> None:
        probability = np.array([[0.0, 0.0, 0.2, 0.9], [1.0, 0.0, 0.9, 0.9], [0.0, 0.0, 0.0, 0.0]])
        observed = np.array([[1, 1, 1, 0], [1, 1, 0, 0], [0, 0, 1, 0]], np.bool_)
        colours = cell_colours(probability, observed, block=2)
        assert colours.shape == (2, 2, 3)
        assert tuple(colours[0, 0]) == OCCUPIED
        assert tuple(colours[0, 1]) == tuple(
            cell_colours(np.array([[0.2]]), np.ones((1, 1), "?"))[0, 0]
        )
        assert tuple(colours[1, 0]) == UNKNOWN
        assert tuple(colours[1, 1]) == FREE

    def test_even_odds_seen_is_not_unknown(self) -> None:
        half = np.full((1, 2), 0.5)
        colours = cell_colours(half, np.array([[True, False]]))
        assert tuple(colours[0, 1]) == UNKNOWN
        assert np.ptp(colours[0, 0].astype(int)) <= 6  # a grey
        assert np.all(
            np.diff(
                cell_colours(np.linspace(0, 1, 9)[None], np.ones((1, 9), "?"))[0, :, 0].astype(int)
            )
            < 0
        )

    def test_only_the_observed_part_is_shown(self, tmp_path: Path) -> None:
        small = world(30, 40, [(3, 4)])
        probability, observed = np.zeros((300, 400)), np.zeros((300, 400), np.bool_)
        probability[100:130, 50:90], observed[100:130, 50:90] = small.probability, True
        large = ProbabilityMap(probability, observed, 0.1, (-2.0 - 5.0, 7.0 - 10.0))
        save_picture(small, tmp_path / "small.png")
        save_picture(large, tmp_path / "large.png")
        assert np.array_equal(pixels(tmp_path / "small.png"), pixels(tmp_path / "large.png"))

    def test_yaw_turns_the_map(self, tmp_path: Path) -> None:
        grid = world(40, 40, [(0, 0)])
        turned = ProbabilityMap(grid.probability, grid.observed, 0.1, (0.0, 0.0), yaw=np.pi / 2)
        part = map_part(pixels(save_picture(turned, tmp_path / "m.png")))
        black = np.argwhere(where(part, OCCUPIED)).mean(axis=0) / part.shape[:2]
        # Turned counter-clockwise about the corner (0, 0), the cell there is at the lower right.
        assert black == pytest.approx([1.0, 1.0], abs=0.03)


class TestDrawing:
    def test_trajectory_is_where_it_belongs(self, tmp_path: Path) -> None:
        grid = world(30, 40, [])
        line = np.array([[-2.0 + 1.0, 7.0 + 0.5], [-2.0 + 1.0, 7.0 + 2.5]])  # at a quarter of x
        part = map_part(pixels(save_picture(grid, tmp_path / "m.png", trajectory=line)))
        warm = part[..., 0].astype(int) - part[..., 2] > 60  # smoothing pales the line
        drawn = np.argwhere(warm) / part.shape[:2]
        assert drawn[:, 1].mean() == pytest.approx(0.25, abs=0.005)
        assert np.any(np.abs(drawn[:, 0] - 0.5) < 0.01)  # the line, not only the marks at its ends
        assert drawn[:, 0].min() == pytest.approx(1.0 - 2.5 / 3.0, abs=0.02)
        assert drawn[:, 0].max() == pytest.approx(1.0 - 0.5 / 3.0, abs=0.02)

    def test_title_trajectory_with_gap_and_empty_trajectory(self, tmp_path: Path) -> None:
        grid = world(5, 5, [(0, 0)])
        plain = pixels(save_picture(grid, tmp_path / "a.png"))
        titled = pixels(save_picture(grid, tmp_path / "b.png", title="Hall"))
        assert titled.shape[0] > plain.shape[0]
        gap = np.array([[-1.9, 7.1], [np.nan, np.nan], [-1.6, 7.4]])
        assert where(pixels(save_picture(grid, tmp_path / "c.png", trajectory=gap)), LINE).any()
        empty = pixels(save_picture(grid, tmp_path / "d.png", trajectory=np.zeros((0, 2))))
        assert np.array_equal(empty, plain)

    @pytest.mark.parametrize("origin", [(0.0, 0.0), (499_999.95, 4_512_345.05)])
    def test_utm_coordinates_keep_the_cells(
        self, tmp_path: Path, origin: tuple[float, float]
    ) -> None:
        base = world(20, 50, [(2, 3), (19, 49)])
        grid = ProbabilityMap(base.probability, base.observed, 0.05, origin)
        part = map_part(pixels(save_picture(grid, tmp_path / "m.png")))
        scale = part.shape[0] // 20
        middle = part[scale // 2 :: scale, scale // 2 :: scale][::-1]
        assert np.array_equal(where(middle, OCCUPIED), grid.probability == 1.0)

    def test_one_cell(self, tmp_path: Path) -> None:
        picture = pixels(save_picture(world(1, 1, [(0, 0)]), tmp_path / "m.png"))
        black, unknown = (where(picture, colour).sum() for colour in (OCCUPIED, UNKNOWN))
        assert black / unknown == pytest.approx(1 / 8, rel=0.02)  # a margin of one cell

    @pytest.mark.parametrize(
        ("longest", "expected"),
        [(1.0, 1.0), (1.99, 1.0), (2.0, 2.0), (4.9, 2.0), (5.0, 5.0), (99.0, 50.0), (0.3, 0.2)],
    )
    def test_round_length(self, longest: float, expected: float) -> None:
        assert round_length(longest) == pytest.approx(expected)

    def test_no_global_state(self, tmp_path: Path) -> None:
        code = (
            "import sys, numpy as np\n"
            "from oddsmap.plot.picture import save_picture\n"
            "from oddsmap.maps.probability_map import ProbabilityMap\n"
            "assert 'matplotlib' not in sys.modules\n"
            "grid = ProbabilityMap(np.zeros((2, 2)), np.ones((2, 2), '?'), 1.0)\n"
            "save_picture(grid, sys.argv[1])\n"
            "assert 'matplotlib.pyplot' not in sys.modules\n"
        )
        subprocess.run([sys.executable, "-c", code, str(tmp_path / "m.png")], check=True)

    def test_settings_of_the_user_do_not_cut_the_figure(self, tmp_path: Path) -> None:
        import matplotlib as mpl

        grid = world(5, 5, [])
        plain = pixels(save_picture(grid, tmp_path / "a.png"))
        with mpl.rc_context({"savefig.bbox": "tight", "savefig.dpi": 20}):
            assert np.array_equal(pixels(save_picture(grid, tmp_path / "b.png")), plain)


class TestRefusals:
    def test_nothing_observed(self, tmp_path: Path) -> None:
        for shape in ((0, 0), (3, 3)):
            grid = ProbabilityMap(np.zeros(shape), np.zeros(shape, np.bool_), 0.1)
            with pytest.raises(InputError, match="nothing to draw"):
                save_picture(grid, tmp_path / "m.png")

    def test_trajectory_of_another_shape(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match=r"trajectory must have shape \(n, 2\), got \(4, 3\)"):
            save_picture(world(2, 2, []), tmp_path / "m.png", trajectory=np.zeros((4, 3)))

    def test_wrong_suffix(self, tmp_path: Path) -> None:
        with pytest.raises(ConfigError, match=r"ends in \.png"):
            save_picture(world(2, 2, []), tmp_path / "m.jpg")

    def test_existing_file_needs_force(self, tmp_path: Path) -> None:
        (tmp_path / "m.png").write_text("mine")
        with pytest.raises(OutputError, match="exists already"):
            save_picture(world(2, 2, []), tmp_path / "m.png")
        save_picture(world(2, 2, []), tmp_path / "m.png", force=True)
        assert pixels(tmp_path / "m.png").size
        assert [file.name for file in tmp_path.iterdir()] == ["m.png"]


@pytest.mark.parametrize(("block", "bold"), [(1, False), (1, True), (3, False), (3, True)])
def test_bands_have_no_seams(block: int, bold: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cells coloured some rows at a time, against all at once."""
    rng = np.random.default_rng(block)
    probability, observed = rng.random((50, 40)), rng.random((50, 40)) < 0.7
    whole = cell_colours(probability, observed, block, bold=bold)
    for size in (1, 500):
        monkeypatch.setattr(frame, "BAND", size)
        assert np.array_equal(cell_colours(probability, observed, block, bold=bold), whole)


@pytest.mark.parametrize("shape", [(30, 40), (700, 31), (1300, 900), (4100, 1000)])
def test_pictures_drawn_in_bands_are_the_same(
    shape: tuple[int, int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(shape[0])
    probability, observed = rng.random(shape), rng.random(shape) < 0.7
    grid = ProbabilityMap(probability, observed, 0.05, (-123.4, 5_000_000.3))
    for name, size in (("whole", 1 << 40), ("bands", 1 << 14), ("default", frame.BAND)):
        monkeypatch.setattr(frame, "BAND", size)
        save_picture(grid, tmp_path / f"{name}.png")
    whole = (tmp_path / "whole.png").read_bytes()
    assert (tmp_path / "bands.png").read_bytes() == whole
    assert (tmp_path / "default.png").read_bytes() == whole
