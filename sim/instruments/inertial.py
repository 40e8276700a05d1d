"""Inertial measurement unit: gyro and accelerometer with white noise and biases."""

import numpy as np
from scipy.spatial.transform import Rotation

from sim.config.sensors import InertialConfig
from sim.instruments.errors import Clock, RandomWalkNoise
from sim.instruments.sensor import StatisticalDrive
from sim.vehicle.motion import RoverMotion
from sim.vehicle.physics import GRAVITY_M_S2
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.sensors.aiding import Inertial
from vision_slam.rotation import rotations

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
