"""Elevation change between two surveys: coregistration, variogram, volume and mass, and motion by image matching.

Errors of a single map against a reference stand in `survey.scoring`.
"""
