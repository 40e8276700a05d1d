"""Error figures: symmetric about zero, blank where nothing is known, with the numbers they mark."""

from dataclasses import replace

import numpy as np
import pytest
from affine import Affine
from matplotlib.collections import QuadMesh

from survey.core.errors import InputError
from survey.core.text import round_number
from survey.data.dem import Dem
from survey.figures import calibration_plot, error_against_distance, error_histogram, error_map
from survey.figures.errors import height_error
from survey.figures.style import symmetric_limits


def test_the_error_is_reconstruction_less_reference_inside_the_area(site):
    error = height_error(site.reconstruction, site.truth, site.area)
    inside = site.area.contains(site.grid.xy).reshape(site.grid.shape)
    # Heights of 1500 m leave 12 digits behind the point.
    np.testing.assert_allclose(error[inside], site.error[inside], atol=1e-9)
    assert np.isnan(error[~inside]).all()


def test_ground_without_reference_has_no_error(site):
    partly = site.truth.elevation.copy()
    partly[:20] = np.nan
    error = height_error(site.reconstruction, Dem(partly, site.truth.transform, site.truth.crs))
    assert np.isnan(error[:20]).all()
    assert np.isfinite(error[20:]).all()


def test_a_reference_elsewhere_is_refused(site):
    moved = Dem(
        site.truth.elevation, Affine(5.0, 0.0, 900_000.0, 0.0, -5.0, 6_712_200.0), site.truth.crs, "EGM96"
    )
    with pytest.raises(InputError, match="nothing can be compared"):
        height_error(site.reconstruction, moved)


def test_another_vertical_datum_is_refused(site):
    ellipsoidal = Dem(site.truth.elevation, site.truth.transform, site.truth.crs, "WGS 84 ellipsoid")
    with pytest.raises(InputError, match="EGM96"):
        error_map(site.reconstruction, ellipsoidal)


def test_error_colours_are_symmetric(site):
    axes = error_map(site.reconstruction, site.truth, area=site.area, route=site.route).axes[0]
    low, high = next(one for one in axes.collections if isinstance(one, QuadMesh)).get_clim()
    assert low == -high
    assert high == pytest.approx(0.1, abs=1e-9)
    assert len(axes.lines) == len(site.route.swaths)


def test_signs_of_errors_are_marked_for_prints_in_grey(site):
    east = site.truth.x > 500_100.0
    leaning = site.truth.elevation + np.where(east, 0.3, -0.3)
    tilted = replace(site.reconstruction, mean=Dem(leaning, site.truth.transform, site.truth.crs, "EGM96"))
    marks = {line.get_marker(): line.get_xdata() for line in error_map(tilted, site.truth).axes[0].lines}
    assert marks["+"].min() > 500_095.0 > marks["_"].max() - 10.0


def test_one_wild_error_does_not_set_the_colours():
    errors = np.r_[np.linspace(-1.0, 1.0, 1001), 500.0]
    limits = symmetric_limits(errors)
    assert limits.vmax == -limits.vmin
    assert limits.vmax == pytest.approx(0.99, abs=0.01)


def test_the_histogram_marks_both_sides(site, scored):
    figure = error_histogram(site.reconstruction, site.truth, scored.elevation, area=site.area)
    marks = sorted(line.get_xdata()[0] for line in figure.axes[0].lines)
    e = scored.elevation
    np.testing.assert_allclose(marks, sorted(s * v for s in (-1, 1) for v in (e.nmad_m, e.rmse_m, e.p95_m)))
    # Every error lies within the axis, so the bars are all of them.
    assert sum(bar.get_height() for bar in figure.axes[0].patches) == pytest.approx(1.0)


def test_bands_of_distance_hold_the_known_error(site):
    axes = error_against_distance(site.reconstruction, site.truth, site.route, area=site.area).axes[0]
    curves = {line.get_label(): line.get_ydata() for line in axes.lines}
    np.testing.assert_allclose(curves["RMSE"], 0.1, atol=1e-9)
    assert ((curves["Claimed σ"] >= 0.1 - 1e-12) & (curves["Claimed σ"] <= 0.2 + 1e-12)).all()
    assert axes.get_xlabel() == "Distance to the route [m]"


def test_the_calibration_plot_shows_observed_shares(site, scored):
    figure = calibration_plot(site.reconstruction, site.truth, scored.calibration, area=site.area)
    coverage, ratio = figure.axes[:2]
    drawn = next(line for line in coverage.lines if line.get_label() == "This survey")
    np.testing.assert_array_equal(drawn.get_xdata(), scored.calibration.levels)
    np.testing.assert_array_equal(drawn.get_ydata(), scored.calibration.shares)
    # |error| / σ is 1 in the west and 0.5 in the east and nowhere else.
    filled = [bar.get_x() for bar in ratio.patches if bar.get_height() > 0]
    np.testing.assert_allclose(filled, [0.5, 1.0], atol=0.13)
    assert sum(bar.get_height() * bar.get_width() for bar in ratio.patches) == pytest.approx(1.0)


@pytest.mark.parametrize(("value", "expected"), [(1.0, 1.0), (0.99, 0.5), (2400.0, 2000.0), (7e-4, 5e-4)])
def test_round_numbers(value, expected):
    assert round_number(value) == pytest.approx(expected)
