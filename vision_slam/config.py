"""What the estimator assumes of its sensors, and which landmarks it hands on."""

from typing import Literal

from pydantic import NonNegativeFloat, PositiveFloat

from survey.config import Section


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
    tilt_sigma_deg: PositiveFloat = 0.1
    """Changing part of the roll and pitch error of the odometry [deg]; too small is worse than too large."""
    tilt_bias_sigma_deg: NonNegativeFloat = 0.02
    """Constant part of it: the tilt at which the sensor is mounted [deg]."""
    accelerometer_bias_sigma_deg: PositiveFloat = 0.5
    """Tilt that the accelerometer pretends, constant over the drive [deg]; used where there are inertial records."""
    attitude_correlation_m: PositiveFloat = 60.0
    """Travel over which attitude errors stay correlated [m]."""
    scale_sigma: PositiveFloat = 0.004
    """Relative error of the odometry's scale."""
    step_sigma_m: PositiveFloat = 0.006
    """Random error of the odometry per square root of a metre [m]."""
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
    node_spacing_m: PositiveFloat = 10.0
    """Travel between the places at which errors are estimated [m]."""
    landmark_max_sigma_m: PositiveFloat = 0.5
    """Largest half-axis of a landmark's own 1σ ellipsoid (section II.E of the glacier paper) [m]."""
    landmark_min_range_m: PositiveFloat = 5.0
    """Landmarks first seen from nearer than this are left out as redundant (section II.E) [m]."""
