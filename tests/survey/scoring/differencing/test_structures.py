"""Selection of a variogram's structures, from exact and from drawn variograms."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from survey.scoring.differencing.variogram import SHAPES, Structure, SumErrors, Variogram, fit_variogram

LAGS = np.geomspace(5.0, 500.0, 30)


@pytest.mark.parametrize("family", SHAPES)
def test_structures_start_at_nothing_and_reach_their_sill_at_the_range(family):
    one = Structure(family, 40.0, 2.0)
    assert one.at(np.zeros(1))[0] == 0.0
    assert 0.949 <= one.at(np.array([40.0]))[0] / 2.0 <= 1.0
    assert one.correlation(np.array([400.0]))[0] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("family", SHAPES)
def test_an_exact_variogram_of_any_family_is_explained_to_three_percent(family):
    gamma = 0.1 + Structure(family, 66.0, 0.9).at(LAGS)
    found = Variogram(*fit_variogram(LAGS, gamma, 1.0 / gamma, 10.0))
    assert found.at(LAGS) == pytest.approx(gamma, rel=0.03)
    assert found.variance_m2 == pytest.approx(1.0, rel=0.01)


def test_white_errors_have_no_structure_beyond_the_nugget():
    rng = np.random.default_rng(4)
    everywhere = np.ones((100, 100), dtype=bool)
    counts = [
        len(Variogram.of(rng.standard_normal((100, 100)), everywhere, 5.0).structures) for _ in range(8)
    ]
    assert sum(n == 0 for n in counts) >= 5


@pytest.mark.parametrize("pixels", [1.0, 4.0, 8.0])
def test_the_error_of_a_mean_of_smooth_errors_is_right_within_a_quarter(pixels):
    rng, n = np.random.default_rng(5), 160
    inside = np.hypot(*(np.mgrid[:n, :n] - 80.0)) < 26.0
    weights = np.where(inside, 1.0 / inside.sum(), -1.0 / (~inside).sum())
    claimed, found = [], []
    for _ in range(24):
        error = gaussian_filter(rng.standard_normal((n, n)), pixels, mode="wrap")
        claimed.append(SumErrors(Variogram.of(error, ~inside, 5.0), ~inside, 5.0).of(weights).std)
        found.append([float((weights * np.roll(error, shift, (0, 1))).sum()) for shift in ((0, 0), (80, 80))])
    assert np.median(claimed) / np.sqrt(np.mean(np.square(found))) == pytest.approx(1.0, abs=0.25)
