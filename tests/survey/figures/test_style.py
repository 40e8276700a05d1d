"""Style of figures: settings of the user, bytes of pictures, limits of colours."""

from io import BytesIO

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from survey.figures.style import DPI, SHARP_DPI, page_image, png_bytes, styled, symmetric_limits


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


def panels() -> Figure:
    figure = Figure(figsize=(2.0, 1.0), layout="constrained")
    for axes in figure.subplots(1, 2):
        axes.imshow([[0.0, 1.0], [2.0, 3.0]])
        axes.set_title("Panel")
    return figure


@pytest.mark.parametrize("draw", [drawn, styled(panels)])
def test_the_image_of_a_page_has_the_pixels_of_the_saved_figure(draw):
    figure = draw()
    canvas, dpi = figure.canvas, figure.dpi
    image = page_image(figure)
    assert (figure.canvas, figure.dpi) == (canvas, dpi)
    with Image.open(BytesIO(png_bytes(draw(), SHARP_DPI))) as saved:
        assert np.array_equal(image, saved.convert("RGB"))


@pytest.mark.parametrize("values", [[-0.5, 0.1], [0.2, 0.5], [0.0, 0.0], [np.nan, -0.1]])
def test_colour_limits_are_symmetric_about_zero_and_above_it(values):
    limits = symmetric_limits(np.array(values))
    assert limits.vmin == -limits.vmax
    assert limits.vmax > 0.0
