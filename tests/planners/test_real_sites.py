"""Fields, a glacier among nunataks and avalanche slopes, as their surveyors drew them."""

import os
from pathlib import Path

import numpy as np
import pytest
import shapely
from pyproj import CRS
from shapely import LineString

from planners.routes.fleet import share
from planners.routes.shortest_paths import FreeGround
from planners.routes.tours import connect
from planners.routes.traversability import RoverLimits, drivable
from planners.swaths.decomposition import swaths_on, unswept
from planners.swaths.heading import heading_by
from survey.core.errors import InputError
from survey.core.transformation import transformed
from survey.data.area import SurveyArea
from survey.data.dem import Dem
from survey.data.route import Leg
from survey.io.vector import read_features

DATA = Path(os.environ.get("FIRNLINE_DATA", Path(__file__).parents[3] / "shared" / "data"))
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="FIRNLINE_DATA is missing")


def assert_on_ground(area: SurveyArea, legs: tuple[Leg, ...]) -> None:
    shapely.prepare(area.free)
    assert shapely.covers(area.free, [LineString(leg.xy) for leg in legs]).all()


def test_a_field_is_swept_along_its_narrow_side() -> None:
    area = SurveyArea.read(DATA / "coverage_fields2cover" / "test.json", crs="EPSG:32631")
    ground = FreeGround(area.free)
    swaths = swaths_on(ground, 12.0, heading_by("narrowest", ground))
    legs = connect(swaths, ground)
    assert_on_ground(area, legs)
    swath_m = sum(leg.length_m for leg in legs if leg.kind == "swath")
    # Swath metres times spacing is the area, within what the last strip and the tips change.
    assert swath_m * 12.0 == pytest.approx(area.free.area, rel=0.06)
    assert sum(tip.area for tip in unswept(ground, swaths, 12.0)) < 0.01 * area.free.area


@pytest.fixture(scope="module")
def columbia() -> SurveyArea:
    """Six kilometres of Columbia Glacier, Alaska, with its nunataks, simplified to 20 m."""
    features = read_features(DATA / "dem_oggm_glaciers" / "outlines" / "RGI60-01.10689_Columbia.shp")
    crs = CRS("EPSG:32606")
    outline = shapely.transform(
        features.geometry[0], lambda xy: transformed(xy, features.crs, crs, "the outline")
    )
    # The outline touches itself; a GIS would mend it so.
    window = shapely.intersection(
        shapely.make_valid(outline), shapely.box(487_300, 6_792_100, 493_300, 6_798_100)
    )
    parts = shapely.get_parts(shapely.simplify(window, 20.0))
    return SurveyArea(max(parts, key=lambda part: part.area), crs)


def test_the_outline_touches_itself_and_is_read_with_its_nunataks() -> None:
    path = DATA / "dem_oggm_glaciers" / "outlines" / "RGI60-01.10689_Columbia.shp"
    area = SurveyArea.read(path, crs="EPSG:32606")
    assert area.ground_area_m2 == pytest.approx(773.87e6, rel=1e-4)
    assert sum(len(part.interiors) for part in shapely.get_parts(area.polygon)) >= 140


def test_three_rovers_survey_a_glacier_among_nunataks(columbia: SurveyArea) -> None:
    assert len(columbia.polygon.interiors) >= 5
    site = drivable(columbia, RoverLimits(clearance_m=10.0))
    swaths = swaths_on(site.ground, 250.0, 90.0)
    home = site.ground.inside([columbia.polygon.representative_point().coords[0]])[0]
    legs = share(swaths, site.ground, [home] * 3)
    assert_on_ground(columbia, legs)
    assert {leg.rover for leg in legs} == {0, 1, 2}
    nearest_m = min(LineString(leg.xy).distance(columbia.polygon.boundary) for leg in legs)
    assert nearest_m >= 10.0 - 1e-6


def test_avalanche_slopes_are_left_out_at_20_degrees() -> None:
    dem = Dem.read(DATA / "dem_avaframe_tirol" / "avaHit.asc", crs="EPSG:31287")
    area = SurveyArea.read(DATA / "dem_avaframe_tirol" / "polygons" / "entHit.shp", crs="EPSG:31287")
    site = drivable(area, RoverLimits(max_pitch_deg=20.0, max_roll_deg=20.0), dem)
    steep = sum(piece.polygon.area for piece in site.left_out if piece.reason == "too steep")
    # The median slope there is 30 degrees: nearly all of it is out, and said to be.
    assert steep > 0.8 * area.polygon.area
    swaths = swaths_on(site.ground, 10.0, heading_by("slope", site.ground, dem=dem))
    legs = connect(swaths, site.ground)
    assert_on_ground(area, legs)
    driven = shapely.get_coordinates(shapely.segmentize([LineString(leg.xy) for leg in legs], 1.0))
    assert np.nanmax(dem.slope().at(driven)) <= 20.0
    with pytest.raises(InputError, match=r"not all of the area can be reached"):
        drivable(area, RoverLimits(max_pitch_deg=20.0, max_roll_deg=20.0), dem, reach_all=True)


def test_a_release_area_that_is_steep_throughout_is_refused() -> None:
    dem = Dem.read(DATA / "dem_avaframe_tirol" / "avaAlr.tif")
    area = SurveyArea.read(DATA / "dem_avaframe_tirol" / "polygons" / "relAlr.shp", crs="EPSG:31287")
    with pytest.raises(InputError, match=r"no ground is left to drive on: .* m² around .*too steep"):
        drivable(area, RoverLimits(max_pitch_deg=20.0, max_roll_deg=20.0), dem)
