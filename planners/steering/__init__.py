"""Patterns that steer while driving, from sensed attitude and position.

Patterns that are fixed before the drive live in `planners.swaths`.
"""
