"""Agreement of odometry and fixes: checks of start and clocks, fits of assumed errors, and what resolves a contradiction.

Filter and smoother are those of `vision_slam.fusion`.
"""
