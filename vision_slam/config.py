"""Settings of localization and of visual odometry.

`LocalizationConfig` holds the errors assumed of the sensors, the gates of fixes and loop closures, and the selection of
landmarks. `ImageOdometryErrors` are the errors of odometry from images, which replace those of other odometry.
`VisualOdometryConfig` holds the settings of detection, tracking and the keyframe window. The last words of a name are
its unit.
"""

from typing import Literal, Self

import numpy as np
from pydantic import NonNegativeFloat, PositiveFloat, PositiveInt

from survey.core import Section

_UNKNOWN_START_M = 100.0
_UNKNOWN_HEADING_DEG = 5.0
_DRIFTS_OVER_M = 50.0  # the scale drifts in turns and stays as it is between them
UNKNOWN_MEMORY_S = 500.0
"""Correlation time of the fixes' errors of a receiver of which nothing is known; on a glacier 220 to 900 s [s]."""
UNKNOWN_CLOCK_S = 0.5
"""Offset between the clocks of a receiver and of images of which nothing is known: transport and buffering [s]."""


class ImageOdometryErrors(Section):
    """Errors of visual odometry; each replaces that of the same name in `LocalizationConfig`.

    Measured by `python -m benchmarks.odometry_errors` on drives that no result is judged on.
    """

    yaw_sigma_deg: PositiveFloat = 0.05
    """Heading error with the correlation length `attitude_correlation_m` [deg]."""
    heading_walk_deg_sqrt_m: NonNegativeFloat = 0.04
    """Random walk of the heading error per square root of a metre [deg]."""
    heading_sigma_deg: NonNegativeFloat = 5.0
    """Constant part of the heading error: the error of a compass beside motors [deg]."""
    tilt_sigma_deg: PositiveFloat = 0.15
    """Changing part of the roll and pitch error [deg]."""
    tilt_bias_sigma_deg: NonNegativeFloat = 0.2
    """Constant part of it: the bias of the accelerometer that levels the images [deg]."""
    tilt_stays_in_world: bool = True
    """Whether the changing part is a tilt of the levelled frame, which stays in the world while the body turns."""
    levelling_sigma_deg: PositiveFloat | None = 0.15
    """Difference from that bias: steps climb by 0.12 degrees more than their pitch [deg]."""
    attitude_correlation_m: PositiveFloat = 60.0
    """Correlation length of attitude errors [m]."""
    scale_sigma: PositiveFloat = 0.012
    """Relative error of the scale over the complete drive."""
    scale_wander_sigma: NonNegativeFloat = 0.02
    """Varying part of that error: a monocular map drifts in scale."""
    scale_wander_m: PositiveFloat = 3.0
    """Correlation length of that part [m]."""
    step_sigma_m: PositiveFloat = 0.012
    """Random error, sideways and upwards too, per square root of a metre [m]."""
    turn_sigma_m: NonNegativeFloat = 0.2
    """Random error of turns, per square root of a radian [m]."""


class LocalizationConfig(Section):
    """Errors assumed of the sensors, and the landmark gates of the glacier paper.

    Angles are standard deviations of errors with the correlation length
    `attitude_correlation_m`. A GPS correlation time that is longer than the true one costs
    little accuracy; one that is too short makes all covariances too small.
    """

    yaw_sigma_deg: PositiveFloat = 0.2
    """Heading error of the visual odometry [deg]."""
    heading_sigma_deg: NonNegativeFloat = 0.0
    """Constant part of the heading error: the uncertainty of the heading at the start [deg]."""
    heading_walk_deg_sqrt_m: NonNegativeFloat = 0.0
    """Random walk of the heading error per square root of a metre [deg]; above 0, the gyro is used."""
    gyro_noise_deg_sqrt_h: PositiveFloat = 0.3
    """Angle random walk of the gyro [deg/√h]."""
    gyro_bias_walk_deg_h_sqrt_h: PositiveFloat = 10.0
    """Random walk of its bias, which is unknown at the start [deg/h/√h]."""
    gyro_scale_sigma: NonNegativeFloat = 0.001
    """Relative scale error of the gyro."""
    tilt_sigma_deg: PositiveFloat = 0.1
    """Changing part of the roll and pitch error of the odometry [deg]; too small is worse than too large."""
    tilt_bias_sigma_deg: NonNegativeFloat = 0.02
    """Constant part of it: the tilt at which the sensor is mounted [deg]."""
    tilt_stays_in_world: bool = False
    """Whether the changing part stays in the world while the body turns, or turns with the body."""
    accelerometer_bias_sigma_deg: PositiveFloat = 0.5
    """Apparent tilt by the bias of the accelerometer, constant over the drive [deg]."""
    levelling_sigma_deg: PositiveFloat | None = None
    """Difference between the constant tilt of the odometry and that bias, if the odometry was levelled by the
    accelerometer [deg]; its readings are then not used again. None where it was levelled by other means."""
    attitude_correlation_m: PositiveFloat = 60.0
    """Correlation length of attitude errors [m]."""
    scale_sigma: PositiveFloat = 0.004
    """Relative error of the odometry's scale."""
    scale_wander_sigma: NonNegativeFloat = 0.0
    """Varying part of that error."""
    scale_wander_m: PositiveFloat = 6.0
    """Correlation length of that part [m]."""
    wheel_scale_sigma: PositiveFloat = 0.03
    """Constant relative error of the travel by wheels: worn tracks, steady slip."""
    wheel_step_sigma_m: PositiveFloat = 0.012
    """Random error of the wheels' travel per square root of a metre [m]."""
    wheel_skid_m: PositiveFloat = 0.2
    """Excess travel of skidding tracks per radian of turning, with the same standard deviation [m]."""
    step_sigma_m: PositiveFloat = 0.006
    """Random error of the odometry per square root of a metre [m]."""
    turn_sigma_m: NonNegativeFloat = 0.0
    """Random error of turns per square root of a radian [m]."""
    start: Literal["surveyed", "unknown"] = "surveyed"
    """Whether start and heading there are known; unknown is 100 m and 5°. A recording whose start was not
    surveyed counts as unknown."""
    start_sigma_m: PositiveFloat = 0.02
    """Error of the surveyed start [m]."""
    gps_bias_sigma_m: PositiveFloat = 1.0
    """Slowly varying horizontal error of the fixes [m]."""
    gps_correlation_time_s: PositiveFloat = 120.0
    """Correlation time of that error [s]; unless set, 500 s for a recording whose start was not surveyed, and 4 or
    16 times as long where the evidence of the smoother asks for it."""
    gps_white_sigma_m: PositiveFloat = 0.5
    """Independent horizontal error of each fix [m]."""
    gps_vertical_factor: PositiveFloat = 1.7
    """Vertical over horizontal error of the fixes."""
    clock_sigma_s: NonNegativeFloat = 0.0
    """Offset between the clocks of fixes and images [s]; unless set, 0.5 s for images whose start was not surveyed.
    0 where one clock stamps both, as with hardware triggers."""
    barometer_drift_sigma_m: PositiveFloat = 1.0
    """Drift of the pressure altitude by weather [m]."""
    barometer_correlation_time_s: PositiveFloat = 1800.0
    """Correlation time of that drift [s]."""
    barometer_white_sigma_m: PositiveFloat = 0.15
    """Independent error of each pressure altitude [m]."""
    base_residual: PositiveFloat = 0.2
    """Share of the slowly varying GPS error that remains after differential correction."""
    base_barometer_residual: PositiveFloat = 0.3
    """Share of the drift of the barometer that remains after differential correction."""
    tie_gate: PositiveFloat = 16.27
    """Squared Mahalanobis distance beyond which a stake or a loop closure is refused (χ², 99.9 %)."""
    images: ImageOdometryErrors = ImageOdometryErrors()
    """Errors of the odometry where it comes from images."""
    node_spacing_m: PositiveFloat = 10.0
    """Travel between the nodes of the smoother [m]."""
    landmark_max_sigma_m: PositiveFloat = 0.5
    """Largest half-axis of a landmark's own 1σ ellipsoid (section II.E of the glacier paper) [m]."""
    landmark_min_range_m: PositiveFloat = 5.0
    """Landmarks first seen from nearer than this are left out as redundant (section II.E) [m]."""
    landmark_thinning: Literal["range", "information"] = "range"
    """Whether landmarks are thinned by that range, or by their information about the map at any range."""
    landmarks_per_m: PositiveFloat = 5.0
    """By information: landmarks per metre of travel."""
    terrain_variance_m2: PositiveFloat = 10.0
    """By information: prior variance of the terrain (section III.B) [m²]."""
    terrain_length_scale_m: PositiveFloat = 17.75
    """By information: its length scale [m]; rather too small than too large."""

    @property
    def start_errors(self) -> tuple[float, float]:
        """Standard deviations of each coordinate of the start [m] and of the heading there [rad]."""
        known = self.start == "surveyed"
        heading_deg = self.heading_sigma_deg if known else max(self.heading_sigma_deg, _UNKNOWN_HEADING_DEG)
        return self.start_sigma_m if known else _UNKNOWN_START_M, float(np.radians(heading_deg))

    @property
    def fix_sigma_m(self) -> float:
        """Horizontal standard deviation of a fix, slowly varying and independent errors together [m]."""
        return float(np.hypot(self.gps_bias_sigma_m, self.gps_white_sigma_m))

    def with_image_errors(self, scale_drift_sigma: float = 0.0) -> Self:
        """Return the configuration with the odometry errors of images in place of those of other odometry.

        A relative drift of scale that the lens may cause, `scale_drift_sigma`, widens the varying part of the scale error,
        and lasts longer.
        """
        images = self.images
        if scale_drift_sigma > 0.0:
            wander = float(np.hypot(images.scale_wander_sigma, scale_drift_sigma))
            length_m = max(images.scale_wander_m, _DRIFTS_OVER_M)
            images = images.model_copy(update={"scale_wander_sigma": wander, "scale_wander_m": length_m})
        return self.model_copy(update=images.model_dump())

    def with_wheel_errors(self) -> Self:
        """Return the configuration with the errors of wheels as those of the odometry, levelled by gravity as images are."""
        wheels = {
            "scale_sigma": self.wheel_scale_sigma,
            "step_sigma_m": self.wheel_step_sigma_m,
            "turn_sigma_m": self.wheel_skid_m,
        }
        return self.with_image_errors().model_copy(update=wheels)


class VisualOdometryConfig(Section):
    """Settings of contrast enhancement, tracking, keyframes and landmark errors.

    Lengths are of the body's travel, pixels those of the images.
    """

    lens: Literal["auto", "given", "refine"] = "auto"
    """Whether radial distortion and focal length are estimated from the images of a complete drive; auto does
    so where the calibration states no distortion."""
    clahe_clip: float = 4.0
    """Clip limit of the contrast-limited adaptive histogram equalization; 0 leaves images as they are."""
    clahe_tiles: PositiveInt = 8
    """Tiles a side of that equalization."""
    detector: Literal["gftt", "harris", "orb", "sift"] = "gftt"
    """Corner detector; its corners are followed by pyramidal Lucas-Kanade, whatever it is."""
    n_features: PositiveInt = 290
    """Corners that are followed at a time."""
    corner_threshold: PositiveFloat = 2e-4
    """Least response of a corner, absolute, so that strong corners do not suppress those of snow."""
    corner_spacing_px: PositiveInt = 12
    """Least distance between corners [pixels]."""
    round_trip_px: PositiveFloat = 0.6
    """Largest forward-backward tracking error [pixels]."""
    pixel_sigma: PositiveFloat = 0.5
    """Error of a followed corner [pixels]; where the residuals of the images are larger, theirs is used."""
    gate_px: PositiveFloat = 3.0
    """Largest distance of a corner from where the pose puts its point [pixels]."""
    keyframe_spacing_m: PositiveFloat = 0.2
    """Travel after which a frame becomes a keyframe, which the window is solved for [m]."""
    keyframe_turn_deg: PositiveFloat = 3.0
    """Turn after which it does [deg]."""
    n_free: PositiveInt = 8
    """Newest keyframes, whose poses are estimated."""
    n_held: PositiveInt = 5
    """Keyframes before them, whose poses are held."""
    anchor_every: PositiveInt = 10
    """Of still older keyframes each of this many is held too, while far features live that it saw."""
    n_anchors: PositiveInt = 3
    """Most anchors."""
    wheel_sigma: PositiveFloat = 0.01
    """Relative error of the travel by wheels, step by step, without slip."""
    lateral_sigma: PositiveFloat = 0.04
    """Sideways and vertical motion of the body per forward motion."""
    gyro_sigma_deg: PositiveFloat = 0.01
    """Error of a turn by gyro over one second [deg]; it grows with the square root of time."""
    least_inliers: PositiveInt = 15
    """Least number of inliers of a visual pose."""
    least_inlier_ratio: PositiveFloat = 0.4
    """Least share of inliers among the tracked corners."""
    least_kept_ratio: PositiveFloat = 0.33
    """Least share of inliers among the corners before tracking: a small remainder may agree by chance."""
    least_entropy_bits: PositiveFloat = 2.5
    """Least entropy of an image; images with less are blank."""
    accelerometer_time_s: PositiveFloat = 30.0
    """Time over which gravity corrects roll and pitch [s]."""
    landmark_attitude_deg: PositiveFloat = 0.5
    """Error of attitude between the poses that saw a landmark [deg]; this and the next three are calibrated."""
    landmark_scale_sigma: PositiveFloat = 0.013
    """Relative error of scale within the window."""
    landmark_pixel_factor: PositiveFloat = 1.7
    """By how much correlated pixel errors exceed independent ones when a point is triangulated."""
    landmark_floor_m: PositiveFloat = 0.013
    """Least error of the nearest points, by drift of the tracked corners [m]."""
