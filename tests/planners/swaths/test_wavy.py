import numpy as np
import pytest
import shapely

from planners import BestConfig, LawnmowerConfig, VarianceDrivenConfig, WavyConfig, plan
from planners.prediction.places import slope_length_m
from survey import ConfigError, Dem, Grid, InputError, SurveyArea
from survey.core.config import validated
from survey.reconstruction.gp.kernels import Matern32, SquaredExponential

CRS = "EPSG:32608"
SITE = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), CRS)
WAVES = WavyConfig(swaths=4, inset_share=0.25, outer_share=0.5, steepness=0.6, wavelength_m=105.0)


def deviation(swath):
    """Signed distance of waypoints from a swath's axis, positive to the left of the first sweep."""
    along = swath.axis[1] - swath.axis[0]
    return (swath.xy - swath.axis[0]) @ [-along[1], along[0]] / np.hypot(*along)


def test_waves_have_the_asked_length_and_steepness():
    # Swaths of 600 − 2 · 0.25 · 150 = 525 m hold exactly five waves of 105 m.
    swath = plan(SITE, None, WAVES).swaths[0]
    v = deviation(swath)
    amplitude = 0.6 * 105.0 / (2.0 * np.pi)
    assert v.max() == pytest.approx(amplitude, rel=1e-12)
    assert v.min() == pytest.approx(-amplitude, rel=1e-12)
    crossings = np.flatnonzero(np.abs(v) < 1e-9)
    assert np.diff(swath.xy[crossings, 0]) == pytest.approx(np.full(10, 52.5))


def test_swaths_begin_and_end_on_their_axis():
    for swath in plan(SITE, None, WAVES).swaths:
        assert swath.xy[[0, -1]].tolist() == swath.axis.tolist()


def test_neighbours_wind_side_by_side():
    first, second = plan(SITE, None, WAVES).swaths[:2]
    assert second.xy[::-1] == pytest.approx(first.xy + [0.0, 150.0], abs=1e-9)


def test_the_amplitude_never_exceeds_its_share_of_the_spacing():
    route = plan(SITE, None, WavyConfig(swaths=20, steepness=2.0, wavelength_m=500.0, amplitude_share=0.2))
    assert max(np.abs(deviation(s)).max() for s in route.swaths) <= 0.2 * route.spacing_m + 1e-9


def test_no_steepness_gives_the_inset_lawnmower():
    straight = LawnmowerConfig(swaths=5, inset_share=0.25, outer_share=0.35)
    waves = WavyConfig(swaths=5, steepness=0.0, wavelength_m=100.0)
    assert plan(SITE, None, waves).path().tolist() == plan(SITE, None, straight).path().tolist()


def test_the_wavelength_follows_the_kernel():
    kernel = SquaredExponential(30.0, 120.0)
    by_kernel = plan(SITE, None, WavyConfig(swaths=4, wavelength_scales=1.0), kernel=kernel)
    by_hand = plan(SITE, None, WavyConfig(swaths=4, wavelength_m=120.0))
    # The slope length is taken at a lag of 2 % of the scale, where it is 1e-4 too long.
    assert by_kernel.path() == pytest.approx(by_hand.path(), abs=0.02)


def test_slope_lengths_of_the_closed_forms():
    # A lag of 2 % stands for the limit: the next order is 1e-4 for one, 1e-2 for the other.
    assert slope_length_m(SquaredExponential(5.0, 80.0)) == pytest.approx(80.0, rel=2e-4)
    assert slope_length_m(Matern32(5.0, 80.0)) == pytest.approx(80.0 / np.sqrt(3.0), rel=0.02)
    across = SquaredExponential(5.0, 80.0, anisotropy=4.0, angle_deg=0.0)
    assert slope_length_m(across) == pytest.approx(20.0, rel=2e-2)


@pytest.mark.parametrize("heading_deg", [0.0, 31.0, 90.0])
def test_waves_stay_on_concave_ground_with_holes(heading_deg):
    outline = shapely.Polygon([(0, 0), (500, 0), (500, 400), (260, 200), (0, 400)])
    hole = shapely.box(80.0, 60.0, 160.0, 140.0)
    area = SurveyArea(outline, CRS, no_go=(hole,))
    route = plan(area, None, WavyConfig(swaths=8, heading_deg=heading_deg, wavelength_m=120.0))
    assert area.free.covers(route.line)


def test_tie_lines_run_square_to_the_swaths_from_side_to_side():
    route = plan(SITE, None, LawnmowerConfig(swaths=4, tie_lines=2))
    ties = route.swaths[4:]
    assert sorted(tie.xy[0, 0] for tie in ties) == [150.0, 450.0]
    assert all(sorted(tie.xy[:, 1].tolist()) == [0.0, 600.0] for tie in ties)
    # The four swaths end in the north-west, so the nearest line is driven first, southwards.
    assert ties[0].xy.tolist() == [[150.0, 600.0], [150.0, 0.0]]


@pytest.mark.parametrize(
    "config", [WavyConfig(swaths=3), BestConfig(swaths=3), VarianceDrivenConfig(budget_m=900.0)]
)
def test_patterns_that_need_to_know_the_terrain_say_so(config):
    with pytest.raises(InputError, match="prior"):
        plan(SITE, None, config)


def test_a_prior_with_too_few_cells_is_refused():
    prior = Dem.on(Grid((0.0, 0.0, 600.0, 600.0), 600.0, CRS), np.zeros((2, 2)))
    with pytest.raises(InputError, match="at least 9"):
        plan(SITE, prior, WavyConfig(swaths=3))


def test_settings_out_of_range_are_refused():
    with pytest.raises(ConfigError, match="amplitude_share"):
        validated(WavyConfig, {"swaths": 2, "amplitude_share": 0.7}, "planner")


def test_waves_also_pass_between_holes_where_no_line_runs():
    holes = (shapely.box(150.0, 100.0, 290.0, 500.0), shapely.box(330.0, 100.0, 460.0, 500.0))
    area = SurveyArea(SITE.polygon, CRS, no_go=holes)
    route = plan(area, None, WavyConfig(swaths=4, wavelength_m=105.0, heading_deg=90.0))
    # The lines lie at 57, 219, 381 and 543 m; the passage between 290 and 330 m is met by none.
    between = [swath for swath in route.swaths if 290.0 < swath.xy[:, 0].mean() < 330.0]
    assert len(between) == 1
    assert between[0].length_m > 300.0
