"""What the estimator assumes of its sensors, and which landmarks it hands on."""

from typing import Literal

import numpy as np
from pydantic import NonNegativeFloat, PositiveFloat

from survey.core.config import Section

_UNKNOWN_START_M = 100.0
_UNKNOWN_HEADING_DEG = 5.0


class ImageOdometryErrors(Section):
    """Errors of the odometry that images give; each stands in for that of the same name in `LocalizationConfig`.

    As `python -m benchmarks.odometry_errors` measures them, on drives that nothing is judged on.
    """

    yaw_sigma_deg: PositiveFloat = 0.05
    """Heading error that is soon forgotten [deg]."""
    heading_walk_deg_sqrt_m: NonNegativeFloat = 0.04
    """Heading error that is not: its random walk per square root of a metre [deg]."""
    heading_sigma_deg: NonNegativeFloat = 5.0
    """Constant part of the heading error: what a compass beside motors is wrong by [deg]."""
    tilt_sigma_deg: PositiveFloat = 0.15
    """Changing part of the roll and pitch error [deg]."""
    tilt_bias_sigma_deg: NonNegativeFloat = 0.2
    """Constant part of it, that of the accelerometer which levels the images [deg]."""
    levelling_sigma_deg: PositiveFloat | None = 0.15
    """What it differs from that accelerometer's by: steps climb by 0.12 degrees more than their pitch says [deg]."""
    attitude_correlation_m: PositiveFloat = 60.0
    """Travel over which attitude errors stay correlated [m]."""
    scale_sigma: PositiveFloat = 0.012
    """Relative error of the scale over a whole drive."""
    scale_wander_sigma: NonNegativeFloat = 0.02
    """Changing part of that error: one camera hands its scale on from point to point."""
    scale_wander_m: PositiveFloat = 3.0
    """Travel over which it stays correlated [m]."""
    step_sigma_m: PositiveFloat = 0.012
    """Random error, sideways and upwards too, per square root of a metre [m]."""
    turn_sigma_m: NonNegativeFloat = 0.2
    """Random error of turns, per square root of a radian [m]."""


class LocalizationConfig(Section):
    """Datasheet values that the smoother works with, and the landmark gates of the paper.

    Angles are standard deviations of errors that stay correlated over
    `attitude_correlation_m` of travel. A GPS correlation time that is longer than the
    true one costs little; one that is too short makes every covariance a lie.
    """

    yaw_sigma_deg: PositiveFloat = 0.2
    """Heading error of the visual odometry [deg]."""
    heading_sigma_deg: NonNegativeFloat = 0.0
    """Constant part of the heading error: how well the heading at the start was known [deg]."""
    heading_walk_deg_sqrt_m: NonNegativeFloat = 0.0
    """Random walk of the heading error per square root of a metre [deg]; where there is one, a gyro is made use of."""
    gyro_noise_deg_sqrt_h: PositiveFloat = 0.3
    """Angle random walk of the gyro [deg/√h]."""
    gyro_bias_walk_deg_h_sqrt_h: PositiveFloat = 10.0
    """Random walk of its bias, of which nothing is assumed at the start [deg/h/√h]."""
    gyro_scale_sigma: NonNegativeFloat = 0.001
    """Share of a turn by which it is wrong."""
    tilt_sigma_deg: PositiveFloat = 0.1
    """Changing part of the roll and pitch error of the odometry [deg]; too small is worse than too large."""
    tilt_bias_sigma_deg: NonNegativeFloat = 0.02
    """Constant part of it: the tilt at which the sensor is mounted [deg]."""
    accelerometer_bias_sigma_deg: PositiveFloat = 0.5
    """Tilt that the accelerometer pretends, constant over the drive [deg]; used where there are inertial records."""
    levelling_sigma_deg: PositiveFloat | None = None
    """By how much the odometry's constant tilt differs from what that accelerometer pretends, if the odometry was
    levelled by it [deg]; gravity then says nothing new. None where it was levelled by other means."""
    attitude_correlation_m: PositiveFloat = 60.0
    """Travel over which attitude errors stay correlated [m]."""
    scale_sigma: PositiveFloat = 0.004
    """Relative error of the odometry's scale."""
    scale_wander_sigma: NonNegativeFloat = 0.0
    """Changing part of that error."""
    scale_wander_m: PositiveFloat = 6.0
    """Travel over which it stays correlated [m]."""
    wheel_scale_sigma: PositiveFloat = 0.03
    """Relative error of the wheels' travel that stays: worn tracks, steady slip."""
    wheel_step_sigma_m: PositiveFloat = 0.012
    """Random error of the wheels' travel per square root of a metre [m]."""
    wheel_skid_m: PositiveFloat = 0.2
    """What skidding tracks count too much per radian of turning, give or take as much [m]."""
    step_sigma_m: PositiveFloat = 0.006
    """Random error of the odometry per square root of a metre [m]."""
    turn_sigma_m: NonNegativeFloat = 0.0
    """Random error of turns per square root of a radian [m]."""
    start: Literal["surveyed", "unknown"] = "surveyed"
    """Whether the start and the heading there are known; unknown is 100 m and 5°."""
    start_sigma_m: PositiveFloat = 0.02
    """Error of the surveyed start [m]."""
    gps_bias_sigma_m: PositiveFloat = 1.0
    """Slowly varying horizontal error of the fixes [m]."""
    gps_correlation_time_s: PositiveFloat = 120.0
    """Time over which that error stays correlated [s]."""
    gps_white_sigma_m: PositiveFloat = 0.5
    """Independent horizontal error of each fix [m]."""
    gps_vertical_factor: PositiveFloat = 1.7
    """Vertical over horizontal error of the fixes."""
    barometer_drift_sigma_m: PositiveFloat = 1.0
    """Drift of the pressure altitude by weather [m]."""
    barometer_correlation_time_s: PositiveFloat = 1800.0
    """Time over which that drift stays correlated [s]."""
    barometer_white_sigma_m: PositiveFloat = 0.15
    """Independent error of each pressure altitude [m]."""
    base_residual: PositiveFloat = 0.2
    """Share of the slowly varying GPS error that is left after a base station's is subtracted."""
    base_barometer_residual: PositiveFloat = 0.3
    """Share of the barometer's drift that is left after a base station's is subtracted."""
    tie_gate: PositiveFloat = 16.27
    """Squared misfit beyond which a stake or a closure is refused; 99.9 % of the right ones stay."""
    images: ImageOdometryErrors = ImageOdometryErrors()
    """What is assumed of the odometry instead, where it comes from images."""
    node_spacing_m: PositiveFloat = 10.0
    """Travel between the places at which errors are estimated [m]."""
    landmark_max_sigma_m: PositiveFloat = 0.5
    """Largest half-axis of a landmark's own 1σ ellipsoid (section II.E of the glacier paper) [m]."""
    landmark_min_range_m: PositiveFloat = 5.0
    """Landmarks first seen from nearer than this are left out as redundant (section II.E) [m]."""
    landmark_thinning: Literal["range", "information"] = "range"
    """Whether landmarks are thinned by that range, or those kept, from any range, that tell a map the most."""
    landmarks_per_m: PositiveFloat = 5.0
    """By information: landmarks that are kept per metre of travel."""
    terrain_variance_m2: PositiveFloat = 10.0
    """By information: variance of the terrain about what is known before (section III.B) [m²]."""
    terrain_length_scale_m: PositiveFloat = 17.75
    """By information: its length scale [m]; rather too small than too large."""

    @property
    def start_errors(self) -> tuple[float, float]:
        """Standard deviations of each coordinate of the start [m] and of the heading there [rad]."""
        known = self.start == "surveyed"
        heading_deg = self.heading_sigma_deg if known else max(self.heading_sigma_deg, _UNKNOWN_HEADING_DEG)
        return self.start_sigma_m if known else _UNKNOWN_START_M, float(np.radians(heading_deg))
