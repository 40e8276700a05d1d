import numpy as np
import pytest
import shapely

from planners import LawnmowerConfig, WavyConfig, plan
from planners.planning import prior_covered_share
from survey import Dem, Grid, InputError, SurveyArea

CRS = "EPSG:32608"
SITE = SurveyArea.rectangle((0.0, 0.0, 600.0, 600.0), CRS)


def prior(xmax: float, xmin: float = 0.0) -> Dem:
    grid = Grid((xmin + 10.0, 10.0, xmax - 10.0, 590.0), 20.0, CRS)
    return Dem.on(grid, np.add.outer(np.sin(grid.y / 50.0), np.cos(grid.x / 70.0)))


def test_a_prior_over_a_third_of_the_area_is_said(caplog):
    route = plan(SITE, prior(200.0), LawnmowerConfig(swaths=4))
    assert route.prediction["prior_covered_share"] == pytest.approx(1.0 / 3.0, abs=0.02)
    assert "the prior covers 32" in caplog.text or "the prior covers 33" in caplog.text
    assert "counts as unknown" in caplog.text


@pytest.mark.parametrize("config", [LawnmowerConfig(swaths=4), WavyConfig(swaths=4)])
def test_a_prior_elsewhere_is_refused(config):
    with pytest.raises(InputError, match="no height on the area"):
        plan(SITE, prior(1600.0, 1000.0), config)


def test_a_prior_whose_cells_on_the_area_are_nodata_is_refused():
    wide = prior(1000.0)
    heights = np.where(wide.x < 700.0, np.nan, wide.elevation)
    with pytest.raises(InputError, match="no height on the area"):
        plan(SITE, Dem(heights, wide.transform, CRS), LawnmowerConfig(swaths=4))


def test_a_prior_over_all_of_the_area_is_no_news(caplog):
    assert plan(SITE, prior(600.0), LawnmowerConfig(swaths=4)).prediction["prior_covered_share"] == 1.0
    assert not caplog.records


def test_the_predicted_error_does_not_fall_by_heights_of_the_prior():
    whole, third = (plan(SITE, prior(x), LawnmowerConfig(swaths=3)) for x in (600.0, 200.0))
    assert "rmse_m" not in whole.prediction
    kernel_free = {k: v for k, v in third.prediction.items() if k in ("length_m", "n_turns")}
    assert kernel_free.items() <= dict(whole.prediction).items()


def test_a_few_cells_between_the_places_are_found():
    grid = Grid((301.0, 301.0, 303.0, 303.0), 1.0, CRS)
    assert 0.0 < prior_covered_share(SITE, Dem.on(grid, np.zeros(grid.shape))) < 1e-3


def test_a_strip_narrower_than_all_cells_has_a_share_too():
    strip = SurveyArea(shapely.Polygon([(0, 0), (600, 600), (600, 600.5), (0, 0.5)]), CRS)
    assert prior_covered_share(strip, prior(600.0)) == 1.0
