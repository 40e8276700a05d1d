"""Waves that are chosen within a memory, on boxes of any margin."""

import numpy as np
import pytest

from survey.reconstruction.gp.engines.fourier_basis import (
    FourierBasis,
    FourierBox,
    affordable_basis,
    line_variances,
    periodic_variance,
    variance_left_out,
)
from survey.reconstruction.gp.kernels import Kernel, Matern32, SquaredExponential

SITE = (0.0, 0.0, 300.0, 300.0)
PRECISE = {"sharpest_m": 0.02, "tolerance_m": 0.002}


@pytest.mark.parametrize("kernel", [SquaredExponential(4.0, 90.0), SquaredExponential(4.0, 300.0, 2.0, 30.0)])
def test_all_waves_of_a_narrow_box_hold_the_covariances_with_all_images(kernel: Kernel) -> None:
    box = FourierBox.around(SITE, 50.0)
    p, q = np.meshgrid(np.arange(-40, 41), np.arange(-40, 41))
    every = FourierBasis.of(box, np.column_stack([p.ravel(), q.ravel()]))
    assert periodic_variance(kernel, box) == pytest.approx(line_variances(kernel, every).sum(), rel=1e-8)


def test_landforms_longer_than_the_site_leave_waves_for_relief_between_swaths() -> None:
    landforms = Matern32(1000.0, 450.0)
    basis = affordable_basis(landforms, SITE, **PRECISE, n_modes=2500)
    assert variance_left_out(landforms, basis) < 0.1**2
    assert (basis.box.period_m / basis.half).max() < 25.0


def test_a_box_whose_waves_meet_the_tolerance_keeps_its_margin() -> None:
    hills = SquaredExponential(4.0, 120.0)
    basis = affordable_basis(hills, SITE, **PRECISE, n_modes=2500)
    assert (basis.box.period_m > 1.75 * 300.0).all()
    assert variance_left_out(hills, basis) <= 0.08 * 0.002 * 0.02
