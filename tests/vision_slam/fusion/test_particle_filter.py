"""The particle filter: equal to Kalman's where that is exact, and finding itself again where it is not."""

import numpy as np
import pytest

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.particle_filter import ParticleFilter

STEP_S = 1.0


def _drive(
    config: LocalizationConfig, rng: np.random.Generator, n: int, turn_at: int = 10**9
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Places, steps of the odometry and fixes with a Gauss-Markov bias, one a second at 1 m/s."""
    heading = np.where(np.arange(n) < turn_at, 0.3, 0.3 + np.pi / 2)
    steps = np.column_stack([np.cos(heading), np.sin(heading), np.zeros(n)])
    place = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    level = np.array([1.0, 1.0, config.gps_vertical_factor])
    memory = np.exp(-STEP_S / config.gps_correlation_time_s)
    bias = config.gps_bias_sigma_m * level * rng.standard_normal(3)
    fixes = []
    for at in place[1:]:
        bias = memory * bias + config.gps_bias_sigma_m * level * np.sqrt(1 - memory**2) * rng.standard_normal(
            3
        )
        fixes.append(at + bias + config.gps_white_sigma_m * level * rng.standard_normal(3))
    noisy = steps + config.step_sigma_m * rng.standard_normal((n, 3))
    return place, noisy, np.array(fixes)


def _kalman(
    config: LocalizationConfig, steps: FloatArray, fixes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Exact posterior of place and bias, axis by axis, when heading and scale are known."""
    level = np.array([1.0, 1.0, config.gps_vertical_factor])
    memory = np.exp(-STEP_S / config.gps_correlation_time_s)
    mean, variance = np.zeros(3), np.zeros(3)
    for axis in range(3):
        bias = (config.gps_bias_sigma_m * level[axis]) ** 2
        x, p = np.zeros(2), np.diag([config.start_sigma_m**2, bias])
        move, seen = np.diag([1.0, memory]), np.ones(2)
        lengths = np.linalg.norm(steps, axis=1)
        for step, length, fix in zip(steps[:, axis], lengths, fixes[:, axis], strict=True):
            x = move @ x + [step, 0.0]
            noise = np.diag([config.step_sigma_m**2 * length, (1 - memory**2) * bias])
            p = move @ p @ move + noise
            gain = p @ seen / (seen @ p @ seen + (config.gps_white_sigma_m * level[axis]) ** 2)
            x, p = x + gain * (fix - seen @ x), p - np.outer(gain, seen @ p)
        mean[axis], variance[axis] = x[0], p[0, 0]
    return mean, variance


def test_equals_the_kalman_filter_where_all_is_linear() -> None:
    exact_heading = LocalizationConfig(
        yaw_sigma_deg=1e-6,
        tilt_sigma_deg=1e-6,
        tilt_bias_sigma_deg=0.0,
        scale_sigma=1e-9,
        step_sigma_m=0.2,
        start_sigma_m=0.5,
        gps_correlation_time_s=30.0,
    )
    _, steps, fixes = _drive(exact_heading, np.random.default_rng(3), 40)
    filtered = ParticleFilter(exact_heading, np.random.default_rng(1), start=np.zeros(3))
    for step, fix in zip(steps, fixes, strict=True):
        filtered.move(step, STEP_S)
        assert filtered.correct(fix)
    mean, variance = _kalman(exact_heading, steps, fixes)
    now = filtered.estimate()
    # Beside rounding, what a heading of a millionth of a degree and a scale of 1e-9 move in 40 m.
    np.testing.assert_allclose(now.position, mean, atol=1e-6)
    np.testing.assert_allclose(np.diag(now.covariance), variance, rtol=1e-6)


def _recovered_share(n_runs: int, *, kidnapped: bool) -> float:
    """Share of runs that, 60 s later, are within 3 m and do not say lost."""
    config = LocalizationConfig()
    good = 0
    for run in range(n_runs):
        rng = np.random.default_rng(1000 + run)
        place, steps, fixes = _drive(config, rng, 120, turn_at=90)
        if kidnapped:  # set down 30 m aside and turned by 90°, after half of the drive
            turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
            place[61:] = (place[61:] - place[60]) @ turn.T + place[60] + [30.0, 0.0, 0.0]
            fixes[60:] = (fixes[60:] - place[60]) @ turn.T + place[60] + [30.0, 0.0, 0.0]
        filtered = ParticleFilter(config, rng, n_particles=1000, start=place[0] if kidnapped else None)
        n = 120 if kidnapped else 60
        for step, fix in zip(steps[:n], fixes[:n], strict=True):
            filtered.move(step, STEP_S)
            filtered.correct(fix)
        now = filtered.estimate()
        good += bool(np.linalg.norm((now.position - place[n])[:2]) < 3.0 and not now.is_lost)
    return good / n_runs


@pytest.mark.parametrize("kidnapped", [True, False], ids=["kidnapped", "unknown start"])
def test_finds_itself_within_a_minute(kidnapped: bool) -> None:
    assert _recovered_share(8, kidnapped=kidnapped) >= 0.95


def test_leaves_out_a_fix_that_jumps() -> None:
    config = LocalizationConfig()
    place, steps, fixes = _drive(config, np.random.default_rng(5), 60)
    fixes[30] += [15.0, 0.0, 0.0]
    filtered = ParticleFilter(config, np.random.default_rng(6), start=place[0])
    for k, (step, fix) in enumerate(zip(steps, fixes, strict=True)):
        filtered.move(step, STEP_S)
        filtered.correct(fix)
        assert np.linalg.norm((filtered.estimate().position - place[k + 1])[:2]) < 3.0


def test_says_lost_until_the_heading_is_known() -> None:
    config = LocalizationConfig()
    fixes = _drive(config, np.random.default_rng(7), 2)[2]
    filtered = ParticleFilter(config, np.random.default_rng(8))
    with pytest.raises(InputError, match="neither a start nor a fix"):
        filtered.estimate()
    filtered.correct(fixes[0])
    assert filtered.estimate().is_lost
