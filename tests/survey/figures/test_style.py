"""Style of figures: settings of the user, bytes of pictures, limits of colours."""

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure

from survey.figures.style import DPI, png_bytes, styled, symmetric_limits


@styled
def drawn() -> Figure:
    figure = Figure(figsize=(2.0, 1.0))
    figure.subplots().plot([0.0, 1.0], [0.0, 2.0])
    return figure


def test_settings_of_the_user_change_no_figure_and_are_not_changed():
    plain = png_bytes(drawn())
    with mpl.rc_context({"font.size": 30.0, "lines.linewidth": 9.0, "axes.facecolor": "red"}):
        assert png_bytes(drawn()) == plain
        assert mpl.rcParams["font.size"] == 30.0


def test_a_picture_has_the_size_of_its_figure_and_no_date():
    content = png_bytes(drawn())
    width, height = (int.from_bytes(content[k : k + 4]) for k in (16, 20))
    assert (width, height) == (2 * DPI, DPI)
    assert b"Software" not in content
    assert b"Creation" not in content


@pytest.mark.parametrize("values", [[-0.5, 0.1], [0.2, 0.5], [0.0, 0.0], [np.nan, -0.1]])
def test_colour_limits_are_symmetric_about_zero_and_above_it(values):
    limits = symmetric_limits(np.array(values))
    assert limits.vmin == -limits.vmax
    assert limits.vmax > 0.0
