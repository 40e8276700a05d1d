import shapely

from planners import LawnmowerConfig, plan
from planners.swaths.reference_lines import swaths_text
from survey import SurveyArea

BAY = SurveyArea(
    shapely.Polygon([(0, 0), (600, 0), (600, 600), (350, 600), (350, 200), (250, 200), (250, 600), (0, 600)]),
    "EPSG:32608",
)


def test_a_line_cut_by_a_bay_counts_once():
    route = plan(BAY, None, LawnmowerConfig(swaths=4, heading_deg=0.0))
    assert route.n_lines == 4
    assert len(route.swaths) == 7
    assert swaths_text(route) == "4 lines in 7 pieces"


def test_uncut_swaths_are_swaths():
    site = SurveyArea.rectangle((0.0, 0.0, 600.0, 300.0), "EPSG:32608")
    assert swaths_text(plan(site, None, LawnmowerConfig(swaths=4, heading_deg=33.0))) == "4 swaths"
    assert swaths_text(plan(site, None, LawnmowerConfig(swaths=1))) == "1 swath"
    assert plan(site, None, LawnmowerConfig(swaths=4, tie_lines=2)).n_lines == 6
