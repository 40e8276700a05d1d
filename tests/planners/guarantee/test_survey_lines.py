import numpy as np
import shapely

from planners.guarantee.requirement import MapRequirement
from planners.guarantee.survey_lines import SurveyLines, swath_counts
from survey import SurveyArea

SITE = SurveyArea.rectangle((0.0, 0.0, 300.0, 200.0), "EPSG:32608")


def test_a_line_is_addressed_by_its_distance_from_the_edge():
    lines = SurveyLines(SITE, heading_deg=0.0)
    (piece,) = lines.swath(50.0, 40.0, 90.0)
    assert lines.width_m == 200.0
    assert piece[[0, -1], 1].tolist() == [50.0, 50.0]
    # It ends a quarter of a spacing before the border and winds by a quarter of one at most.
    assert piece[0, 0] == 10.0
    assert np.abs(piece[:, 1] - 50.0).max() <= 10.0


def test_no_go_ground_cuts_a_line():
    area = SurveyArea(SITE.polygon, SITE.crs, (shapely.box(100.0, 0.0, 150.0, 200.0),))
    pieces = SurveyLines(area, heading_deg=0.0).swath(50.0, 40.0, 90.0)
    assert len(pieces) == 2
    assert all(area.free.covers(shapely.linestrings(piece)) for piece in pieces)


def test_a_line_beside_the_area_is_empty():
    assert SurveyLines(SITE, heading_deg=0.0).swath(500.0, 40.0, 90.0) == []


def test_a_piece_that_takes_more_than_it_measures_is_not_driven():
    # Notches leave a piece of 20 m, and are longer to go around than the 36 m that are worth driving.
    notches = shapely.box(270.0, 0.0, 280.0, 80.0) | shapely.box(270.0, 120.0, 280.0, 200.0)
    ground = SurveyArea(SITE.polygon - notches, SITE.crs)
    (piece,) = SurveyLines(ground, heading_deg=0.0).swath(150.0, 40.0, 90.0)
    assert piece[:, 0].max() == 260.0


def test_no_more_swaths_are_considered_than_can_be_driven():
    wanted = MapRequirement(1.0)
    large = swath_counts(30_000.0, 30.0, wanted, 9e8)
    # Five cells of the prior apart 200 swaths are 6,000 km to drive, and no more are tried.
    assert large == (200,)
    assert swath_counts(30_000.0, 90.0, wanted, 9e8) == (67,)
    assert swath_counts(9_000.0, 30.0, wanted, 9e7)[-1] == 200
    # Two samples apart, 100 swaths of a square kilometre are 100 km.
    assert swath_counts(2_000.0, 30.0, wanted, 1e6)[-1] == 100
    stated = MapRequirement(1.0, max_swaths=400)
    assert swath_counts(30_000.0, 30.0, stated, 9e8)[-1] == 400
