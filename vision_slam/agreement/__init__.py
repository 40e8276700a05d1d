"""Agreement of odometry and fixes: checks of start, clocks, scale and tilt, and fits of assumed errors.

`vision_slam.agreement.steps` holds the steps of the pipeline. Filter and smoother are those of `vision_slam.fusion`.
"""
