"""Sizes of a prior's errors, on cells drawn from known ones."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from survey.reconstruction.prior import PRODUCTS, ErrorScale, SatelliteErrors
from survey.reconstruction.prior_likelihood import Innovations, correlation, likeliest_sizes


def cells(white_m: float, correlated_m: float, seed: int, n: int = 12) -> Innovations:
    """Cells of 60 m whose terrain is known to 0.1 m."""
    rng = np.random.default_rng(seed)
    centre = 60.0 * np.stack(np.meshgrid(np.arange(n), np.arange(n)), axis=-1).reshape(-1, 2)
    covariance = white_m**2 * np.eye(n * n) + correlated_m**2 * correlation(centre, 250.0)
    drawn = np.linalg.cholesky(covariance) @ rng.standard_normal(n * n)
    return Innovations(centre, drawn + 0.1 * rng.standard_normal(n * n), 0.01 * np.eye(n * n))


def test_white_and_correlated_errors_are_separated():
    unknown = SatelliteErrors().model()
    white = [likeliest_sizes(cells(1.0, 0.0, seed), unknown) for seed in range(3)]
    both = [likeliest_sizes(cells(1.0, 3.0, seed), unknown) for seed in range(3)]
    for found in (*white, *both):
        # Neighbours 60 m apart differ by 2.0 m of the correlated error, beside 1.4 m of the white one.
        assert 0.5 < found.white_m < 1.5
    assert max(found.correlated_m for found in white) < 1.0
    assert min(found.correlated_m for found in both) > 1.5


def test_a_stated_size_that_is_wrong_by_three_is_corrected():
    for stated_m in (1.0 / 3.0, 3.0):
        found = likeliest_sizes(cells(1.0, 0.0, 5), SatelliteErrors(sigma_m=stated_m).model())
        assert 0.7 < found.white_m < 1.4


def test_stated_sizes_of_an_unbiased_product_are_exact():
    errors = SatelliteErrors(product="unbiased", sigma_m=0.5).model()
    found = likeliest_sizes(cells(1.0, 0.0, 5), errors)
    assert (found.white_m, found.correlated_m, found.white_log_sd) == (0.5, 0.0, 0.0)


def test_the_evidence_of_exact_sizes_is_the_gaussian_density():
    innovations = cells(1.0, 0.0, 2, n=4)
    errors = SatelliteErrors(product="unbiased", sigma_m=1.0).model()
    density = multivariate_normal(cov=innovations.covariance + np.eye(16)).logpdf(innovations.value_m)
    assert likeliest_sizes(innovations, errors).log_evidence == pytest.approx(density, rel=1e-9)


def test_every_class_has_errors_of_every_kind():
    for name, errors in PRODUCTS.items():
        sizes = (errors.datum_sigma_m, errors.epoch_sigma_m, errors.tilt_sigma_m_per_km, errors.shift_sigma_m)
        assert (min(sizes) > 0.0) == (name != "unbiased")
        assert errors.source


def test_an_error_stated_as_none_is_absent():
    assert SatelliteErrors(correlated_sigma_m=0.0).model().correlated == ErrorScale(0.0, 0.0)
