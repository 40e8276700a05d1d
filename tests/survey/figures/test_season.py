"""Figure of a season's design."""

import pytest

from survey.figures.plans import season_plot

ERRORS = {0: [(2, 0.9), (4, 0.5)], 2: [(2, 0.6), (4, 0.3)]}
PARTS = {"between swaths": 0.08, "density": 0.12}


@pytest.fixture
def axes():
    return season_plot(ERRORS, 0.3, (4, 0.29), PARTS, "m w.e.").axes


def test_each_number_of_stakes_has_a_line_with_its_errors(axes):
    lines = {line.get_label(): line.get_xydata().tolist() for line in axes[0].lines}
    assert lines["0 stakes"] == [[2, 0.9], [4, 0.5]]
    assert lines["2 stakes"] == [[2, 0.6], [4, 0.3]]
    assert lines["chosen"] == [[4, 0.29]]


def test_the_wanted_error_is_a_level_line_in_its_unit(axes):
    (wanted,) = (line for line in axes[0].lines if line.get_label() == "wanted")
    assert set(wanted.get_ydata()) == {0.3}
    assert "m w.e." in axes[0].get_ylabel()
    assert axes[0].get_ylim()[0] == 0.0


def test_the_parts_are_bars_in_their_order_from_the_top(axes):
    assert [bar.get_width() for bar in axes[1].patches] == list(PARTS.values())
    bottom, top = axes[1].get_ylim()
    assert bottom > top
