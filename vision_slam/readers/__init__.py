"""Readers of recorded drives: ROS bags, KITTI, TUM, EuRoC, images, GPS files.

Readers return image sequences and logs of fixes (`vision_slam.readers.sequence`) and estimate nothing.
"""
