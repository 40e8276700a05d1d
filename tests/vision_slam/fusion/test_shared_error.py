"""Further constraints of a path (gravity, stakes, loop closures, a base station) and tests of the error model."""

from dataclasses import replace

import numpy as np
import pytest

from sim.instruments.sensor import gauss_markov
from survey.data.recording import Recording
from survey.data.sensors.odometry import LoopClosures, Odometry
from survey.data.sensors.records import GpsFixes, Inertial
from survey.data.sensors.stakes import Stakes, StakeSightings
from vision_slam import LocalizationConfig
from vision_slam.attitude import rotations
from vision_slam.fusion.smoother import SmoothedPath, smooth
from vision_slam.motion import dead_reckoning

CRS = "EPSG:32608"
LASTING = LocalizationConfig(
    gps_bias_sigma_m=3.0, gps_correlation_time_s=300.0, gps_white_sigma_m=1.0, tilt_sigma_deg=0.4
)


def round_and_round(n: int = 600) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, positions and attitudes of a drive round and round a wide bend, 1 m each second, level."""
    angle = np.arange(n) / 95.0
    position = np.column_stack([95.0 * np.sin(angle), 95.0 * (1.0 - np.cos(angle)), np.zeros(n)])
    return np.arange(n, dtype=float), position, np.column_stack([np.zeros(n), np.zeros(n), angle])


def drifting(seed: int = 2, n: int = 600) -> tuple[Recording, np.ndarray, np.ndarray]:
    """A recording whose odometry tilts by 0.4° and whose GPS is off for minutes; real places and attitudes."""
    rng = np.random.default_rng(seed)
    time_s, position, attitude = round_and_round(n)
    gaps = np.ones(n - 1)
    sensed = attitude + np.radians([0.4, 0.4, 0.1]) * gauss_markov(gaps, 60.0, 1.0, rng, 3)
    steps = np.einsum("nji,nj->ni", rotations(attitude[:-1]), np.diff(position, axis=0))
    bias = gauss_markov(gaps, 300.0, 3.0, rng, 3) + rng.standard_normal((n, 3))
    fixes = GpsFixes(time_s, position + bias * [1.0, 1.0, 1.7])
    return Recording(CRS, position[0], fixes, odometry=Odometry(time_s, steps, sensed)), position, attitude


def smoothed(recording: Recording, config: LocalizationConfig = LASTING) -> SmoothedPath:
    assert recording.odometry is not None
    return smooth(recording, dead_reckoning(recording.odometry, recording.start), config)


def gravity_of(attitude: np.ndarray, bias: tuple[float, float, float], jolts: float = 0.1) -> Inertial:
    rng = np.random.default_rng(9)
    n = len(attitude)
    # The bend: 1 m/s on a radius of 95 m.
    own = np.tile([0.0, 1.0 / 95.0, 0.0], (n, 1))
    force = rotations(attitude).transpose(0, 2, 1) @ [0.0, 0.0, 9.81] + own + bias
    rates = np.tile([0.0, 0.0, 1.0 / 95.0], (n, 1))
    return Inertial(np.arange(n, dtype=float), rates, force + jolts * rng.standard_normal((n, 3)))


def tilt_rms_deg(path: SmoothedPath, attitude: np.ndarray) -> float:
    return float(np.degrees(np.sqrt(np.mean((path.attitude_rad - attitude)[:, :2] ** 2))))


def test_gravity_halves_the_tilt_in_spite_of_its_bias_and_says_how_far():
    recording, _, attitude = drifting(n=2400)
    with_gravity = replace(recording, inertial=gravity_of(attitude, (0.05, -0.05, 0.0)))
    before, after = smoothed(recording), smoothed(with_gravity)
    assert tilt_rms_deg(before, attitude) > 0.25
    # Jolts of 0.1 m/s² are 0.6° a reading, 0.1° after ten readings a node and a few nodes; the bias is estimated from an
    # odometry whose 0.4° average out over 2,400 m, to 0.09°: together 0.14°, give or take a quarter.
    assert tilt_rms_deg(after, attitude) < 0.18
    claimed = np.degrees(np.sqrt(after.covariance[:, [4, 5], [4, 5]].mean()))
    assert tilt_rms_deg(after, attitude) == pytest.approx(claimed, rel=0.6)


def test_without_gravity_or_with_bad_readings_the_tilt_is_not_claimed():
    recording, _, attitude = drifting()
    shaken = smoothed(replace(recording, inertial=gravity_of(attitude, (0.0, 0.0, 0.0), jolts=1.5)))
    claimed = np.degrees(
        np.sqrt(np.array([p.covariance[:, 5, 5].mean() for p in (smoothed(recording), shaken)]))
    )
    assert claimed[0] == pytest.approx(0.4, rel=0.05)
    # Jolts of 9° a reading leave little more than the odometry's own tilt.
    assert claimed[1] > 0.25


def test_stakes_pin_the_path():
    recording, position, attitude = drifting()
    where = np.array([150, 300, 450, 590])
    arm = np.tile([0.0, 1.5, 0.2], (4, 1))
    real = position[where] + np.einsum("nij,nj->ni", rotations(attitude[where]), arm)
    seen = StakeSightings(where.astype(float), np.arange(4.0), arm, np.tile(9e-4 * np.eye(3), (4, 1, 1)))
    path = smoothed(replace(recording, stakes=Stakes(real, np.full(4, 0.05)), stake_sightings=seen))
    assert path.n_constraints == 4
    # A stake is known to 5 cm and seen to 3 cm.
    assert np.abs(path.position[where] - position[where]).max() < 0.25
    assert np.sqrt(path.covariance[where, 2, 2]).max() < 0.07
    assert np.sqrt(smoothed(recording).covariance[where, 2, 2]).max() > 0.3


def test_many_sightings_of_a_stake_share_the_error_of_its_survey():
    recording, position, attitude = drifting()
    where = np.repeat(np.arange(580, 600), 2)
    foot = position[590] + [1.5, 0.0, 0.2]
    offset = np.einsum("nji,nj->ni", rotations(attitude[where]), foot - position[where])
    spread = np.tile(9e-4 * np.eye(3), (len(where), 1, 1))
    seen = StakeSightings(where.astype(float), np.zeros(len(where)), offset, spread)
    path = smoothed(replace(recording, stakes=Stakes(foot[None], np.full(1, 0.05)), stake_sightings=seen))
    assert path.n_constraints == len(where)
    # However often it is seen, a stake that is known to 5 cm leaves 5 cm; independent errors would leave 2.
    assert 0.049 < np.sqrt(path.covariance[590, 2, 2]) < 0.06


def test_a_sighting_between_nodes_pins_them_no_better_than_the_steps_between_allow():
    recording, position, attitude = drifting()
    rough = LASTING.model_copy(update={"step_sigma_m": 0.2})
    sigma_m = []
    for middle in (300, 305):  # nodes stand every ten metres
        arm = np.array([[0.0, 1.5, 0.2]])
        foot = position[middle] + np.einsum("ij,nj->ni", rotations(attitude[middle : middle + 1])[0], arm)
        seen = StakeSightings(
            np.full(1, float(middle)), np.zeros(1), arm, np.tile(1e-4 * np.eye(3), (1, 1, 1))
        )
        path = smoothed(
            replace(recording, stakes=Stakes(foot, np.full(1, 0.01)), stake_sightings=seen), rough
        )
        sigma_m.append(np.sqrt(path.covariance[middle, 2, 2]))
    # Ten steps of 0.2 m: a bridge of 0.2 √(10 / 4) m in the middle.
    assert sigma_m[0] < 0.1
    assert sigma_m[1] > 0.25


def closures_at(position, attitude, shifts: dict[int, np.ndarray]) -> LoopClosures:
    """Recognize the first quarter's places from the last quarter, each from where it is, but for shifts [m]."""
    earlier, later = np.arange(20, 140, 15), np.arange(460, 580, 15)
    moved = position[later] - position[earlier]
    offset = np.einsum("nji,nj->ni", rotations(attitude[earlier]), moved)
    for k, shift in shifts.items():
        offset[k] += shift
    spread = np.tile(0.01 * np.eye(3), (len(earlier), 1, 1))
    return LoopClosures(later.astype(float), earlier.astype(float), offset, spread)


def test_two_wrong_closures_of_eight_are_refused_and_change_nothing():
    recording, position, attitude = drifting()
    wrong = {2: np.array([6.0, 0.0, 0.6]), 5: np.array([0.0, -6.0, -0.6])}
    right_six = closures_at(position, attitude, {})
    keep = np.array([k not in wrong for k in range(8)])
    six = LoopClosures(
        *(getattr(right_six, n)[keep] for n in ("time_s", "earlier_s", "offset", "covariance"))
    )
    gated = smoothed(replace(recording, loop_closures=closures_at(position, attitude, wrong)))
    clean = smoothed(replace(recording, loop_closures=six))
    assert (gated.n_constraints, gated.n_refused) == (6, 2)
    np.testing.assert_allclose(gated.position, clean.position, atol=1e-9)
    accepted = smoothed(
        replace(recording, loop_closures=closures_at(position, attitude, wrong)),
        LASTING.model_copy(update={"tie_gate": 1e9}),
    )
    assert np.abs(accepted.position - clean.position).max() > 0.5


def test_ties_enter_the_information_as_they_enter_the_marginals():
    recording, position, attitude = drifting()
    path = smoothed(replace(recording, loop_closures=closures_at(position, attitude, {})))
    own = path.error.pose_covariances[0]
    at_nodes = np.searchsorted(np.arange(600.0), path.error.time_s)
    # Woodbury over the chain against the factorization of the whole: a condition of some 1e9 in squared units.
    np.testing.assert_allclose(own, path.covariance[at_nodes], rtol=1e-4, atol=1e-8)


def test_a_base_station_takes_the_lasting_error_away():
    recording, position, _ = drifting()
    rng = np.random.default_rng(4)
    common = gauss_markov(np.ones(599), 300.0, 3.0, rng, 3)
    own = gauss_markov(np.ones(599), 300.0, 0.3, rng, 3)
    time_s = np.arange(600.0)
    rover = GpsFixes(time_s, position + common + own + rng.standard_normal((600, 3)))
    base = GpsFixes(time_s, position[0] + common + rng.standard_normal((600, 3)))
    config = LASTING.model_copy(update={"base_residual": 0.1})
    alone = smoothed(replace(recording, gps=rover))
    paired = smoothed(replace(recording, gps=rover, base=base), config)
    error = [np.sqrt(np.mean((path.position - position) ** 2)) for path in (alone, paired)]
    assert error[1] < 0.6 * error[0]


def test_an_unknown_start_is_stated_in_the_covariance():
    recording, position, _ = drifting()
    moved = replace(recording, start=recording.gps.position[0])
    config = LASTING.model_copy(update={"start": "unknown"})
    path = smoothed(moved, config)
    claimed = np.sqrt(path.covariance[:, 2, 2])
    error = np.abs(path.position[:, 2] - position[:, 2])
    # Only GPS measures the height: 5 m of error that last five minutes, averaged over ten.
    assert claimed.min() > 2.0
    assert (error < 3.0 * claimed).all()


def test_a_gps_correlation_time_assumed_too_short_is_reported_and_one_too_long_is_not(caplog):
    recording, _, _ = drifting()
    short = smoothed(recording, LASTING.model_copy(update={"gps_correlation_time_s": 10.0}))
    assert short.gps_evidence > 10.0
    assert "longer correlation time" in caplog.text
    caplog.clear()
    assert smoothed(recording).gps_evidence < 5.4
    assert (
        smoothed(recording, LASTING.model_copy(update={"gps_correlation_time_s": 3000.0})).gps_evidence < 5.4
    )
    assert not caplog.text
