"""Measurement equations of the smoother, one function per sensor, at nodes along the path.

`Nodes` are the poses of the odometry at which errors are estimated, with sums and means of records at them. `add_terms` adds
the rows of motion, start, heading, wheels, odometry, fixes, barometer and gravity. Fixes and heights may be differential,
relative to a base station at the start (`differenced_fixes`, `differenced_heights`). Stakes and loop closures are in
`vision_slam.fusion.pose_constraints`.
"""

from dataclasses import dataclass

import numpy as np

from survey.core import FloatArray, IntArray
from survey.data.recording import OdometryRecording, Recording
from survey.data.sensors.odometry import Odometry
from survey.data.sensors.records import GpsFixes
from vision_slam.attitude import gravity_tilt, initial_heading, rotations, standing_bias, turned
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.normal_equations import (
    BIAS,
    DATUM,
    DELAY,
    DRIFT,
    FORCE_PITCH,
    FORCE_ROLL,
    GYRO,
    HEADING,
    MEAN_SCALE,
    PITCH,
    PITCH_BIAS,
    ROLL,
    ROLL_BIAS,
    SCALE,
    SKID,
    WHEEL_SCALE,
    YAW,
    E,
    NormalEquations,
    Term,
    unknown,
)
from vision_slam.motion import ANY_RATE_RAD_S, GyroErrors, gyro_residual_rad

# Readings this long before the first pose or after the last count as taken at it: rovers stand there.
_BESIDE_S = 1.0
_HALF_S = 0.25
_LEAST_TRAVEL_M = 1e-3


@dataclass(frozen=True)
class Nodes:
    """The nodes among the poses of the odometry, its dead_reckoned path, and a guess (K, PER_NODE) of their unknowns.

    How steps answer to attitude and scale is taken about that guess, and how fixes answer to their
    delay about ``delay_s``.
    """

    odometry: Odometry
    dead_reckoned: FloatArray
    index: IntArray
    guess: FloatArray
    delay_s: float = 0.0

    @property
    def time_s(self) -> FloatArray:
        """Times of the nodes [s]."""
        return self.odometry.time_s[self.index]

    @property
    def travel(self) -> FloatArray:
        """Travel from node to node (K - 1,) [m], at least a millimetre: errors that cannot change swamp all others."""
        travel = self.summed(np.linalg.norm(np.diff(self.dead_reckoned, axis=0), axis=1))
        return np.maximum(travel, _LEAST_TRAVEL_M)

    @property
    def rolled(self) -> FloatArray:
        """Travel as wheels count it (K - 1,), back again where the rover reverses [m]."""
        return self.summed(signed_travel(self.odometry))

    @property
    def turned_rad(self) -> FloatArray:
        """Sum of the turns of heading, to either side, from node to node."""
        return self.summed(np.abs(np.diff(np.unwrap(self.odometry.attitude_rad[:, 2]))))

    @property
    def guessed(self) -> tuple[FloatArray, FloatArray]:
        """The steps (N - 1, 3) and headings (N - 1,) of the odometry, less the guess of its errors."""
        poses_s = self.odometry.time_s[:-1]
        wrong = {k: np.interp(poses_s, self.time_s, self.guess[:, k]) for k in (YAW, PITCH, ROLL, SCALE)}
        off = np.column_stack([wrong[ROLL], wrong[PITCH], wrong[YAW]])
        attitude = self.odometry.attitude_rad[:-1] - off
        steps = np.einsum("nij,nj->ni", rotations(attitude), self.odometry.step)
        return steps * (1.0 - wrong[SCALE])[:, None], attitude[:, 2]

    def velocity(self, time_s: FloatArray) -> FloatArray:
        """Return the velocity (N, 3) [m/s] at some times, about the guess, averaged over half a second."""
        steps, _ = self.guessed
        path = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
        poses_s = self.odometry.time_s
        ends = [np.clip(time_s + half_s, *poses_s[[0, -1]]) for half_s in (-_HALF_S, _HALF_S)]
        before, after = (
            np.column_stack([np.interp(end_s, poses_s, axis) for axis in path.T]) for end_s in ends
        )
        velocity: FloatArray = (after - before) / np.maximum(ends[1] - ends[0], _HALF_S)[:, None]
        return velocity

    def summed(self, values: FloatArray) -> FloatArray:
        """Sum what belongs to steps (N - 1, …) from node to node."""
        total = np.concatenate([np.zeros_like(values[:1]), np.cumsum(values, axis=0)])
        sums: FloatArray = np.diff(total[self.index], axis=0)
        return sums

    def beyond_usual(self, errors: FloatArray | None) -> FloatArray:
        """Return the errors of steps beyond the usual ones (N - 1,), summed from node to node (K - 1,)."""
        if errors is None:
            return np.zeros(len(self.index) - 1)
        return np.sqrt(self.summed(errors**2))

    def averaged(self, time_s: FloatArray, values: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Average readings (N, D) at their nearest nodes: node index, mean (K, D), count (K,).

        Readings before the first pose or after the last are no measurements of the path.
        """
        first_s, last_s = self.odometry.time_s[[0, -1]]
        inside = (time_s >= first_s - _BESIDE_S) & (time_s <= last_s + _BESIDE_S)
        time_s, values = time_s[inside], values[inside]
        edges = 0.5 * (self.time_s[1:] + self.time_s[:-1])
        nearest = np.searchsorted(edges, time_s)
        node, inverse, count = np.unique(nearest, return_inverse=True, return_counts=True)
        total = np.zeros((len(node), values.shape[1]))
        np.add.at(total, inverse, values)
        return node.astype(np.int64), total / count[:, None], count.astype(np.float64)


def signed_travel(odometry: Odometry) -> FloatArray:
    """Return the lengths of the steps (N - 1,) [m], negative where the rover reverses."""
    travel: FloatArray = np.copysign(np.linalg.norm(odometry.step, axis=1), odometry.step[:, 0])
    return travel


_DATUM_SIGMA_M = 1e4  # a barometer's datum is unknown by kilometres before the first reading
# What counts as known exactly: a larger number would swamp the others in rounding.
_EXACT_RAD = 1e-6
_EXACT_SCALE = 1e-5
# A heading worse than this counts as unknown; that of the odometry may have been aligned with the fixes.
_KNOWN_DEG, _ANY_DEG = 1.0, 180.0
# Wheels and odometry that differ by more standard deviations than this are both given larger errors there.
_DOUBTED = 3.0


def add_terms(
    system: NormalEquations, recording: OdometryRecording, along: Nodes, config: LocalizationConfig
) -> None:
    """Add the terms of all sensors except stakes and loop closures, which are gated afterwards."""
    _add_motion(system, recording)
    _add_start(system, recording, config)
    _add_heading(system, recording, along, config)
    contradiction_m = _add_wheels(system, recording, along, config)
    _add_odometry(system, along, config, contradiction_m)
    _add_gps(system, recording, along, config)
    _add_barometer(system, recording, along, config)
    _add_gravity(system, recording, along, config)


def _add_motion(system: NormalEquations, recording: OdometryRecording) -> None:
    """Add the prior of the unknowns of the ice's motion."""
    motion = recording.ice_motion
    if motion is None or not system.n_motion:
        return
    whitened = np.linalg.inv(np.linalg.cholesky(motion.spread))
    system.add(system.motion_terms(whitened), whitened @ motion.expected, np.ones(system.n_motion))


def _add_start(system: NormalEquations, recording: OdometryRecording, config: LocalizationConfig) -> None:
    back_rad, settings = compass_offset(recording, config)
    start_m, heading_rad = settings.start_errors
    one = np.ones(1)
    moved = moved_by_unknowns(recording, recording.start[None, :2], recording.odometry.time_s[:1])
    for axis in range(3):
        terms: list[Term] = [(np.atleast_1d(np.asarray(E + axis)), one)]
        system.add(terms + system.motion_terms(-moved[:, axis]), 0.0 * one, start_m * one)
    system.add(
        [(unknown(np.zeros(1, dtype=np.int64), HEADING), one)],
        -back_rad * one,
        max(heading_rad, _EXACT_RAD) * one,
    )
    system.add_prior(GYRO, ANY_RATE_RAD_S)
    for which, sigma_deg in (
        (PITCH_BIAS, config.tilt_bias_sigma_deg),
        (ROLL_BIAS, config.tilt_bias_sigma_deg),
        (FORCE_PITCH, config.accelerometer_bias_sigma_deg),
        (FORCE_ROLL, config.accelerometer_bias_sigma_deg),
    ):
        system.add_prior(which, max(float(np.radians(sigma_deg)), _EXACT_RAD))
    system.add_prior(MEAN_SCALE, config.scale_sigma)
    system.add_prior(WHEEL_SCALE, config.wheel_scale_sigma)
    system.add_prior(SKID, config.wheel_skid_m)
    system.add_prior(DATUM, _DATUM_SIGMA_M)


def compass_offset(
    recording: OdometryRecording, config: LocalizationConfig
) -> tuple[float, LocalizationConfig]:
    """Return the rotation from the heading of the odometry to that of the compass [rad], and the configuration to use."""
    if config.heading_sigma_deg <= _KNOWN_DEG:
        return 0.0, config
    if recording.compass is None:
        return 0.0, config.model_copy(update={"heading_sigma_deg": _ANY_DEG})
    first = float(recording.odometry.attitude_rad[0, 2])
    back = initial_heading(recording.compass, float(recording.odometry.time_s[0])) - first
    return float(np.angle(np.exp(1j * back))), config


def _add_heading(
    system: NormalEquations, recording: OdometryRecording, along: Nodes, config: LocalizationConfig
) -> None:
    """Add the random walk of the heading, and the gyro, whose bias walks far more slowly."""
    gyro, seconds = GyroErrors.of(config), np.diff(along.time_s)
    walk = gyro.heading_walk * along.travel + along.beyond_usual(along.odometry.turn_sigma_rad) ** 2
    system.add_walk(HEADING, np.maximum(np.sqrt(walk), _EXACT_RAD))
    system.add_walk(GYRO, np.sqrt(gyro.bias_walk * seconds))
    if recording.inertial is None or not gyro.is_used:
        return
    beyond = along.summed(gyro_residual_rad(recording.inertial, along.odometry))
    before = np.flatnonzero(np.isfinite(beyond))
    turned_rad = np.diff(np.unwrap(along.odometry.attitude_rad[:, 2])[along.index])
    one, half = np.ones(len(before)), 0.5 * seconds[before]
    terms: list[Term] = [(unknown(before, YAW), one), (unknown(before + 1, YAW), -one)]
    terms += [(unknown(before, GYRO), half), (unknown(before + 1, GYRO), half)]
    system.add(terms, beyond[before], np.sqrt(gyro.variance(seconds, turned_rad))[before])


def _add_wheels(
    system: NormalEquations, recording: OdometryRecording, along: Nodes, config: LocalizationConfig
) -> FloatArray:
    """Add the travel by wheels; return its contradiction with the odometry (K - 1,) [m].

    Wheels have a constant scale error and skid in turns. Where they differ from the odometry by
    more, either the wheels spin or the images were tracked wrongly: both are given less weight.
    """
    contradiction = np.zeros(len(along.index) - 1)
    wheels, times = recording.wheels, along.time_s
    if wheels is None:
        return contradiction
    before = np.flatnonzero((times[:-1] >= wheels.time_s[0] - 1.0) & (times[1:] <= wheels.time_s[-1] + 1.0))
    before = before[before > 0]  # tracks spin when they set off
    rolled = np.diff(np.interp(times, wheels.time_s, 0.5 * (wheels.left_m + wheels.right_m)))[before]
    length, ahead, turned_rad = along.travel[before], along.rolled[before], along.turned_rad[before]
    varies = config.wheel_skid_m * np.sqrt(turned_rad)
    sigma = np.hypot(config.wheel_step_sigma_m * np.sqrt(length), varies)
    scale = np.hypot(config.scale_wander_sigma, np.hypot(config.scale_sigma, config.wheel_scale_sigma))
    expected = np.hypot(np.hypot(sigma, config.wheel_skid_m * turned_rad), scale * length)
    off = rolled - ahead
    contradiction[before] = np.where(np.abs(off) > _DOUBTED * expected, np.abs(off), 0.0)
    half = -0.5 * ahead
    terms = [
        (np.array(WHEEL_SCALE), ahead),
        (np.array(SKID), turned_rad),
        (unknown(before, SCALE), half),
        (unknown(before + 1, SCALE), half),
    ]
    system.add(terms, off, np.hypot(sigma, contradiction[before]))
    return contradiction


def _add_odometry(
    system: NormalEquations, along: Nodes, config: LocalizationConfig, contradiction_m: FloatArray
) -> None:
    before = np.arange(len(along.index) - 1)
    length, (steps, heading) = along.travel, along.guessed
    reckoned_step, step = np.diff(along.dead_reckoned[along.index], axis=0), along.summed(steps)
    by_yaw, by_pitch = (along.summed(answer) for answer in turned(steps, heading))
    one = np.ones(len(before))
    contradiction_m = np.hypot(contradiction_m, along.beyond_usual(along.odometry.step_sigma_m))
    contradiction_m = np.hypot(contradiction_m, config.turn_sigma_m * np.sqrt(along.turned_rad))
    for axis in range(3):
        terms: list[Term] = [(unknown(before + 1, E + axis), one), (unknown(before, E + axis), -one)]
        value = (reckoned_step - step)[:, axis]
        for which, answer in ((YAW, by_yaw), (PITCH, by_pitch), (SCALE, step)):
            half = 0.5 * answer[:, axis]
            terms += [(unknown(before, which), -half), (unknown(before + 1, which), -half)]
            value = value - half * (along.guess[:-1, which] + along.guess[1:, which])
        system.add(terms, value, np.hypot(config.step_sigma_m * np.sqrt(length), contradiction_m))
    memory = np.exp(-length / config.scale_wander_m)
    system.add_gauss_markov(SCALE, memory, max(config.scale_wander_sigma, _EXACT_SCALE), MEAN_SCALE)
    _add_attitude(system, along, config)


def _add_attitude(system: NormalEquations, along: Nodes, config: LocalizationConfig) -> None:
    """Add the changing errors of yaw, roll and pitch about their means."""
    memory = np.exp(-along.travel / config.attitude_correlation_m)
    tilt_rad = float(np.radians(config.tilt_sigma_deg))
    system.add_gauss_markov(YAW, memory, float(np.radians(config.yaw_sigma_deg)), HEADING)
    if config.tilt_stays_in_world:
        turn_rad = np.diff(np.unwrap(along.odometry.attitude_rad[:, 2])[along.index])
        means = (ROLL_BIAS, PITCH_BIAS)
        system.add_turning_gauss_markov((ROLL, PITCH), memory, turn_rad, tilt_rad, means)
        return
    system.add_gauss_markov(PITCH, memory, tilt_rad, PITCH_BIAS)
    system.add_gauss_markov(ROLL, memory, tilt_rad, ROLL_BIAS)


def _add_gps(
    system: NormalEquations, recording: OdometryRecording, along: Nodes, config: LocalizationConfig
) -> None:
    position, left = differenced_fixes(recording, config)
    time_s = recording.gps.time_s - along.delay_s
    mast = rotations(along.odometry.attitude_rad)[:, :, 2] * recording.antenna_height_m
    at_fix = np.column_stack(
        [np.interp(time_s, along.odometry.time_s, column) for column in (along.dead_reckoned + mast).T]
    )
    ratio = stated_errors(recording.gps, config)
    weight = (ratio**-2.0)[:, None]
    velocity = along.velocity(time_s) if system.has_delay else np.zeros_like(at_fix)
    off = at_fix - position
    if system.has_delay:
        off += _beyond_ends(along, time_s, velocity) + along.delay_s * velocity
        system.add_prior(DELAY, config.clock_sigma_s)
    # Fixes at one node are averaged by their weights; bias and white error are as much larger as stated.
    moved = moved_by_unknowns(recording, position[:, :2], recording.gps.time_s)
    by_motion = weight * moved.reshape(len(moved), -1)
    parts = np.column_stack([weight * off, weight * ratio[:, None], weight, weight * velocity, by_motion])
    node, mean, count = along.averaged(time_s, parts)
    shared = mean[:, 4]
    mean = mean / shared[:, None]
    memory = np.exp(-np.diff(along.time_s) / config.gps_correlation_time_s)
    one, larger = np.ones(len(node)), mean[:, 3]
    white = left.gps_white_sigma_m / np.sqrt(count * shared)
    for axis in range(3):
        factor = config.gps_vertical_factor if axis == 2 else 1.0
        terms: list[Term] = [(unknown(node, E + axis), one), (unknown(node, BIAS + axis), -larger)]
        if system.has_delay:
            terms.append((np.array(DELAY), mean[:, 5 + axis]))
        terms += system.motion_terms(-mean[:, 8:].reshape(len(node), *moved.shape[1:])[:, axis])
        system.add(terms, mean[:, axis], factor * white)
        system.add_gauss_markov(BIAS + axis, memory, factor * left.gps_bias_sigma_m)


def moved_by_unknowns(recording: OdometryRecording, xy: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return how far places (N, 2) of the epoch have moved by some times for unknowns of 1 of the ice's motion (N, 3, R) [m]."""
    if recording.ice_motion is None:
        return np.zeros((len(xy), 3, 0))
    return recording.ice_motion.derivatives(xy, time_s)


def _beyond_ends(along: Nodes, time_s: FloatArray, velocity: FloatArray) -> FloatArray:
    """Return how far the path goes on (N, 3) [m] at times before its first pose or after its last."""
    beyond_s = time_s - np.clip(time_s, *along.odometry.time_s[[0, -1]])
    further: FloatArray = beyond_s[:, None] * velocity
    return further


def _add_barometer(
    system: NormalEquations, recording: OdometryRecording, along: Nodes, config: LocalizationConfig
) -> None:
    readings, left = differenced_heights(recording, config)
    memory = np.exp(-np.diff(along.time_s) / config.barometer_correlation_time_s)
    system.add_gauss_markov(DRIFT, memory, left.barometer_drift_sigma_m)
    if readings is None or recording.barometer is None:
        return
    time_s = recording.barometer.time_s
    height = np.interp(time_s, along.odometry.time_s, along.dead_reckoned[:, 2])
    node, mean, count = along.averaged(time_s, (height - readings)[:, None])
    many = np.ones(len(node))
    terms: list[Term] = [
        (unknown(node, E + 2), many),
        (unknown(node, DRIFT), -many),
        (np.array(DATUM), -many),
    ]
    system.add(terms, mean[:, 0], left.barometer_white_sigma_m / np.sqrt(count))


def _add_gravity(
    system: NormalEquations, recording: OdometryRecording, along: Nodes, config: LocalizationConfig
) -> None:
    """Add roll and pitch from gravity, with the scatter that the readings themselves show.

    The scatter is taken about the mean of each node and from node to node, whichever is
    larger, so that lasting jolts do not count as precise. Odometry that was levelled by the
    same readings contains them already: it shares their bias, and only the bias measured while
    standing is added.
    """
    if recording.inertial is None:
        return
    # The tilt by gravity has the bias of the reading: θ(g) = θ + a.
    biases, doubt_deg = ((ROLL, FORCE_ROLL), (PITCH, FORCE_PITCH)), 0.0
    if config.levelling_sigma_deg is not None:
        biases, doubt_deg = ((ROLL, ROLL_BIAS), (PITCH, PITCH_BIAS)), config.levelling_sigma_deg
    standing = standing_bias(recording.inertial, along.odometry.time_s[0])
    if standing is not None:
        sigma = np.hypot(standing.sigma_rad, np.radians(doubt_deg)) * np.ones(1)
        for (_, bias), value in zip(biases, (standing.roll_rad, standing.pitch_rad), strict=True):
            system.add([(np.array([bias]), np.ones(1))], value * np.ones(1), sigma)
    if config.levelling_sigma_deg is not None:
        return
    tilt = gravity_tilt(recording.inertial, along.odometry)
    times, attitude = along.odometry.time_s, along.odometry.attitude_rad
    sensed = np.column_stack(
        [
            np.interp(tilt.time_s, times, attitude[:, axis]) - values
            for axis, values in ((0, tilt.roll_rad), (1, tilt.pitch_rad))
        ]
    )
    if len(sensed) < 2:
        return
    node, mean, count = along.averaged(tilt.time_s, sensed)
    for column, (which, bias) in enumerate(biases):
        sigma = _scatter(sensed[:, column], mean[:, column], count)
        many = np.ones(len(node))
        terms: list[Term] = [(unknown(node, which), many), (np.array(bias), -many)]
        system.add(terms, mean[:, column], sigma / np.sqrt(count))


def _scatter(readings: FloatArray, mean: FloatArray, count: FloatArray) -> float:
    """Return the standard deviation of one reading [rad]: by neighbours in time, and by bends of the nodes' means."""
    within = 1.4826 * float(np.median(np.abs(np.diff(readings))) / np.sqrt(2.0))
    if len(mean) < 3:
        return max(within, _EXACT_RAD)
    bends = np.abs(mean[2:] - 2.0 * mean[1:-1] + mean[:-2]) * np.sqrt(count[1:-1] / 6.0)
    return max(within, 1.4826 * float(np.median(bends)), _EXACT_RAD)


def differenced_fixes(
    recording: Recording, config: LocalizationConfig
) -> tuple[FloatArray, LocalizationConfig]:
    """Return the fixes (N, 3), less the errors that both receivers have, as measured by a base station at the start.

    The second is what is then to be assumed of them.
    """
    fixes, base = recording.gps, recording.base
    if base is None:
        return fixes.position, config
    common = base.position - recording.start
    position = fixes.position - np.column_stack(
        [np.interp(fixes.time_s, base.time_s, error) for error in common.T]
    )
    left = {
        "gps_bias_sigma_m": config.gps_bias_sigma_m * config.base_residual,
        "gps_white_sigma_m": config.gps_white_sigma_m * float(np.sqrt(2.0)),
    }
    return position, config.model_copy(update=left)


def differenced_heights(
    recording: Recording, config: LocalizationConfig
) -> tuple[FloatArray | None, LocalizationConfig]:
    """Return the barometer's heights (N,), less the weather that one at the start felt, and what is to be assumed of them."""
    readings, base = recording.barometer, recording.base_barometer
    if readings is None:
        return None, config
    if base is None:
        return readings.height_m, config
    weather = np.interp(readings.time_s, base.time_s, base.height_m - base.height_m[0])
    left = {
        "barometer_drift_sigma_m": config.barometer_drift_sigma_m * config.base_barometer_residual,
        "barometer_white_sigma_m": config.barometer_white_sigma_m * float(np.sqrt(2.0)),
    }
    return readings.height_m - weather, config.model_copy(update=left)


def stated_errors(gps: GpsFixes, config: LocalizationConfig) -> FloatArray:
    """Return the errors of fixes (N,) over those that the configuration assumes; 1 where the receiver states none."""
    if gps.sigma_m is None:
        return np.ones(len(gps))
    assumed_m = config.fix_sigma_m
    ratio: FloatArray = gps.sigma_m / assumed_m
    return ratio
