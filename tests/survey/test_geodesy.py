import pytest
from pyproj import CRS

from survey import InputError
from survey.geodesy import projected_crs, same_crs, same_vertical_datum, vertical_datum_of


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
