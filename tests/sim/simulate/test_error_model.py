"""The error model of the statistical fidelity, fitted to errors that were drawn from it."""

import numpy as np
import pytest

from sim.instruments.sensor import gauss_markov
from sim.simulate.error_model import DriveErrors, OdometryErrors, errors_of, fitted
from survey.core.errors import InputError
from survey.core.run_folder import RunFolder

WALK_DEG = 0.04


def drive(rng: np.random.Generator, length_m: float = 6000.0, walk_deg: float = 0.0) -> DriveErrors:
    n = int(length_m / 5.0)
    attitude = gauss_markov(np.full(n + 1, 5.0), 60.0, 1.0, rng, 3)[: n + 1] * [0.1, 0.1, 0.3]
    attitude[:, 2] += np.cumsum(walk_deg * np.sqrt(5.0) * rng.standard_normal(n + 1))
    ranges = rng.uniform(5.0, 25.0, 20_000)
    odometry = OdometryErrors(
        attitude_deg=attitude + [0.2, -0.2, 0.0],
        mark_s=5.0 * np.arange(n + 1),
        length_m=np.full(n, 5.0),
        turned_rad=np.zeros(n),
        scale=0.02 + 0.01 * rng.standard_normal(n),
        aside=0.008 * rng.standard_normal((n, 2)),
    )
    return DriveErrors(
        odometry,
        range_m=ranges,
        height_m=(0.03 + 0.002 * ranges) * rng.standard_normal(len(ranges)),
        along_m=0.05 + 0.001 * ranges**2,
    )


def test_what_was_drawn_is_found(rng):
    found = fitted([drive(rng), drive(rng)])
    # 200 independent stretches of attitude give a deviation to 5 %; the others have thousands of draws.
    assert found.yaw_sigma_deg == pytest.approx(0.3, rel=0.15)
    assert found.tilt_sigma_deg == pytest.approx(0.1, rel=0.15)
    assert found.tilt_bias_sigma_deg == pytest.approx(0.2, rel=0.1)
    assert found.heading_walk_deg_sqrt_m < 0.01
    assert found.scale_sigma == pytest.approx(0.02, rel=0.05)
    assert found.step_sigma_m == pytest.approx(0.008, rel=0.05)
    assert found.landmarks_per_m == pytest.approx(20_000 / 6000.0, rel=0.01)
    assert found.landmark_range_m == pytest.approx((5.2, 24.8), abs=0.1)
    assert found.landmark_cross_sigma_m == pytest.approx((0.03, 0.002), rel=0.1)
    assert found.landmark_along_sigma_m == pytest.approx((0.05, 0.001), rel=0.1)


def test_a_heading_that_walks_is_found_where_drives_are_long(rng):
    found = fitted([drive(rng, walk_deg=WALK_DEG) for _ in range(4)])
    # 80 stretches of 300 m give their mean square to 16 %, the walk to half of that and what noise of 0.3 deg adds.
    assert found.heading_walk_deg_sqrt_m == pytest.approx(WALK_DEG, rel=0.3)
    assert found.yaw_sigma_deg == pytest.approx(0.3, rel=0.2)
    assert fitted([drive(rng, 500.0, WALK_DEG)]).heading_walk_deg_sqrt_m == 0.0


def test_short_drives_and_runs_without_images_are_refused(rng, tmp_path):
    with pytest.raises(InputError, match="more than 120 m"):
        fitted([drive(rng, 100.0)])
    with pytest.raises(InputError, match="holds no drive in images"):
        errors_of(RunFolder.open(tmp_path, "empty", "seed = 1", {}, {}))
