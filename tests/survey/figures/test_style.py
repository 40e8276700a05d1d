"""Style of figures: settings of the user, bytes of pictures, limits of colours."""

from io import BytesIO

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager
from PIL import Image

from survey.figures.maps import SUPPORT
from survey.figures.style import (
    DENSITY,
    DEVIATION,
    DPI,
    ELEVATION,
    ERROR,
    ROVERS,
    SHARP_DPI,
    _settings,
    page_image,
    png_bytes,
    styled,
    symmetric_limits,
    unlisted_fonts,
)


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


def test_fonts_that_the_stored_list_lacks_are_added(monkeypatch, caplog):
    listed = [font for font in fontManager.ttflist if font.name not in ("STIXGeneral", "cmr10")]
    monkeypatch.setattr(fontManager, "ttflist", listed)
    assert {"STIXGeneral", "cmr10"} <= {file.stem for file in unlisted_fonts()}
    _settings.cache_clear()
    figure = drawn()
    figure.axes[0].set_title(r"$\alpha^2$")
    png_bytes(figure)
    assert not unlisted_fonts()
    assert "not found" not in caplog.text


# Colours as people without red or green cones see them, in linear RGB (Machado, Oliveira, Fernandes 2009).
WITHOUT_RED = [
    [0.152286, 1.052583, -0.204868],
    [0.114503, 0.786281, 0.099216],
    [-0.003882, -0.048116, 1.051998],
]
WITHOUT_GREEN = [
    [0.367322, 0.860646, -0.227968],
    [0.280085, 0.672501, 0.047413],
    [-0.011820, 0.042940, 0.968881],
]
LEAST_STEP = 0.1


def linear(colours):
    """Return sRGB (N, 3) as linear RGB."""
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def grey(colours):
    """Return the lightness (N,) of sRGB colours (N, 3+), 0 to 1."""
    return np.cbrt(linear(np.asarray(colours)[:, :3]) @ [0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("colours", [ELEVATION, DEVIATION, DENSITY])
def test_colours_of_amounts_are_ordered_in_grey(colours):
    steps = np.diff(grey(colours(np.linspace(0.0, 1.0, 16))))
    assert (np.sign(steps) == np.sign(steps[0])).all()


def test_categories_of_support_differ_in_grey():
    assert np.diff(grey([to_rgb(colour) for _, colour in SUPPORT.values()])).max() < -LEAST_STEP


@pytest.mark.parametrize("cones", [np.eye(3), WITHOUT_RED, WITHOUT_GREEN])
def test_rovers_and_ends_of_the_error_differ_for_the_colour_blind(cones):
    for colours in ([to_rgb(colour) for colour in ROVERS], ERROR([0.1, 0.5, 0.9])[:, :3]):
        seen = np.cbrt((linear(np.asarray(colours)) @ np.transpose(cones)).clip(0.0, 1.0))
        apart = np.linalg.norm(seen[:, None] - seen[None], axis=2)
        assert apart[~np.eye(len(seen), dtype=bool)].min() > LEAST_STEP


@pytest.mark.parametrize("values", [[-0.5, 0.1], [0.2, 0.5], [0.0, 0.0], [np.nan, -0.1]])
def test_colour_limits_are_symmetric_about_zero_and_above_it(values):
    limits = symmetric_limits(np.array(values))
    assert limits.vmin == -limits.vmax
    assert limits.vmax > 0.0
