"""Points sorted to tiles on disk, and their statistics in cells."""

from pathlib import Path

import numpy as np
import pytest

from survey.core.errors import InputError
from survey.reconstruction.tiled.cells import (
    cell_statistics,
    holds_class,
    pieces_of,
    present_tiles,
    read_sorted,
    sort_piece,
    sorted_points,
)
from survey.reconstruction.tiled.layout import TileLayout
from tests.survey.reconstruction.tiled.conftest import write_laz

LAYOUT = TileLayout.over((0.0, 0.0, 200.0, 120.0), 1.0, 80)


@pytest.fixture
def points(rng: np.random.Generator) -> np.ndarray:
    return np.column_stack(
        [rng.uniform(0.0, 200.0, 3000), rng.uniform(0.0, 120.0, 3000), rng.uniform(5.0, 9.0, 3000)]
    )


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(4)


def sorted_into(folder: Path, file: Path, ground: int | None = None) -> list:
    pieces = pieces_of(file, 0, 3000, ground)
    for piece in pieces:
        sort_piece(LAYOUT, folder, piece)
    return pieces


def test_every_point_is_sorted_once(points: np.ndarray, tmp_path: Path) -> None:
    pieces = sorted_into(tmp_path / "s", write_laz(tmp_path / "a.laz", points, np.ones(3000)))
    tiles = present_tiles(tmp_path / "s", pieces, LAYOUT)
    assert tiles == LAYOUT.tiles
    n = [len(read_sorted(f)) for tile in tiles for f in sorted_points(tmp_path / "s", pieces, tile)]
    assert sum(n) == 3000


def test_cells_have_number_mean_and_variance_of_their_points(points: np.ndarray, tmp_path: Path) -> None:
    pieces = sorted_into(tmp_path / "s", write_laz(tmp_path / "a.laz", points, np.ones(3000)))
    tile = LAYOUT.tiles[0]
    cells = cell_statistics(LAYOUT, tile, sorted_points(tmp_path / "s", pieces, tile))
    most = cells[np.argmax(cells["n"])]
    inside = (np.floor(points[:, 0]) == most["column"]) & (np.floor(points[:, 1]) == most["row"])
    assert most["n"] == inside.sum() >= 2
    assert most["z"] == pytest.approx(points[inside, 2].mean(), abs=1e-3)
    assert most["variance"] == pytest.approx(points[inside, 2].var(ddof=1), rel=1e-2)


def test_strips_are_apart_in_a_cell(tmp_path: Path) -> None:
    xyz = np.array([[0.2, 0.2, 5.0], [0.8, 0.6, 7.0]])
    pieces = pieces_of(write_laz(tmp_path / "a.laz", xyz, np.array([1, 2])), 0, 2, None)
    sort_piece(LAYOUT, tmp_path / "s", pieces[0])
    cells = cell_statistics(LAYOUT, LAYOUT.tiles[0], sorted_points(tmp_path / "s", pieces, LAYOUT.tiles[0]))
    assert cells[["strip", "n", "z"]].tolist() == [(1, 1, 5.0), (2, 1, 7.0)]


def test_other_classes_are_left_out_where_ground_is_marked(points: np.ndarray, tmp_path: Path) -> None:
    file = write_laz(tmp_path / "a.laz", points, np.ones(3000), classes=5)
    assert not holds_class(file, 3000, 2)
    assert sum(sort_piece(LAYOUT, tmp_path / "s", piece) for piece in pieces_of(file, 0, 3000, 2)) == 0


def test_a_sorted_piece_is_not_sorted_again(points: np.ndarray, tmp_path: Path) -> None:
    file = write_laz(tmp_path / "a.laz", points, np.ones(3000))
    sorted_into(tmp_path / "s", file)
    file.unlink()
    assert sort_piece(LAYOUT, tmp_path / "s", pieces_of(file, 0, 3000, None)[0]) == 3000


def test_a_broken_off_piece_leaves_no_folder(points: np.ndarray, tmp_path: Path) -> None:
    points[:, 2] = 3e6
    file = write_laz(tmp_path / "a.laz", points / [1, 1, 1], np.ones(3000))
    with pytest.raises(InputError, match="a height of 3e"):
        sorted_into(tmp_path / "s", file)
    assert list((tmp_path / "s").iterdir()) == []


def test_sorted_points_that_were_cut_off_are_refused(points: np.ndarray, tmp_path: Path) -> None:
    pieces = sorted_into(tmp_path / "s", write_laz(tmp_path / "a.laz", points, np.ones(3000)))
    file = sorted_points(tmp_path / "s", pieces, LAYOUT.tiles[0])[0]
    file.write_bytes(file.read_bytes()[:-3])
    with pytest.raises(InputError, match="were cut off"):
        read_sorted(file)
