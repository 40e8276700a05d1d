"""Errors of receivers: differential corrections by a base station, and the delay of fixes.

The smoother that estimates the delay stands in `vision_slam.fusion.smoother`.
"""
