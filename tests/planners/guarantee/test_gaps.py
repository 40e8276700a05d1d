import numpy as np
import pytest

from planners.guarantee.survey_lines import gaps_filled

SIDE_M = 300.0


def lines(n: int) -> np.ndarray:
    along = np.arange(0.0, SIDE_M + 1.0, 10.0)
    offsets = (np.arange(n) + 0.5) * SIDE_M / n
    return np.array([(x, y) for y in offsets for x in along])


def test_further_lines_are_laid_where_they_save_the_most():
    driven = [50.0, 250.0]
    laid = [offset for offset, _ in gaps_filled(driven, 600.0, 4, 4.0)]
    # Strips of 200 and 350 m: one line halves the first, three divide the second.
    assert np.sum(np.array(laid) < 250.0) == 1
    strips = np.diff(sorted(driven + laid))
    assert strips.max() <= 1.4 * strips.min()
    # The outermost lies 0.35 spacings from the border.
    assert 600.0 - max(laid) == pytest.approx(0.35 * strips[-1])


def test_a_gap_barely_wider_than_the_others_is_left_for_new_ground():
    driven = [20.0, 80.0, 140.0, 200.0]
    # Rough terrain: lines at 57 m in the ground that is new, none between those driven 60 m apart.
    assert min(offset for offset, _ in gaps_filled(driven, 600.0, 7, 3.0)) > 200.0
