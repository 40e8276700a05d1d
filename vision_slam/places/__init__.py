"""Place recognition on top-down ground mosaics: loop closures and relocalization.

The constraints found here are applied in `vision_slam.fusion.pose_constraints`.
"""
