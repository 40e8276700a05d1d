"""Fusion of odometry with absolute measurements: particle filter online, smoother afterwards.

Odometry and the recognition of places supply its inputs from folders of their own.
"""
