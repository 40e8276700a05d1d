"""Fusion of odometry with absolute measurements: particle filter online, batch smoother afterwards.

`filter_path` and `smooth` take a recording with odometry. Odometry and loop closures are those of `vision_slam.odometry` and
`vision_slam.places`.
"""
