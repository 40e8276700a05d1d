"""The error model of the statistical fidelity, fitted to errors that were drawn from it."""

import numpy as np
import pytest

from sim.error_model import DriveErrors, errors_of, fitted
from sim.gauss_markov import gauss_markov
from survey.errors import InputError
from survey.store import RunFolder


def drive(rng: np.random.Generator, length_m: float = 6000.0) -> DriveErrors:
    n = int(length_m / 5.0)
    attitude = gauss_markov(np.full(n, 5.0), 60.0, 1.0, rng, 3) * [0.1, 0.1, 0.3]
    ranges = rng.uniform(5.0, 25.0, 20_000)
    return DriveErrors(
        attitude_deg=attitude,
        scale=0.02 + 0.01 * rng.standard_normal(n),
        aside=0.008 * rng.standard_normal((n, 2)),
        range_m=ranges,
        height_m=(0.03 + 0.002 * ranges) * rng.standard_normal(len(ranges)),
        along_m=0.05 + 0.001 * ranges**2,
        length_m=length_m,
    )


def test_what_was_drawn_is_found(rng):
    found = fitted([drive(rng), drive(rng)])
    # 200 independent stretches of attitude tell a deviation to 5 %; the others have thousands of draws.
    assert found.yaw_sigma_deg == pytest.approx(0.3, rel=0.15)
    assert found.tilt_sigma_deg == pytest.approx(0.1, rel=0.15)
    assert found.scale_sigma == pytest.approx(0.02, rel=0.05)
    assert found.step_sigma_m == pytest.approx(0.008, rel=0.05)
    assert found.landmarks_per_m == pytest.approx(20_000 / 6000.0, rel=0.01)
    assert found.landmark_range_m == pytest.approx((5.2, 24.8), abs=0.1)
    assert found.landmark_cross_sigma_m == pytest.approx((0.03, 0.002), rel=0.1)
    assert found.landmark_along_sigma_m == pytest.approx((0.05, 0.001), rel=0.1)


def test_short_drives_and_runs_without_images_are_refused(rng, tmp_path):
    with pytest.raises(InputError, match="more than 120 m"):
        fitted([drive(rng, 100.0)])
    with pytest.raises(InputError, match="holds no drive in images"):
        errors_of(RunFolder.open(tmp_path, "empty", "seed = 1", {}, {}))
