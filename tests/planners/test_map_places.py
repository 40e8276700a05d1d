import numpy as np
import pytest
import shapely

from planners.prediction.places import spread_places
from survey import InputError, SurveyArea

CRS = "EPSG:32608"


def test_places_lie_on_free_ground():
    zone = shapely.box(0.0, 0.0, 300.0, 600.0)
    places = spread_places(SurveyArea(shapely.box(0.0, 0.0, 600.0, 600.0), CRS, no_go=(zone,)), 400)
    assert len(places) == pytest.approx(400, abs=8)
    assert (places[:, 0] >= 300.0).all()


def test_places_are_in_no_step_with_lines():
    places = spread_places(SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), CRS), 400)
    for n_lines in range(2, 60):
        # Distance to the middle between lines, in spacings: uniform between 0 and a half.
        offset = np.abs((places / 600.0 * n_lines) % 1.0 - 0.5)
        assert offset.mean(axis=0) == pytest.approx([0.25, 0.25], abs=0.01)


def test_ground_that_no_place_meets_is_refused():
    strip = shapely.Polygon([(0, 0), (600, 599.9), (600, 600), (0, 0.1)])
    with pytest.raises(InputError, match="so thin that no node"):
        spread_places(SurveyArea(strip, CRS), 2)
