"""Terrain from points and lines of sight, by space-carving kernels.

Begin with `space_carving`, the model; `carved_surface` is one surface that learns, `descent`
its compiled passes over the points, `bases` what it has learned, and `wu_kernel` the kernel.
"""
