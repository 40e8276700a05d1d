"""Sensors of dead reckoning: inertial measurement unit, wheel encoders, compass and barometer.

Gyro and accelerometer have white noise and biases that walk. Wheel encoders count ticks of both tracks, with errors of
scale. The compass has errors of declination, hard iron and soft iron. The barometer gives the pressure altitude above an
unknown datum, with weather drift; a second one at the base measures the drift.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from sim.config.sensors import (
    BarometerConfig,
    CompassConfig,
    FaultConfig,
    InertialConfig,
    WheelConfig,
    faults_of,
)
from sim.instruments.sensor import Clock, GaussMarkov, RandomWalkNoise, StatisticalDrive, gauss_markov
from sim.vehicle.motion import GRAVITY_M_S2, RoverMotion
from survey.core import FloatArray, stream
from survey.data.sensors.records import Barometer, Compass, Inertial, Wheels
from vision_slam.attitude import rotations

_HOUR_S = 3600.0
# Standing, turning and standing again take this long each; nothing jolts but the motor's hum.
_STAND_S, _STILL_SHARE = 20.0, 0.1


class InertialUnit:
    r"""Gyro and accelerometer: means over the time between readings, white noise and random-walk biases.

    With white noise N and a bias that walks with K the Allan variance over τ is

    .. math:: \sigma^2(\tau) = N^2 / \tau + K^2 \tau / 3
    """

    def __init__(self, config: InertialConfig, seed: int) -> None:
        self._clock = Clock(config, seed, "inertial")
        self._dt_s = 1.0 / config.rate_hz
        gyro = np.radians(
            [config.gyro_noise_deg_sqrt_h, config.gyro_bias_deg_h, config.gyro_bias_walk_deg_h_sqrt_h]
        )
        rng = {part: stream(seed, "instruments", "inertial", part) for part in ("gyro", "force")}
        self._gyro = RandomWalkNoise(
            gyro[0] / _HOUR_S**0.5, gyro[1] / _HOUR_S, gyro[2] / _HOUR_S**1.5, self._dt_s, rng["gyro"]
        )
        self._force = RandomWalkNoise(
            config.force_noise_m_s2_sqrt_hz,
            config.force_bias_m_s2,
            config.force_bias_walk_m_s2_sqrt_h / _HOUR_S**0.5,
            self._dt_s,
            rng["force"],
        )

    def sense(self, motion: RoverMotion) -> Inertial | None:
        """Return the readings during a stretch."""
        at_s, shown_s = self._clock.due(float(motion.time_s[-1]))
        at_s, shown_s = at_s[at_s > 0.0], shown_s[at_s > 0.0]
        if not len(at_s):
            return None
        before, after = motion.rotation_at(at_s - self._dt_s), motion.rotation_at(at_s)
        turn = (before.inv() * after).as_rotvec() / self._dt_s
        gained = (motion.velocity_at(at_s) - motion.velocity_at(at_s - self._dt_s)) / self._dt_s
        middle = before * Rotation.from_rotvec(0.5 * self._dt_s * turn)
        force = middle.inv().apply(gained + [0.0, 0.0, GRAVITY_M_S2])
        n = len(at_s)
        return Inertial(shown_s, turn + self._gyro.draw(n), force + self._force.draw(n))


def draw_inertial(drive: StatisticalDrive) -> Inertial | None:
    """Draw specific force and rates: gravity and acceleration, a constant bias, jolts; None without accelerometer."""
    mission, trajectory, attitude_rad = drive.mission, drive.trajectory, drive.attitude_rad
    aids, times = mission.aids, trajectory.time_s
    if not aids.accelerometer:
        return None
    rng = stream(mission.seed, "aids", "accelerometer")
    velocity = np.gradient(trajectory.position, times, axis=0)
    force = np.gradient(velocity, times, axis=0) + [0.0, 0.0, GRAVITY_M_S2]
    body = np.einsum("nji,nj->ni", rotations(attitude_rad), force)
    bias = aids.accelerometer_bias_m_s2 * rng.standard_normal(3)
    jolts = aids.accelerometer_white_m_s2 * rng.standard_normal(body.shape)
    rates = np.gradient(np.unwrap(attitude_rad, axis=0), times, axis=0)
    if mission.sensors.heading_walk_deg_sqrt_m > 0.0:  # the gyro is to hold the heading: no turn may be lost
        rates = _mean_rates(attitude_rad, times)
    driving = Inertial(times, rates, body + bias + jolts)
    if not aids.turn_at_start:
        return driving
    noise = _STILL_SHARE * aids.accelerometer_white_m_s2
    return _after_turning(driving, attitude_rad[0], bias, noise, rng)


def _mean_rates(attitude_rad: FloatArray, times: FloatArray) -> FloatArray:
    """Return the mean rates of turn (N, 3) over the time before each moment, as a gyro measures them."""
    body = Rotation.from_euler("xyz", attitude_rad)
    turned = (body[:-1].inv() * body[1:]).as_rotvec()
    return np.vstack([np.zeros(3), turned / np.diff(times)[:, None]])


def _after_turning(
    driving: Inertial, start_rad: FloatArray, bias: FloatArray, noise: float, rng: np.random.Generator
) -> Inertial:
    """Prepend a minute: standing under the opposite heading, turning on the spot, standing as the drive begins."""
    seconds = np.arange(3.0 * _STAND_S)
    turned = np.pi * np.clip((2.0 * _STAND_S - seconds) / _STAND_S, 0.0, 1.0)
    forward, left = -np.tan(start_rad[1]), np.tan(start_rad[0])
    ahead, aside = (
        np.cos(turned) * forward + np.sin(turned) * left,
        np.cos(turned) * left - np.sin(turned) * forward,
    )
    attitude = np.column_stack([np.arctan(aside), -np.arctan(ahead), start_rad[2] + turned])
    force = rotations(attitude)[:, 2, :] * GRAVITY_M_S2
    force = force + bias + noise * rng.standard_normal(force.shape)
    rates = np.column_stack([np.zeros((len(seconds), 2)), np.gradient(turned)])
    return Inertial(
        np.concatenate([seconds - len(seconds) + driving.time_s[0], driving.time_s]),
        np.concatenate([rates, driving.gyro_rad_s]),
        np.concatenate([force, driving.specific_force_m_s2]),
    )


class WheelEncoders:
    """Encoders that count the distance rolled by each track in ticks, with scale errors.

    Slip is part of the motion: a track that spins on the spot counts on.
    """

    def __init__(self, config: WheelConfig, seed: int) -> None:
        self._config = config
        self._clock = Clock(config, seed, "wheels")

    def sense(self, motion: RoverMotion) -> Wheels | None:
        """Return the counts during a stretch."""
        at_s, shown_s = self._clock.due(float(motion.time_s[-1]))
        if not len(at_s):
            return None
        config = self._config
        scale = 1.0 + config.scale_error + 0.5 * config.scale_difference * np.array([1.0, -1.0])
        ticks = np.floor(motion.rolled_at(at_s) * scale / config.tick_m)
        return Wheels(shown_s, *(ticks * config.tick_m).T)


class WheelFaults:
    """Faults of the encoders: a wrong calibration, and tracks that stand still while the rover is carried.

    `faults`: all faults of the mission. `seed`: the mission's seed; these faults draw nothing.
    """

    def __init__(self, faults: Sequence[FaultConfig], seed: int) -> None:
        del seed
        scales = [fault.size for fault in faults_of(faults, "calibration") if fault.failure == "wheels"]
        self._share = 1.0 + sum(scales)
        self._carried = faults_of(faults, "rover")
        self._counted = np.zeros(2)
        self._uncounted = np.zeros(2)

    def apply(self, wheels: Wheels) -> Wheels:
        """Return the counts that the encoders report."""
        if self._share == 1.0 and not self._carried:
            return wheels
        reported = []
        for time_s, *count in np.column_stack([wheels.time_s, wheels.left_m, wheels.right_m]):
            if any(fault.is_on(time_s) for fault in self._carried):
                self._uncounted = self._uncounted + count - self._counted
            self._counted = np.array(count)
            reported.append(self._share * (self._counted - self._uncounted))
        left, right = np.array(reported).T
        return replace(wheels, left_m=left, right_m=right)


class MagneticCompass:
    """Magnetic compass; iron and currents nearby give an error that depends on the heading."""

    def __init__(self, config: CompassConfig, seed: int) -> None:
        self._config = config
        self._clock = Clock(config, seed, "compass")
        self._phase = stream(seed, "instruments", "compass", "iron").uniform(0.0, 2.0 * np.pi, 2)
        self._rng = stream(seed, "instruments", "compass", "white")

    def sense(self, motion: RoverMotion) -> Compass | None:
        """Return the headings during a stretch."""
        at_s, shown_s = self._clock.due(float(motion.time_s[-1]))
        if not len(at_s):
            return None
        config = self._config
        heading = motion.rotation_at(at_s).as_euler("ZYX")[:, 0]
        error = config.declination_error_deg + config.hard_iron_deg * np.sin(heading + self._phase[0])
        error += config.soft_iron_deg * np.sin(2.0 * heading + self._phase[1])
        error += config.white_sigma_deg * self._rng.standard_normal(len(at_s))
        return Compass(shown_s, (heading + np.radians(error) + np.pi) % (2.0 * np.pi) - np.pi)


class PressureAltimeter:
    """Barometer: height above an unknown datum, with the drift of the weather."""

    def __init__(self, config: BarometerConfig, seed: int, name: str = "barometer") -> None:
        self._config = config
        self._clock = Clock(config, seed, name)
        rng = stream(seed, "instruments", name, "drift")
        self._datum_m = 10.0 * float(rng.standard_normal())
        self._drift = GaussMarkov(config.drift_sigma_m, config.correlation_time_s, rng, 1)
        self._white = stream(seed, "instruments", name, "white")

    def sense(self, motion: RoverMotion) -> Barometer | None:
        """Return the heights during a stretch."""
        at_s, shown_s = self._clock.due(float(motion.time_s[-1]))
        if not len(at_s):
            return None
        noise = self._config.white_sigma_m * self._white.standard_normal(len(at_s))
        height = motion.position_at(at_s)[:, 2] + self._datum_m + self._drift.at(at_s)[:, 0] + noise
        return Barometer(shown_s, height)


def draw_barometer(drive: StatisticalDrive) -> Barometer | None:
    """Draw the rover's barometer; None where the mission has none."""
    return Barometer(drive.trajectory.time_s, _heights(drive)) if drive.mission.aids.barometer else None


def draw_base_barometer(drive: StatisticalDrive) -> Barometer | None:
    """Draw a barometer at the start, which shares all drift but a part of its own; None where the mission has none."""
    aids, sensors, trajectory = drive.mission.aids, drive.mission.sensors, drive.trajectory
    if not (aids.barometer and aids.base_barometer):
        return None
    rng = stream(drive.mission.seed, "aids", "base barometer")
    weather = _heights(drive) - trajectory.position[:, 2]
    sigma = sensors.barometer_drift_sigma_m * aids.base_barometer_residual
    gaps = np.diff(trajectory.time_s)
    own = gauss_markov(gaps, sensors.barometer_correlation_time_s, sigma, rng)[:, 0]
    return Barometer(trajectory.time_s, trajectory.position[0, 2] + weather + own)


def _heights(drive: StatisticalDrive) -> FloatArray:
    """Return the pressure altitudes (N,) of the rover's barometer [m]."""
    sensors, trajectory = drive.mission.sensors, drive.trajectory
    rng = stream(drive.mission.seed, "sensors", "barometer")
    datum = 10.0 * rng.standard_normal()
    gaps, sigma = np.diff(trajectory.time_s), sensors.barometer_drift_sigma_m
    drift = gauss_markov(gaps, sensors.barometer_correlation_time_s, sigma, rng)[:, 0]
    white = sensors.barometer_white_sigma_m * rng.standard_normal(len(drift))
    heights: FloatArray = trajectory.position[:, 2] + datum + drift + white
    return heights
