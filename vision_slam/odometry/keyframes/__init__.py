"""Keyframes of visual odometry: fixed-lag bundle adjustment."""
