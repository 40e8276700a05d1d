"""No axis repeats a label."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from survey import Dem, Grid, SurveyArea, figures
from survey.figures.errors import residual_histogram, residual_quantiles
from survey.figures.maps import change_map
from survey.reconstruction.terrain_map import Reconstruction
from survey.scoring import Change, ErrorStatistics


def repeated(figure: Figure) -> list[tuple[str, list[str]]]:
    """Return the axes whose visible labels occur twice."""
    figure.canvas.draw()
    found = []
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            ticks = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
            texts = [t.label1.get_text() for t in ticks if t.label1.get_text() and t.label1.get_visible()]
            if len(set(texts)) < len(texts):
                found.append((axis.get_label_text(), texts))
    return found


@pytest.mark.parametrize(
    ("side_m", "error_m"),
    [
        (0.3, 1e-4), (60.0, 3.0), (50_000.0, 1e-4), *(
            pytest.param(*sizes, marks=pytest.mark.exhaustive)
            for sizes in ((3.0, 0.02), (15.0, 3.0), (60.0, 1e-4), (600.0, 0.02), (50_000.0, 3.0))
        )
    ],
)  # fmt: skip
def test_maps_and_histograms_of_any_size_have_different_labels(side_m: float, error_m: float) -> None:
    east, north = 500_000.0, 6_700_000.0
    grid = Grid((east, north, east + side_m, north + 0.6 * side_m), side_m / 40.0, "EPSG:32608")
    rng = np.random.default_rng(3)
    truth = Dem.on(grid, 800.0 + 0.1 * side_m * rng.random(grid.shape))
    noise = rng.normal(0.0, error_m, grid.shape)
    mean = Dem.on(grid, truth.elevation + noise)
    map_ = Reconstruction(mean, Dem.on(grid, np.full(grid.shape, error_m)), np.full(grid.shape, 3), "gp", {})
    statistics = ErrorStatistics.of(noise)
    area = SurveyArea.rectangle(grid.bounds, "EPSG:32608")
    change = Change(Dem.on(grid, noise), np.full(grid.shape, error_m), np.zeros(grid.shape), (), "variogram")
    drawn = [
        figures.survey_map(mean, area=area),
        figures.terrain_comparison(truth, map_, area=area),
        figures.deviation_map(map_, area=area),
        figures.support_map(map_, area=area),
        figures.error_map(map_, truth, area=area),
        figures.error_histogram(map_, truth, statistics, area=area),
        residual_histogram(noise.ravel(), statistics),
        residual_quantiles(noise.ravel(), statistics),
        change_map(change, {}),
    ]
    assert [repeated(figure) for figure in drawn] == [[]] * len(drawn)
