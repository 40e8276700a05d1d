"""Localization from images beside ORB-SLAM3, COLMAP and an odometry of OpenCV's functions."""
