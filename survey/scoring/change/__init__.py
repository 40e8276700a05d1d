"""Elevation change between two surveys: coregistration, variogram, volume and mass.

Errors of a single map against a reference live one folder up.
"""
