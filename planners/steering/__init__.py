"""Steering of patterns that are decided while driving, from the sensed attitude.

Patterns that are fixed before the drive live in `planners.swaths`.
"""
