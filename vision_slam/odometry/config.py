"""Settings of visual odometry."""

from typing import Literal

from pydantic import PositiveFloat, PositiveInt

from survey.core.config import Section


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
