"""Paths with their ellipses, and errors over the distance driven: what is drawn is what was given."""

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection

from survey.figures import path_map
from survey.figures.paths import error_over_distance

PATH = np.column_stack([np.linspace(0.0, 200.0, 41), np.zeros(41), np.zeros(41)]) + [5e5, 6e6, 100.0]


def _ellipses(figure):
    return next(it for it in figure.axes[0].collections if isinstance(it, EllipseCollection))


def test_ellipses_have_the_size_and_the_direction_of_the_covariance():
    # 6 m along the diagonal, 2 m across it: large enough to be drawn as they are.
    turn = np.array([[1.0, -1.0], [1.0, 1.0]]) / np.sqrt(2.0)
    covariance = np.tile(np.eye(3), (41, 1, 1))
    covariance[:, :2, :2] = turn @ np.diag([36.0, 4.0]) @ turn.T
    figure = path_map(PATH, covariance)
    ellipses = _ellipses(figure)
    assert ellipses.get_widths() == pytest.approx(12.0)
    assert ellipses.get_heights() == pytest.approx(4.0)
    assert np.asarray(ellipses.get_angles()) % 180.0 == pytest.approx(45.0)
    assert "1σ of the position" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_ellipses_too_small_to_see_are_drawn_larger_and_say_so():
    figure = path_map(PATH, np.tile(0.01 * np.eye(3), (41, 1, 1)))
    words = next(text.get_text() for text in figure.legends[0].get_texts() if "σ" in text.get_text())
    factor = float(words.split("drawn ")[1].split(" ×")[0])
    assert factor > 1.0
    assert _ellipses(figure).get_widths() == pytest.approx(2.0 * 0.1 * factor)


def test_a_rover_that_stood_still_can_be_drawn():
    figure = path_map(np.zeros((3, 3)), np.tile(np.eye(3), (3, 1, 1)), in_the_world=False)
    assert figure.axes[0].get_xlabel() == "Forward at the start [m]"


def test_errors_over_distance_are_split_into_across_and_up():
    covariance = np.tile(np.diag([0.09, 0.16, 0.25]), (41, 1, 1))
    figure = error_over_distance(PATH + [0.3, 0.4, -0.2], PATH, covariance, np.arange(41) > 30)
    across, up = figure.axes
    assert across.lines[-1].get_xdata()[-1] == pytest.approx(200.0)
    assert across.lines[-1].get_ydata() == pytest.approx(0.5)
    assert up.lines[-1].get_ydata() == pytest.approx(-0.2)
    # The radial σ: √(0.3² + 0.4²).
    assert across.collections[0].get_paths()[0].vertices[:, 1].max() == pytest.approx(0.5)
    assert "Lost" in [text.get_text() for text in up.get_legend().get_texts()]
