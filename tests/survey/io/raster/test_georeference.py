"""Rasters are read and written north-up with square cells only."""

import numpy as np
import pytest
from affine import Affine
from pyproj import CRS

from survey import InputError
from survey.io.raster import write_raster
from survey.io.raster.opening import check_transform

NORTH_UP = Affine(3.0, 0.0, 500_000.0, 0.0, -3.0, 6_700_000.0)
WRONG = {
    "rotated": NORTH_UP @ Affine.rotation(20.0),
    "northern": Affine(3.0, 0.0, 500_000.0, 0.0, 3.0, 6_700_000.0),
    "square": Affine(3.0, 0.0, 500_000.0, 0.0, -4.0, 6_700_000.0),
    "resolve": Affine(1e-9, 0.0, 500_000.0, 0.0, -1e-9, 6_700_000.0),
}


def test_square_cells_from_north_to_south_pass():
    check_transform(NORTH_UP)


@pytest.mark.parametrize("ending", [".tif", ".asc", ".nc"])
@pytest.mark.parametrize("word", WRONG)
def test_other_rasters_are_not_written(tmp_path, word, ending):
    path = tmp_path / f"map{ending}"
    with pytest.raises(InputError, match=word):
        write_raster(path, {"elevation": np.ones((4, 4))}, WRONG[word], CRS.from_epsg(32608))
    assert not path.exists()


def test_a_raster_without_a_georeference_is_refused_as_such():
    with pytest.raises(InputError, match=r"has no georeference; assign one .* standard_name"):
        check_transform(Affine.identity())
