"""Relief between the waves of a map is noise that neighbours share."""

import numpy as np

from survey.reconstruction.gp.engines.fourier_basis import FourierBasis, FourierBox
from survey.reconstruction.gp.kernels import SquaredExponential
from survey.reconstruction.joint.shared_errors import with_shared_relief


def test_a_dense_swath_knows_its_level_as_well_as_the_shared_relief_lets_it() -> None:
    """The mean of 2,000 points on a strip errs by what the whole covariance says, and ten times more than apart."""
    rng = np.random.default_rng(3)
    xy = np.column_stack([rng.uniform(0.0, 200.0, 2000), rng.uniform(45.0, 55.0, 2000)])
    own = rng.uniform(0.03, 0.2, 2000) ** 2
    relief = SquaredExponential(0.01, 3.0)
    box = FourierBox.around((0.0, 0.0, 200.0, 100.0), 30.0)
    constant_alone = FourierBasis.of(box, np.zeros((1, 2), dtype=np.int64))
    noise = with_shared_relief(xy, own, relief, constant_alone, relief.variance_m2)
    weight = (1.0 / own) / (1.0 / own).sum()
    exact = weight @ (np.diag(own) + relief.covariance(xy, xy)) @ weight
    variance_m2 = weight**2 @ noise
    # Places are rounded to a fifth of the relief's length, and the kept constant takes a tenth of the strip's mean.
    assert 0.8 < variance_m2 / exact < 1.2
    assert variance_m2 > 10.0 * (weight**2 @ (own + relief.variance_m2))


def test_points_far_apart_share_nothing_and_order_does_not_matter() -> None:
    rng = np.random.default_rng(4)
    xy = 30.0 * np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0)), axis=-1).reshape(-1, 2)
    own = rng.uniform(0.1, 0.2, 25) ** 2
    relief = SquaredExponential(0.01, 2.0)
    box = FourierBox.around((0.0, 0.0, 120.0, 120.0), 30.0)
    constant_alone = FourierBasis.of(box, np.zeros((1, 2), dtype=np.int64))
    noise = with_shared_relief(xy, own, relief, constant_alone, relief.variance_m2)
    # The constant that the basis keeps is a thousandth of the relief's variance.
    np.testing.assert_allclose(noise, own + relief.variance_m2, rtol=1e-2)
    order = rng.permutation(25)
    turned = with_shared_relief(xy[order], own[order], relief, constant_alone, relief.variance_m2)
    np.testing.assert_allclose(turned, noise[order], rtol=1e-9)


def test_relief_of_waves_that_are_retained_is_no_noise() -> None:
    """With all waves that the relief has, what is left is each point's own."""
    rng = np.random.default_rng(5)
    xy = rng.uniform(0.0, 100.0, (400, 2))
    own = np.full(400, 0.01)
    relief = SquaredExponential(1.0, 30.0)
    box = FourierBox.around((0.0, 0.0, 100.0, 100.0), 150.0)
    p, q = np.meshgrid(np.arange(13), np.arange(-12, 13), indexing="ij")
    lattice = np.stack([p.ravel(), q.ravel()], axis=-1)
    half_plane = FourierBasis.of(box, lattice[(lattice[:, 0] > 0) | (lattice[:, 1] >= 0)])
    tail = 1e-6
    noise = with_shared_relief(xy, own, relief, half_plane, tail)
    # Where waves are short beside the gaps between points, no more than a few points share one.
    np.testing.assert_allclose(noise, own, atol=20.0 * tail)
