"""What the estimator assumes of its sensors, and which landmarks it hands on."""

from pydantic import PositiveFloat

from survey.config import Section


class LocalizationConfig(Section):
    """Datasheet values that the smoother works with, and the landmark gates of the paper.

    Angles are standard deviations of errors that stay correlated over
    `attitude_correlation_m` of travel. A GPS correlation time that is longer than the
    true one costs little; one that is too short makes every covariance a lie.
    """

    yaw_sigma_deg: PositiveFloat = 0.2
    """Heading error of the visual odometry [deg]."""
    tilt_sigma_deg: PositiveFloat = 0.1
    """Roll and pitch error, tied to gravity [deg]."""
    attitude_correlation_m: PositiveFloat = 60.0
    """Travel over which attitude errors stay correlated [m]."""
    scale_sigma: PositiveFloat = 0.004
    """Relative error of the odometry's scale."""
    step_sigma_m: PositiveFloat = 0.006
    """Random error of the odometry per square root of a metre [m]."""
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
    node_spacing_m: PositiveFloat = 10.0
    """Travel between the places at which errors are estimated [m]."""
    landmark_max_sigma_m: PositiveFloat = 0.5
    """Largest half-axis of a landmark's own 1σ ellipsoid (section II.E of the glacier paper) [m]."""
    landmark_min_range_m: PositiveFloat = 5.0
    """Landmarks first seen from nearer than this are left out as redundant (section II.E) [m]."""
