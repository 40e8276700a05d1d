"""The scale bar of a map counts on the ground."""

import numpy as np
import pytest
from matplotlib.patches import Rectangle

from survey import Dem, Grid
from survey.core.map_scale import scale_factors
from survey.figures.maps import survey_map


def _bar_m(crs: str, origin: tuple[float, float]) -> tuple[float, str]:
    """Return the length of the scale bar in the CRS, and its label."""
    grid = Grid.over((*origin, origin[0] + 2000.0, origin[1] + 1500.0), 100.0, crs)
    axes = survey_map(Dem.on(grid, np.add.outer(grid.y - origin[1], grid.x - origin[0]))).axes[0]
    halves = [p for p in axes.patches if isinstance(p, Rectangle) and not p.get_clip_on()]
    label = next(t.get_text() for t in axes.texts if t.get_text().endswith(" m"))
    return sum(half.get_width() for half in halves), label


def test_a_bar_in_a_utm_zone_has_the_length_of_its_label() -> None:
    assert _bar_m("EPSG:32608", (500_000.0, 6_700_000.0)) == (500.0, "500 m")


def test_a_bar_in_web_mercator_is_longer_on_the_map_than_on_the_ground() -> None:
    length, label = _bar_m("EPSG:3857", (0.0, 8_500_000.0))
    factor = float(scale_factors("EPSG:3857", [[0.0, 8_500_000.0]]).linear[0])
    assert length == pytest.approx(float(label.removesuffix(" m")) * factor, rel=0.001)
