"""Terrain from points and lines of sight, by space-carving kernels.

Begin with `space_carving`, the model; `carved_surface` is one surface and the points that it learns from, and `descent` its
kernels and its compiled passes over the points.
"""
