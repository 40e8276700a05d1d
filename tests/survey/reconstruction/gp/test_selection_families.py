"""The likelihood finds what the points were drawn from."""

import numpy as np
import pytest

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.reconstruction.gp.config import GaussianProcessConfig
from survey.reconstruction.gp.kernels import Kernel, Matern32, SquaredExponential
from survey.reconstruction.gp.marginal_likelihood import likeliest

N = 400
SIGMA = 0.05


def _drawn(kernel: Kernel, seed: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0.0, 200.0, (N, 2))
    root = np.linalg.cholesky(kernel.covariance(xy, xy) + 1e-9 * np.eye(N))
    return xy, root @ rng.standard_normal(N) + SIGMA * rng.standard_normal(N), np.full(N, SIGMA**2)


@pytest.mark.parametrize(
    ("kernel", "family"),
    [(SquaredExponential(4.0, 25.0), "squared-exponential"), (Matern32(4.0, 25.0), "matern-3/2")],
)
def test_family_and_length_scale_are_found(kernel: Kernel, family: str) -> None:
    found = likeliest(*_drawn(kernel, 1), GaussianProcessConfig())
    assert found.family == family
    # 64 patches of a length scale determine it to about a sixth.
    assert found.kernel.length_scales_m[0] == pytest.approx(25.0, rel=0.5)


def test_relief_without_extent_is_the_nugget() -> None:
    xy, z, noise = _drawn(SquaredExponential(4.0, 40.0), 2)
    rough = z + 0.3 * np.random.default_rng(3).standard_normal(N)
    found = likeliest(xy, rough, noise, GaussianProcessConfig(family="squared-exponential"))
    # 400 points give a standard deviation to 4 %, and it is 3 standard errors.
    assert found.nugget_m == pytest.approx(0.3, rel=0.12)


def test_a_given_nugget_is_used() -> None:
    found = likeliest(
        *_drawn(Matern32(4.0, 25.0), 4), GaussianProcessConfig(family="matern-3/2", nugget_m=0.2)
    )
    assert found.nugget_m == 0.2


def test_equal_points_give_equal_hyperparameters() -> None:
    data = _drawn(Matern32(4.0, 25.0), 5)
    config = GaussianProcessConfig(family="matern-3/2")
    one, two = likeliest(*data, config), likeliest(*data, config)
    np.testing.assert_array_equal(one.kernel.log_parameters, two.kernel.log_parameters)


def test_two_points_are_refused() -> None:
    with pytest.raises(InputError, match="2 points"):
        likeliest(np.zeros((2, 2)), np.zeros(2), np.ones(2), GaussianProcessConfig())
