"""Probability of steep ground: exact for known slopes, no-go ground for the next plan, risk of a route."""

import numpy as np
import pytest

from survey import Dem, Grid, Route, SurveyArea
from survey.core.documents import read_json
from survey.data.route import Leg
from survey.reconstruction.hazards import SlopeHazard, hazard_grid, probability_beyond, slope_hazard
from tests.survey.reconstruction.joint.test_slopes import solved

CRS = "EPSG:32608"
GRID = Grid((0.0, 0.0, 100.0, 100.0), 10.0, CRS)
AREA = SurveyArea.rectangle((0.0, 0.0, 100.0, 100.0), CRS)


def test_probabilities_agree_with_samples():
    rng = np.random.default_rng(1)
    for _ in range(5):
        mean, root = rng.normal(size=2), rng.normal(size=(2, 2))
        samples = mean + rng.standard_normal((200_000, 2)) @ root.T
        share = np.mean(np.hypot(*samples.T) > 1.3)
        found = probability_beyond(mean[None], (root @ root.T)[None], 1.3)[0]
        assert found == pytest.approx(share, abs=0.004)  # 3.6 standard errors of the share


def test_known_slopes_are_certain():
    known = np.array([[0.1, 0.0], [0.3, 0.0], [0.0, -0.3]])
    tiny = np.tile(1e-12 * np.eye(2), (3, 1, 1))
    np.testing.assert_allclose(probability_beyond(known, tiny, 0.2), [0.0, 1.0, 1.0], atol=1e-9)


def test_a_singular_covariance_is_allowed():
    line = np.array([[[0.04, 0.0], [0.0, 0.0]]])
    assert probability_beyond(np.zeros((1, 2)), line, 0.2)[0] == pytest.approx(0.3173, abs=1e-3)


def steep_in_the_north_east() -> SlopeHazard:
    x, y = np.meshgrid(GRID.x, GRID.y)
    return SlopeHazard(Dem.on(GRID, np.where((x > 60.0) & (y > 60.0), 0.9, 0.01)), 15.0, 2.0)


def test_dangerous_ground_is_no_go_ground_of_the_next_plan(tmp_path):
    hazard = steep_in_the_north_east()
    line = Route((Leg("swath", [[5.0, 50.0], [95.0, 50.0]]),), CRS, "line")
    hazard.write(tmp_path, AREA, line)
    following = SurveyArea.read(tmp_path / "next_area.gpkg")
    inside = following.contains(np.array([[80.0, 80.0], [20.0, 20.0], [40.0, 90.0]]))
    assert inside.tolist() == [False, True, True]
    facts = read_json(tmp_path / "hazard.json", "the hazards")
    assert facts["no_go_share"] == pytest.approx(0.1225)  # 35 x 35 m of 100 x 100 m
    assert facts["route_worst_probability"] == pytest.approx(0.01, abs=1e-6)


def test_a_route_through_steep_ground_is_risky():
    hazard = steep_in_the_north_east()
    risky = Route((Leg("swath", [[5.0, 85.0], [95.0, 85.0]]),), CRS, "line")
    risk = hazard.along(risky)
    assert risk.worst == pytest.approx(0.9)
    assert risk.expected_m == pytest.approx(0.9 * 30.0, rel=0.2)


def test_a_map_gives_more_risk_where_it_is_steep_or_unknown():
    grid = Grid((0.0, 0.0, 120.0, 80.0), 8.0)
    strict, lax = (slope_hazard(solved(), grid, limit).probability.elevation for limit in (2.0, 8.0))
    assert (strict >= lax - 1e-9).all()
    assert lax.min() >= 0.0
    assert strict.max() <= 1.0
    assert strict.mean() > lax.mean() + 0.1


def test_large_maps_are_judged_on_a_coarser_grid():
    assert np.prod(hazard_grid(Grid((0.0, 0.0, 900.0, 900.0), 1.0, CRS)).shape) < 12_000
