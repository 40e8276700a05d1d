import subprocess
import sys

import pytest
from pyproj import CRS

from survey import InputError
from survey.core.crs import projected_crs, same_crs, same_vertical_datum, vertical_datum_of


def test_mixed_systems_are_refused():
    with pytest.raises(InputError, match="different systems"):
        same_crs(CRS("EPSG:32608"), CRS("EPSG:32609"), "the prior and the points")


def test_ellipsoidal_and_geoidal_heights_are_refused_and_unstated_ones_pass():
    with pytest.raises(InputError, match="vertical datums"):
        same_vertical_datum("EGM96 height", "ellipsoidal height", "the two DEMs")
    same_vertical_datum("EGM96 height", "", "the two DEMs")
    assert vertical_datum_of("EPSG:4979") == "ellipsoidal height"


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:4978", "EPSG:2225", "EPSG:999999", None, ""])
def test_only_projected_metres_are_accepted(crs):
    with pytest.raises(InputError):
        projected_crs(crs, "the site")


def test_compound_systems_give_their_horizontal_part():
    assert projected_crs("EPSG:32608+5773", "the site").to_epsg() == 32608


GEOID = """
import sys
from pathlib import Path
import numpy as np, rasterio
from affine import Affine
from pyproj import datadir
place = Path(sys.argv[1]) / "us_nga_egm96_15.tif"
with rasterio.open(place, "w", driver="GTiff", height=8, width=8, count=1, dtype="float32", crs="EPSG:4979",
                   transform=Affine(1.0, 0.0, -138.5, 0.0, -1.0, 64.5)) as grid:
    grid.write(np.full((8, 8), 12.5, dtype=np.float32), 1)
    grid.update_tags(TYPE="VERTICAL_OFFSET_GEOGRAPHIC_TO_VERTICAL", AREA_OR_POINT="Point")
    grid.set_band_description(1, "geoid_undulation")
datadir.append_data_dir(sys.argv[1])
from survey.core.transformation import lacking_grids
print(lacking_grids()["EGM96 height"])
"""


def test_a_grid_that_is_there_is_not_lacking(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", GEOID, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"
