"""Monocular visual odometry: features, tracks, keyframe window, scale, far features.

GPS and everything that needs a world frame live in `vision_slam.fusion`.
"""
