"""Profiles follow the swath and the cross line; trajectory errors are estimate less reference."""

import numpy as np
import pytest

from survey.data.route import Leg
from survey.data.trajectory import Trajectory
from survey.figures import terrain_profile, trajectory_error
from survey.figures.curves import cross_line


def line_of(axes, label):
    return next(line for line in axes.lines if line.get_label() == label)


def test_the_profile_along_a_swath_shows_the_reference_there(site):
    figure = terrain_profile(site.reconstruction, site.truth, site.route, prior=site.prior, area=site.area)
    along, across, below, _ = figure.axes
    swath = site.route.swaths[2]
    distance, height = line_of(along, "Reference").get_data()
    assert distance[-1] == pytest.approx(swath.length_m)
    places = swath.xy[0] + np.outer(distance / swath.length_m, swath.xy[-1] - swath.xy[0])
    np.testing.assert_allclose(height, site.truth.at(places), atol=1e-9)
    assert line_of(across, "Prior") is not None
    error = below.lines[-1].get_ydata()
    # Between the grid's nodes the ±0.1 m of a checkerboard can only become smaller.
    assert np.nanmax(np.abs(error)) <= 0.1 + 1e-9
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "Elevation [m]",
        "Elevation [m]",
        "Error [m]",
        "Error [m]",
    ]


def test_the_band_is_two_sigma_wide(site):
    figure = terrain_profile(site.reconstruction, site.truth, site.route, area=site.area)
    band = figure.axes[2].collections[0].get_paths()[0].vertices
    # Swath 3 lies at 125 m east, where the claim is 0.2 m.
    assert band[:, 1].max() == pytest.approx(0.4)
    assert band[:, 1].min() == pytest.approx(-0.4)


def test_the_cross_profile_marks_where_the_route_crosses(site):
    figure = terrain_profile(site.reconstruction, site.truth, site.route, area=site.area)
    crossings = line_of(figure.axes[1], "Route").get_xdata()
    # The line begins at the outline, 10 m east; swaths stand at 25, 75, 125 and 175 m.
    np.testing.assert_allclose(crossings, [15.0, 65.0, 115.0, 165.0], atol=1e-6)


def test_profiles_are_blank_where_the_area_is_not(site):
    figure = terrain_profile(site.reconstruction, site.truth, site.route, area=site.area)
    distance, height = line_of(figure.axes[1], "Reconstruction").get_data()
    # The cross line runs at 82.5 m north: through the no-go triangle, which there spans 71.25 to 78.75 m east.
    assert np.isnan(height[(distance > 62.0) & (distance < 68.0)]).all()
    assert np.isfinite(height[distance < 60.0]).all()


def test_a_swath_due_east_is_crossed_due_north(site):
    line = cross_line(Leg("swath", [[500_000.0, 6_712_050.0], [500_200.0, 6_712_050.0]]), site.truth)
    np.testing.assert_allclose(line, [[500_100.0, 6_712_000.0], [500_100.0, 6_712_200.0]])


def test_the_error_of_the_trajectory_is_shown_per_axis(site):
    figure = trajectory_error(site.trajectory, site.reference_trajectory)
    for axes, offset in zip(figure.axes, (0.3, -0.1, 0.0), strict=True):
        np.testing.assert_allclose(line_of(axes, "Estimate \u2212 reference").get_ydata(), offset, atol=1e-9)
        band = axes.collections[0].get_paths()[0].vertices[:, 1]
        assert band.max() == pytest.approx(0.4)
    assert [axes.get_title(loc="right") for axes in figure.axes] == ["100% within ± 2 σ"] * 3
    assert "Lost" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_poses_outside_the_reference_are_left_out(site):
    reference = site.reference_trajectory
    first = Trajectory(
        reference.time_s[:30],
        reference.position[:30],
        reference.quaternion[:30],
        reference.covariance[:30],
        reference.crs,
    )
    axes = trajectory_error(site.trajectory, first).axes[0]
    assert line_of(axes, "Estimate \u2212 reference").get_xdata().max() == 29.0
