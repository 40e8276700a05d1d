"""Tiles of a map."""

import numpy as np
import pytest

from survey.core.errors import CapacityError, InputError
from survey.reconstruction.tiled.layout import MapTile, TileLayout


def test_every_cell_belongs_to_one_tile() -> None:
    layout = TileLayout.over((-150.0, 20.0, 310.0, 290.0), 1.0, 100)
    counts = np.zeros(layout.extent.shape, int)
    for tile in layout.tiles:
        counts[layout.extent.part(layout.window(tile))] += 1
    assert (counts == 1).all()


def test_cells_are_found_in_the_tile_of_their_window() -> None:
    layout = TileLayout.over((-150.0, 20.0, 310.0, 290.0), 1.0, 100)
    tile = MapTile(1, 3)
    window = layout.window(tile)
    corners = np.array(
        [[window.west, window.south], [window.west + window.columns - 1, window.south + window.rows - 1]]
    )
    assert layout.tile_numbers(corners).tolist() == [1 * 5 + 3] * 2
    assert layout.tile_numbers(np.array([[310, 20]])).tolist() == [-1]


def test_tiles_near_a_tile_are_those_that_its_halo_touches() -> None:
    layout = TileLayout.over((0.0, 0.0, 500.0, 500.0), 1.0, 100)
    near = set(layout.near(MapTile(2, 2), 96))
    assert near == {MapTile(j, i) for j in (1, 2, 3) for i in (1, 2, 3)}


def test_bounds_without_extent_are_refused() -> None:
    with pytest.raises(InputError, match="enclose no cell"):
        TileLayout.over((0.0, 0.0, 0.0, 5.0), 1.0, 100)


def test_files_that_lie_far_apart_are_refused() -> None:
    with pytest.raises(CapacityError, match="tiles of 100 m"):
        TileLayout.over((0.0, 0.0, 4e5, 4e5), 1.0, 100)


def test_a_narrow_rest_belongs_to_the_tiles_beside_it() -> None:
    layout = TileLayout.over((0.0, 0.0, 2001.0, 1120.0), 1.0, 1000)
    assert layout.shape == (2, 2)
    assert layout.window(MapTile(1, 1)) == (1000, 1000, 1001, 120)
    assert layout.tile_numbers(np.array([[2000, 1119], [999, 999], [2001, 0]])).tolist() == [3, 0, -1]
    assert TileLayout.over((0.0, 0.0, 90.0, 1099.0), 1.0, 1000).shape == (1, 1)
