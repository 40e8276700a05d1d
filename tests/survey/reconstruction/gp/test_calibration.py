"""The scale of the standard deviation is learned from points the map was not shown."""

import numpy as np
import pytest

from survey.core.arrays import BoolArray, FloatArray
from survey.reconstruction.gp.fit import SigmaCalibration, left_out

RNG = np.random.default_rng(3)
SWATHS = np.column_stack([100.0 * RNG.integers(0, 4, 900) + RNG.normal(0, 6, 900), RNG.uniform(0, 400, 900)])
GAPS = RNG.uniform(0.0, 40.0, 500)


def test_the_choice_is_the_same_every_time_and_leaves_most_points() -> None:
    out = left_out(SWATHS, GAPS).points
    np.testing.assert_array_equal(out, left_out(SWATHS, GAPS).points)
    assert 0.1 < out.mean() < 0.3


def test_whole_pieces_of_swath_are_left_out() -> None:
    out = left_out(SWATHS, GAPS).points
    to_nearest = [np.min(np.hypot(*(SWATHS[~out] - place).T)) for place in SWATHS[out]]
    # Points are 4 m apart along a swath; the gaps left must be as wide as the survey's.
    assert max(to_nearest) > 15.0


@pytest.mark.parametrize(("spread", "low", "high"), [(0.5, 1.0, 1.0), (1.0, 1.0, 1.15), (2.0, 1.6, 2.2)])
def test_bold_maps_are_scaled_up_and_cautious_ones_left(spread: float, low: float, high: float) -> None:
    rng = np.random.default_rng(4)
    values = spread * rng.standard_normal(900)

    def predict(kept: BoolArray, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
        assert kept.sum() + len(xy) == 900
        return np.zeros(len(xy)), np.ones(len(xy))

    found = SigmaCalibration.cross_validated(SWATHS, values, np.full(900, 1e-4), predict, GAPS)
    assert low <= found.at(np.array([5.0]))[0] <= high
    assert found.held_out["coverage_95_after"] >= found.held_out["coverage_95_before"]


def test_a_survey_of_one_corner_still_keeps_most_of_its_points() -> None:
    corner = RNG.uniform(0.0, 50.0, (400, 2))
    out = left_out(corner, np.full(100, 500.0)).points
    assert 0.1 < out.mean() < 0.3


def test_few_points_change_nothing() -> None:
    found = SigmaCalibration.cross_validated(
        SWATHS[:40], np.full(40, 9.0), np.ones(40), lambda _, xy: (np.zeros(len(xy)), np.ones(len(xy))), GAPS
    )
    assert found.at(np.array([0.0, 50.0])).tolist() == [1.0, 1.0]
