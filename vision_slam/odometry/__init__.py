"""Monocular visual odometry: features and tracks, bundle adjustment, scale, far features, self-calibration.

`VisualSlam` processes one image, `VisualOdometer` a drive image by image, `visual_odometry` a recording and `OnboardOdometry`
records that arrive during the drive. Fixes and the world frame belong to `vision_slam.fusion`.
"""
