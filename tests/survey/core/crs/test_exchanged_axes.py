"""Exchanged eastings and northings are refused in points and areas; uncommon places of a CRS are not."""

import numpy as np
import pytest
import shapely
from pyproj import CRS, Transformer

from survey import SurfacePoints, SurveyArea
from survey.core.crs.exchanged_axes import refuse_exchanged
from survey.core.errors import InputError
from survey.io.vector import write_features

PLACE = np.array([[500_000.0, 6_700_000.0], [500_300.0, 6_700_200.0]])


@pytest.mark.parametrize("code", [32608, 2056, 25832, 3857, 3413, 3031, 3995])
def test_places_in_and_around_the_area_of_use_pass(code):
    crs = CRS.from_epsg(code)
    area = crs.area_of_use
    to_crs = Transformer.from_crs(4326, crs, always_xy=True)
    middle = to_crs.transform(0.5 * (area.west + area.east), 0.5 * (area.south + area.north))
    refuse_exchanged(np.array([middle]), crs, "the test")
    refuse_exchanged(np.zeros((1, 2)), crs, "the test")


def test_a_place_far_beyond_the_area_of_use_passes_where_exchanging_does_not_help():
    refuse_exchanged(PLACE, CRS("EPSG:3031"), "the test")
    refuse_exchanged(PLACE, CRS("EPSG:32601"), "the test")


def test_exchanged_points_are_refused(tmp_path):
    rows = [f"{y},{x},100,0.1" for x, y in PLACE.tolist()]
    (tmp_path / "p.csv").write_text("\n".join(["x_m,y_m,z_m,sigma_z_m", *rows]) + "\n")
    with pytest.raises(InputError, match=r"p\.csv lies at easting 6700100 m .* when the two are exchanged"):
        SurfacePoints.read(tmp_path / "p.csv", crs="EPSG:32608")


@pytest.mark.parametrize("wanted", [None, "EPSG:32609"])
def test_an_exchanged_area_is_refused(tmp_path, wanted):
    shape = shapely.Polygon([(y, x) for x, y in shapely.box(*PLACE[0], *PLACE[1]).exterior.coords])
    write_features(tmp_path / "a.gpkg", [shape], {}, CRS("EPSG:32608"), layer="area")
    with pytest.raises(InputError, match="when the two are exchanged"):
        SurveyArea.read(tmp_path / "a.gpkg", crs=wanted)
