"""Figure of points that were left out."""

import numpy as np
import pytest

from survey.figures.calibration import held_out_plot
from survey.reconstruction.checks import PredictiveCheck, PredictiveScores


@pytest.fixture
def check():
    rng = np.random.default_rng(6)
    errors = rng.normal(0.0, 0.2, 400)
    before, after = (PredictiveScores.of(errors, np.full(400, sigma)) for sigma in (0.1, 0.2))
    return PredictiveCheck(
        "swaths", 5, before, after, (1.0, 5.0, 20.0), (9.0,) * 3, (0.5,) * 3, (1.1, 1.5, 2.0)
    )


def test_bars_are_the_shares_as_stated_and_their_sum_is_one(check):
    left = held_out_plot(check).axes[0]
    heights = [bar.get_height() for bar in left.patches if bar.get_width() == pytest.approx(0.1)]
    assert np.allclose(heights, check.before.pit_tenths)
    assert sum(heights) == pytest.approx(1.0)


def test_a_deviation_that_is_too_small_has_high_outer_bars_and_the_widened_one_has_not(check):
    assert check.before.pit_tenths[0] + check.before.pit_tenths[-1] > 0.4
    assert check.after.pit_tenths[0] + check.after.pit_tenths[-1] < 0.3


def test_the_factor_is_drawn_against_the_distance_within_the_axes(check):
    right = held_out_plot(check).axes[1]
    (line,) = (line for line in right.lines if line.get_marker() == "o")
    assert line.get_xydata().tolist() == [[1.0, 1.1], [5.0, 1.5], [20.0, 2.0]]
    assert right.get_ylim()[1] >= 2.0
