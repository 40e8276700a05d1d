"""Readers of recorded drives: ROS bags, KITTI, TUM, EuRoC, image folders, GPS files.

Readers only read; localization lives one folder up.
"""
