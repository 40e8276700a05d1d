"""A survey is judged where area, reference and map all speak, and the rest is counted."""

import json
from dataclasses import replace

import numpy as np
import pytest
from pyproj import CRS
from shapely import Polygon

import survey
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.route import Leg, Route
from survey.reconstruction import Reconstruction

UTM = CRS("EPSG:32608")
GRID = Grid((0.0, 0.0, 40.0, 40.0), 10.0, UTM)
AREA = survey.SurveyArea.rectangle((0.0, 0.0, 40.0, 40.0), UTM)


def hills() -> Dem:
    return Dem.on(GRID, GRID.x[None, :] * 0.1 + GRID.y[:, None] ** 2 * 0.01, "EGM96 height")


def mapped(error: FloatArray | float = 0.0, std: float = 0.1) -> Reconstruction:
    heights = hills().elevation + error
    return Reconstruction(
        Dem.on(GRID, heights, "EGM96 height"),
        Dem.on(GRID, np.full(GRID.shape, std)),
        np.full(GRID.shape, 3),
        "gp",
        {},
    )


def line() -> Route:
    return Route((Leg("swath", np.array([[5.0, 5.0], [5.0, 35.0]])),), UTM, "line", 10.0)


def test_a_perfect_map_has_no_error_and_the_best_class() -> None:
    result = survey.score(mapped(), truth=hills(), route=line(), area=AREA)
    assert result.elevation.n == 25
    assert result.elevation.worst_m == 0.0
    assert result.coverage.cells_share == 0.25
    assert result.calibration.coverage_95 == 1.0
    assert all(verdict.met for verdict in result.verdicts)
    assert result.covered_share == 1.0


def test_errors_are_map_minus_reference() -> None:
    result = survey.score(mapped(0.5), truth=hills())
    assert result.elevation.bias_m == pytest.approx(0.5, rel=1e-12)
    assert result.calibration.z_rms == pytest.approx(5.0, rel=1e-12)
    assert not result.verdicts[0].met


def test_ground_outside_the_area_is_not_scored_but_counted() -> None:
    error = np.zeros(GRID.shape)
    error[:, 3:] = 100.0
    west = survey.SurveyArea.rectangle((0.0, 0.0, 25.0, 40.0), UTM)
    result = survey.score(mapped(error), truth=hills(), area=west)
    assert result.elevation.worst_m == 0.0
    assert (result.elevation.n, result.n_outside) == (15, 10)


def test_no_go_ground_is_not_scored() -> None:
    error = np.zeros(GRID.shape)
    error[2, 2] = 100.0
    pond = Polygon([(15, 15), (25, 15), (25, 25), (15, 25)])
    area = survey.SurveyArea(AREA.polygon, UTM, (pond,))
    result = survey.score(mapped(error), truth=hills(), area=area)
    assert (result.elevation.worst_m, result.n_outside) == (0.0, 1)


def test_holes_of_the_reference_are_not_scored_but_counted() -> None:
    heights = hills().elevation.copy()
    heights[0, 0] = np.nan
    result = survey.score(mapped(), truth=Dem.on(GRID, heights, "EGM96 height"))
    assert (result.elevation.n, result.n_unknown, result.covered_share) == (24, 1, 1.0)


def test_a_map_with_holes_is_scored_on_what_it_covers_and_says_so() -> None:
    error = np.zeros(GRID.shape)
    error[0] = np.nan
    result = survey.score(mapped(error), truth=hills())
    assert (result.elevation.n, result.n_silent) == (20, 5)
    assert result.covered_share == 0.8


def test_the_reference_may_be_finer_and_larger() -> None:
    fine = Grid((-50.0, -50.0, 90.0, 90.0), 2.5, UTM)
    plane = Dem.on(fine, 3.0 + 0.2 * fine.x[None, :] - 0.1 * fine.y[:, None])
    heights = Dem.on(GRID, 3.0 + 0.2 * GRID.x[None, :] - 0.1 * GRID.y[:, None])
    result = survey.score(replace(mapped(), mean=heights), truth=plane)
    # Bilinear interpolation of a plane is exact to rounding.
    assert result.elevation.worst_m < 1e-12


def test_without_a_route_there_is_no_coverage() -> None:
    coverage = survey.score(mapped(), truth=hills()).coverage
    assert (coverage.scc, coverage.alpha, coverage.beta) == (None, None, None)


def test_json_and_back() -> None:
    first = survey.score(mapped(np.linspace(-1, 1, 25).reshape(5, 5)), truth=hills(), route=line(), area=AREA)
    text = json.dumps(first.to_dict(), allow_nan=False)
    assert survey.Score.from_dict(json.loads(text)) == first


def test_json_holds_null_for_what_does_not_exist() -> None:
    result = survey.score(_without_claim(), truth=hills())
    plain = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert plain["elevation"]["skewness"] is None
    assert plain["calibration"]["coverage_95"] is None
    again = survey.Score.from_dict(plain)
    assert np.isnan(again.calibration.z_rms)
    assert np.isnan(again.elevation.kurtosis)


def _without_claim() -> Reconstruction:
    """Return a perfect map that states its deviation outside the reference alone."""
    std = np.full(GRID.shape, np.nan)
    std[0, 0] = 0.1
    heights = hills().elevation.copy()
    heights[0, 0] = np.nan
    return replace(mapped(), mean=Dem.on(GRID, heights, "EGM96 height"), std=Dem.on(GRID, std))


def test_refusals() -> None:
    far = Grid((1000.0, 0.0, 1040.0, 40.0), 10.0, UTM)
    cases = (
        (mapped(), Dem.on(far, np.zeros(far.shape)), None, "nothing to score: of 25 nodes"),
        (mapped(), hills(), survey.SurveyArea.rectangle((50.0, 0.0, 90.0, 40.0), UTM), "nothing to score"),
        (mapped(), hills(), survey.SurveyArea.rectangle(AREA.bounds, "EPSG:32616"), "different systems"),
        (
            mapped(),
            Dem.on(Grid(GRID.bounds, 10.0, CRS(32616)), np.zeros(GRID.shape)),
            None,
            "different systems",
        ),
        (mapped(), Dem.on(GRID, np.zeros(GRID.shape), "NAVD88 height"), None, "vertical datums"),
        (replace(mapped(), quantity="temperature_c"), hills(), None, "temperature_c"),
    )
    for reconstruction, truth, area, words in cases:
        with pytest.raises(InputError, match=words):
            survey.score(reconstruction, truth=truth, area=area)
    with pytest.raises(InputError, match="score the survey again"):
        survey.Score.from_dict({"coverage": {}})
