"""Lines across the swaths."""

import numpy as np
import pytest

from planners import LawnmowerConfig
from planners.patterns.lawnmower import tie_lines
from survey import SurveyArea

SITE = SurveyArea.rectangle((0.0, 0.0, 600.0, 400.0), "EPSG:32608")


def test_without_tie_lines_there_are_none() -> None:
    assert tie_lines(SITE, LawnmowerConfig(swaths=4), 90.0, np.zeros(2)) == []


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 30.0])
def test_lines_are_square_to_the_swaths_and_inside(heading_deg: float) -> None:
    lines = tie_lines(SITE, LawnmowerConfig(swaths=4, tie_lines=2), heading_deg, np.zeros(2))
    assert len(lines) == 2
    along = np.array([np.cos(np.radians(heading_deg)), np.sin(np.radians(heading_deg))])
    for line in lines:
        direction = line.axis[-1] - line.axis[0]
        assert abs(direction @ along) < 1e-6 * np.linalg.norm(direction)
        assert (line.axis >= -1e-6).all()
        assert (line.axis <= np.array([600.0, 400.0]) + 1e-6).all()


def test_the_first_line_begins_at_the_corner_nearest_to_the_last_swath() -> None:
    for end in ([0.0, 0.0], [600.0, 400.0], [600.0, 0.0]):
        first = tie_lines(SITE, LawnmowerConfig(swaths=4, tie_lines=3), 90.0, np.array(end))[0]
        corners = np.vstack(
            [
                line.axis[[0, -1]]
                for line in tie_lines(SITE, LawnmowerConfig(swaths=4, tie_lines=3), 90.0, np.array(end))
            ]
        )
        assert np.linalg.norm(first.axis[0] - end) == pytest.approx(
            np.linalg.norm(corners - end, axis=1).min()
        )
